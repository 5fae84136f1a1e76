"""Claims about the page of clocks: self-contained, honest when it draws by column, and readable in every state."""

import re
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from rigcal.report.clocks import sync_report
from rigcal.report.clocks_axes import time_axis, value_axis
from rigcal.report.clocks_figures import offset_figure, rate_figure
from rigcal.sync.history.series import CameraHistory, OffsetSeries, SyncHistory

START_S = 1_776_000_000.0  # 2026-04-12T13:20:00Z
VOID = {"meta", "br", "link", "img", "input"}


def series(method="probe", *, seconds=600.0, offset=0.0, drift_ppm=1.0, bound=2e-4, samples=601):
    t_s = START_S + np.linspace(0, seconds, samples)
    return OffsetSeries(method, t_s, offset + drift_ppm * 1e-6 * (t_s - START_S), np.full(samples, bound))


def camera(camera_id="cam0", *, seconds=600.0, offsets=(), missing=(), repeated=(), steps=(), **more):
    frames_s = START_S + np.arange(0, seconds, 1 / 30)
    at = [START_S + np.asarray(times, dtype=float) for times in (missing, repeated, steps)]
    more = {"remarks": (), "declared_fps": 30.0, "delivered_fps": 30.0} | more
    return CameraHistory(camera_id, frames_s, *at, offsets=tuple(offsets), **more)


def history(*cameras, epoch=True, remarks=(), title="hall-3"):
    return SyncHistory(title, epoch, cameras, 2.0, 0.02, remarks)


def both(**more):
    return (series(**more), series("rig file", drift_ppm=0.0, bound=1e-3))


