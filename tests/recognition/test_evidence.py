"""Evidence: a folder for each event that a person can look at, without anybody's face in it."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import av
import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import event
from judged_runs import FPS, FRAMES, T0, judged_run, site_in
from typer.testing import CliRunner

from recognition.cli import app
from recognition.errors import EventsError
from recognition.events import Margin, event_document
from recognition.evidence import EvidenceOptions, exhibits, margin_plot, write_exhibits
from recognition.evidence.exhibits import decisive_ns
from recognition.evidence.zones import zones_of
from recognition.rules import parse_rules
from recognition.sources.recording import open_recording
from recognition.viewing import floor, frame_span, scenes_between

SECOND = 10**9
SVG = "{http://www.w3.org/2000/svg}"
FILES = {"event.json", "instant.png", "margins.svg", "plan.png", "views.mp4"}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return site_in(tmp_path_factory.mktemp("evidence"))


@pytest.fixture(scope="module")
def ran(site):
    """A recording with frames, in which a worker without a hat is found at once, and its event."""
    path, result = judged_run(site, "r.mcap", images=True)
    return path, result.events[0]


@pytest.fixture(scope="module")
def exhibit(ran, tmp_path_factory):
    """The evidence of the event, as if it had lasted from 0.5 s to 1.5 s."""
    folder = tmp_path_factory.mktemp("out")
    path, found = ran
    short = replace(found, start_ns=T0 + SECOND // 2, raised_ns=T0 + SECOND // 2, end_ns=T0 + 3 * SECOND // 2)
    done = []
    (made,) = write_exhibits(open_recording(path), [short], folder, progress=done.append)
    assert done == [1]
    return made


def test_each_event_has_a_folder_with_video_pictures_plot_and_words(exhibit):
    assert {file.name for file in exhibit.folder.iterdir()} == FILES
    assert exhibit.folder.name == exhibit.event.event_id
    assert exhibit.lacking == ()
    document = json.loads((exhibit.folder / "event.json").read_text())
    assert document["event"] == json.loads(json.dumps(event_document(exhibit.event)))
    assert (document["format"], document["recording"]) == ("recognition.evidence", ["r.mcap"])
    assert document["video"]["heads"] == "blurred"
    assert document["video"]["cameras"] == ["cam0", "cam1", "cam2", "cam3"]


def test_the_video_has_every_frame_of_that_time(exhibit):
    document = json.loads((exhibit.folder / "event.json").read_text())
    with av.open(str(exhibit.folder / "views.mp4")) as video:
        frames = sum(1 for _ in video.decode(video=0))
    assert frames == FRAMES  # 5 s before and after are more than there is
    assert (document["video"]["start_ns"], document["video"]["end_ns"]) == (T0, T0 + round((FRAMES - 1) * SECOND / FPS))


def test_pictures_show_who_violates_the_rule_in_red(exhibit):
    picture = cv2.imread(str(exhibit.folder / "instant.png"))
    blue, green, red = picture[3, -3].astype(int)  # the band says VIOLATED
    assert red > 180 > 60 > max(blue, green)
    for name in ("instant.png", "plan.png"):
        image = cv2.imread(str(exhibit.folder / name)).astype(int)
        pure = (image[..., 2] > 250) & (image[..., 0] < 5) & (image[..., 1] < 5)
        assert pure.sum() > 50, name


def test_long_violations_are_cut_and_say_so_and_faces_are_shown_on_demand(ran, tmp_path, monkeypatch):
    monkeypatch.setattr(exhibits, "LONGEST_S", 0.2)
    monkeypatch.setattr(exhibits, "AFTER_S", 0.3)
    path, found = ran
    (made,) = write_exhibits(open_recording(path), [found], tmp_path, EvidenceOptions(show_faces=True))
    document = json.loads((made.folder / "event.json").read_text())
    assert document["video"]["heads"] == "shown"
    assert document["video"]["end_ns"] == found.start_ns + SECOND // 2
    assert made.lacking == tuple(document["lacking"])
    assert made.lacking[0].startswith("video: what follows after 0.2 s of ")


def test_a_recording_without_frames_gives_all_but_the_video(site, tmp_path):
    path, result = judged_run(site, "blind.mcap")
    assert frame_span(open_recording(path)) is None
    (made,) = write_exhibits(open_recording(path), result.events, tmp_path)
    assert {file.name for file in made.folder.iterdir()} == FILES - {"instant.png", "views.mp4"}
    assert made.lacking == ("video: the recording holds no frames",)
    assert json.loads((made.folder / "event.json").read_text())["video"] is None


ZONES = """format = "recognition.rules"
version = 1

[zones.pit]
polygon_m = [[0.0, -1.0], [1.5, -1.0], [1.5, 0.5], [0.0, 0.5]]

[zones.gate]
polygon_m = [[-1.0, 0.0], [-0.5, 0.0], [-0.5, 1.0]]

[zones.yard]
polygon_m = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0]]

[definitions]
"near(w)" = "dist(w.feet, gate, xy) < 1 m"

[[rules]]
name = "pit"
sentence = "a worker stands in the pit"
when = "each w: inside(w.feet, pit) and not exists v != w: near(v)"

[[rules]]
name = "pair"
sentence = "two are near each other"
when = "each v: exists w != v: dist(v.torso, w.torso) < 1 m"
"""


def test_the_zones_that_a_rule_speaks_about_are_on_the_floor_plan(site, ran, tmp_path):
    rules = parse_rules(ZONES, "zones")
    by_rule = {}
    for rule, digest in (("pit", rules.digest), ("pair", rules.digest), ("pit", "sha256:another")):
        zones = zones_of(rules, rule, digest)
        shown = replace(ran[1], rule=rule, rules_digest=digest, event_id=f"{rule}-{digest[-4:]}")
        (made,) = write_exhibits(open_recording(site.folder / "r.mcap"), [shown], tmp_path, rules=rules)
        plan = cv2.imread(str(made.folder / "plan.png")).astype(int)
        drawn = (np.abs(plan - floor.ZONE_BGR).max(axis=2) < 25).sum()
        by_rule[shown.event_id] = [zone.name for zone in zones], drawn > 500  # tracks have few pixels of that colour
    assert list(by_rule.values()) == [(["gate", "pit"], True), ([], False), ([], False)]
    assert zones_of(None, "pit", rules.digest) == ()


def test_an_event_of_another_time_has_no_video(ran, tmp_path):
    (made,) = write_exhibits(open_recording(ran[0]), [event(t_s=-9e6, end_s=-8e6)], tmp_path)
    assert "video: the recording holds no frames of this time" in made.lacking


def test_scenes_of_a_part_have_the_runs_own_numbers(ran):
    path, found = ran
    part = scenes_between(open_recording(path), T0 + SECOND, T0 + 3 * SECOND // 2)
    assert [scene.t_ns for scene in part] == [T0 + round(k * SECOND / FPS) for k in range(10, 16)]
    assert all(found.actors[0].track_id in {w.track_id for w in scene.workers} for scene in part)


# --- margins --------------------------------------------------------------------------------------------------------


def with_margins(*values, step_ns=SECOND // 10):
    made = event(end_s=len(values) * step_ns / SECOND)
    margins = tuple(Margin(made.start_ns + k * step_ns, value) for k, value in enumerate(values))
    return replace(made, margins=margins)


def test_the_decisive_instant_is_in_the_middle_of_the_clearest():
    assert decisive_ns(with_margins(0.1, 0.9, 0.9, 0.9, float("nan"))) == event().start_ns + 2 * SECOND // 10
    assert decisive_ns(with_margins(float("nan"))) == event().raised_ns
    assert decisive_ns(replace(event(), margins=())) == event().raised_ns


def drawn(plot):
    return ElementTree.fromstring(plot)


def test_the_plot_has_a_line_for_each_stretch_that_is_known_and_grey_where_it_is_not():
    nan = float("nan")
    plot = drawn(margin_plot(with_margins(0.5, 0.5, nan, nan, 0.4, -0.4)))
    lines = [path for path in plot.iter(f"{SVG}path") if path.get("fill") == "none"]
    assert len(lines) == 2
    grey = [box for box in plot.iter(f"{SVG}rect") if box.get("fill") == "#f0f0f0"]
    assert sum(float(box.get("width")) for box in grey) == pytest.approx(640 * 2 / 5, abs=0.2)
    red = [path.get("d") for path in plot.iter(f"{SVG}path") if path.get("fill-opacity")]
    assert f"{64 + 640 * 4.5 / 5:.1f} 194.0" in red[1]  # it crosses 0 half-way between 0.4 and -0.4


def test_the_plot_says_what_who_and_when():
    words = "".join(drawn(margin_plot(replace(with_margins(0.2, 0.3), sentence="<no> & hat"))).itertext())
    for text in ("no_hat: <no> & hat", "worker 7", "2026-11-18T11:06:40.000Z", "rig PASS", "raised", "sha256:1"):
        assert text in words
    assert "not validated on real people" in words


def test_long_plots_keep_their_peaks():
    values = np.full(30_000, 0.1)
    values[12_345] = 0.97
    plot = margin_plot(with_margins(*values.tolist(), step_ns=SECOND // 30))
    assert len(plot) < 200_000
    assert f"{74 + 240 * (1 - 0.97) / 2:.1f}" in plot


def test_an_event_without_margins_has_a_plot_all_the_same():
    assert drawn(margin_plot(replace(event(), margins=()))).tag == f"{SVG}svg"


# --- the command ----------------------------------------------------------------------------------------------------


def invoke(*arguments):
    return CliRunner().invoke(app, ["evidence", *map(str, arguments)])


def test_the_command_writes_beside_the_recording(ran, monkeypatch):
    monkeypatch.setattr(exhibits, "LONGEST_S", 0.1)
    monkeypatch.setattr(exhibits, "AFTER_S", 0.1)
    path, found = ran
    done = invoke(path, "--event", found.event_id, "--json")
    told = json.loads(done.output)
    folder = path.with_name("r.evidence") / found.event_id
    assert done.exit_code == 0
    assert [(one["event_id"], one["folder"]) for one in told["events"]] == [(found.event_id, str(folder))]
    assert told["faces"] == "blurred"
    assert {file.name for file in folder.iterdir()} == FILES


def test_the_command_refuses_events_that_are_not_there(ran, tmp_path):
    error = invoke(ran[0], "--event", "no_hat-0", "-o", tmp_path).exception
    assert isinstance(error, EventsError)
    assert f"one of {ran[1].event_id}" in str(error)
    assert "got:      no_hat-0" in str(error)


def test_events_files_of_another_recording_are_refused(ran, tmp_path):
    from test_events_file import LOG

    from recognition.events import write_events

    write_events(LOG, tmp_path / "other.events.json")
    error = invoke(ran[0], "--events", tmp_path / "other.events.json", "-o", tmp_path).exception
    assert isinstance(error, EventsError)
    assert "sha256:2, tracked, for run.mcap" in str(error)