class Tags(HTMLParser):
    """Fails where tags do not close in order; keeps attributes."""

    def __init__(self):
        super().__init__()
        self.open, self.attributes = [], []

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, *entry) for entry in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.attributes += [(tag, *entry) for entry in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed(page):
    tags = Tags()
    tags.feed(page)
    assert not tags.open
    return tags


def words_of(page):
    body = re.sub(r"<(style|svg).*?</\1>", " ", page, flags=re.S)
    return unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def test_the_page_loads_nothing_and_is_the_same_each_time():
    seen = history(camera(offsets=both()), camera("cam1", missing=[60, 61], steps=[300]))
    page = sync_report(seen)
    attributes = parsed(page).attributes
    links = [value for _, name, value in attributes if name in ("src", "href", "srcset", "data", "action")]
    assert links
    assert all(link.startswith("#") for link in links)
    assert "<script" not in page
    assert "@import" not in page
    assert "http:" not in page
    assert "https:" not in page
    assert "url(" not in page
    policy = next(value for _, name, value in attributes if name == "content" and value.startswith("default-src"))
    assert policy == "default-src 'none'; style-src 'unsafe-inline'"
    assert sync_report(seen) == page


def test_names_are_text_and_never_markup():
    page = sync_report(history(camera("<b>1", remarks=("a < b",)), title="<i>hall"))
    parsed(page)
    assert "<b>1" not in page
    assert "<i>hall" not in page
    assert "a &lt; b" in page


def test_a_green_recording_says_the_greatest_error_in_millimetres():
    words = words_of(sync_report(history(camera(offsets=both()), camera("cam1", offsets=both(drift_ppm=2.0)))))
    assert "GREEN Clocks misplace what moves at 2 m/s by 2.8 mm (cam1) at most, within the limit of 20 mm." in words
    assert "2026-04-12 13:20:00 to 13:29:59 UTC, 10 min 00 s; 2 cameras" in words
    assert "cam0 within the limit 1.60 0.300 1.00 0.200 18000 0 0 0 30.00 of 30" in words
    assert "Measured by probes of its host." in words


def test_a_red_recording_says_who_and_what_else_is_amiss():
    words = words_of(
        sync_report(
            history(
                camera(offsets=both(drift_ppm=60.0)),
                camera("cam1", steps=[300]),
                camera("cam2", missing=[60, 61]),
            )
        )
    )
    assert (
        "RED Clocks misplace what moves at 2 m/s by 72.4 mm (cam0) at most, beyond the limit of 20 mm. The clock of "
        "cam1 and cam2 is not known. 2 frames are missing. The clock of cam1 was stepped."
    ) in words
    assert "cam1: clock was stepped" in words


@pytest.mark.parametrize(
    ("made", "verdict"),
    [
        ({}, "clock not known"),
        ({"seconds": 0.0}, "no frames"),
        ({"offsets": both(), "missing": [60]}, "frames are missing"),
        ({"offsets": both(), "repeated": [60]}, "stamps repeat"),
        ({"offsets": both(), "steps": [60]}, "clock was stepped"),
        ({"offsets": both(), "arrival_stamps": True}, "stamped on arrival"),
        ({"offsets": both(), "latency_unknown": True}, "latency not known"),
        ({"offsets": both(), "delivered_fps": 29.83}, "frame rate is off"),
    ],
)
def test_what_is_amiss_makes_a_camera_amber_and_is_named(made, verdict):
    page = sync_report(history(camera(offsets=both()), camera("cam1", **made)))
    parsed(page)
    words = words_of(page)
    assert f"cam1: {verdict}" in words
    assert "AMBER" in words


def test_what_only_the_rig_file_claims_is_said_to_be_unmeasured():
    page = sync_report(history(camera(offsets=(series("rig file", bound=3e-3),))))
    assert "Nothing was measured during this recording: the band is what the rig file's clock claims." in words_of(page)
    assert "GREEN" in page
    assert "3.000 6.00 600 0 0 0 30.00" in words_of(page)


def test_an_offset_that_nothing_corrects_is_drawn_about_its_mean_and_judged_whole():
    words = words_of(sync_report(history(camera(offsets=(series(offset=0.0123, drift_ppm=0.0),)))))
    assert "ms from its mean, +12.300 ms" in words
    assert "RED Clocks misplace what moves at 2 m/s by 25 mm" in words


def test_pointing_at_a_stretch_tells_its_figures():
    page = sync_report(history(camera(offsets=both(), missing=[130, 131])))
    titles = re.findall(r"<title>(13:\S+: .*?)</title>", page)
    assert len(titles) == 30
    assert titles[0] == ("13:20:00: off by +0.01 ms, known to 0.20 ms; at most 0.438 mm; 600 frames; 30.00 fps")
    assert titles[6].endswith("; 2 missing")


def test_times_without_an_epoch_count_from_the_first_frame():
    relative = camera()
    relative = CameraHistory("cam0", relative.frame_t_s - START_S, *3 * [np.zeros(0)], offsets=(), remarks=())
    words = words_of(sync_report(history(relative, epoch=False, remarks=("the times do not count from 1970",))))
    assert "10 min 00 s; times count from the first frame" in words
    assert "the times do not count from 1970" in words
    assert "2 min 4 min 6 min 8 min" in words


def test_ten_hours_of_four_cameras_stay_small_and_keep_a_moment():
    seconds, samples = 36_000.0, 20_001
    rng = np.random.default_rng(7)
    t_s = START_S + np.linspace(0, seconds, samples)
    offset_s = rng.normal(0, 1e-5, samples)
    offset_s[12_345] = 0.006  # for under two seconds
    noisy = OffsetSeries("probe", t_s, offset_s, rng.uniform(1e-4, 3e-4, samples))
    model = OffsetSeries("rig file", t_s, np.zeros(samples), np.full(samples, 1e-3))
    missing = np.sort(rng.uniform(0, seconds, 20_000))
    cameras = [camera(f"cam{i}", seconds=seconds, offsets=(noisy, model), missing=missing) for i in range(4)]
    seen = history(*cameras)
    page = sync_report(seen)
    assert len(page.encode()) < 1_000_000
    figure = offset_figure(seen, cameras[0], time_axis(*seen.span_s, epoch=True))
    places, values_ms = zip(*((label.percent, float(label.text)) for label in figure.labels), strict=True)
    peak = float(np.polyval(np.polyfit(values_ms, places, 1), 6.0))
    drawn = [float(y) for y in re.findall(r"[ML][\d.]+ (-?[\d.]+)", figure.series[0].line)]
    assert min(drawn) == pytest.approx(peak, abs=0.2)


def test_a_gap_in_what_is_known_is_a_gap_in_the_line():
    t_s = START_S + np.arange(600.0)
    offset_s = np.where((t_s > START_S + 200) & (t_s < START_S + 300), np.nan, 1e-4)
    known = OffsetSeries("probe", t_s, offset_s, np.full(600, 1e-4) + 0 * offset_s)
    seen = history(camera(offsets=(known,)))
    figure = offset_figure(seen, seen.cameras[0], time_axis(*seen.span_s, epoch=True))
    assert figure.series[0].line.count("M") == figure.series[0].band.count("M") == 2
    parsed(sync_report(seen))


def test_a_dead_stretch_shows_as_no_frames_per_second():
    frames_s = START_S + np.concatenate([np.arange(0, 200, 1 / 30), np.arange(400, 600, 1 / 30)])
    dead = CameraHistory("cam0", frames_s, *3 * [np.zeros(0)], offsets=(), remarks=(), declared_fps=30.0)
    figure = rate_figure(dead, time_axis(START_S, START_S + 600, epoch=True))
    zero, thirty = (next(label.percent for label in figure.labels if label.text == text) for text in ("0", "30"))
    points = [tuple(map(float, p)) for p in re.findall(r"[ML]([\d.]+) (-?[\d.]+)", figure.band)]
    assert all(y == pytest.approx(zero, abs=0.2) for x, y in points if 210 < x < 390)
    assert all(y == pytest.approx(thirty, abs=0.6) for x, y in points if x < 190 or x > 410)
    assert figure.declared == pytest.approx(thirty)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_handful_of_frames_still_makes_a_page(count):
    few = CameraHistory("cam0", START_S + np.arange(count) / 30, *3 * [np.zeros(0)], offsets=(), remarks=())
    parsed(sync_report(history(few)))


@pytest.mark.parametrize(
    ("seconds", "epoch", "labels"),
    [
        (2.0, False, ["0 s", "0.5 s", "1 s", "1.5 s", "2 s"]),
        (18.0, True, ["13:20:00", "13:20:05", "13:20:10", "13:20:15"]),
        (600.0, True, ["13:20", "13:22", "13:24", "13:26", "13:28", "13:30"]),
        (36_000.0, True, ["14:00", "16:00", "18:00", "20:00", "22:00"]),
        (36_000.0, False, ["0 h", "2 h", "4 h", "6 h", "8 h", "10 h"]),
        (400_000.0, True, ["13 Apr", "14 Apr", "15 Apr", "16 Apr", "17 Apr"]),
    ],
)
def test_time_is_labelled_at_round_times(seconds, epoch, labels):
    start_s = START_S if epoch else 0.0
    assert [label.text for label in time_axis(start_s, start_s + seconds, epoch=epoch).labels] == labels


def test_offsets_are_labelled_in_milliseconds_and_millimetres():
    axis = value_axis(-0.004, 0.004, scale=1e3, other=2e3)
    assert [(label.text, label.other) for label in axis.labels] == [
        ("4", "8"),
        ("2", "4"),
        ("0", "0"),
        ("-2", "-4"),
        ("-4", "-8"),
    ][::-1]
    assert axis.y(np.array([axis.high, axis.low])).tolist() == [0.0, 100.0]
