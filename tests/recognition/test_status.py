"""What the terminal shows of a live run."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

from recognition.live.latency import Latency
from recognition.status import CameraStatus, LiveStatus, Seen, line, summary, table

FINE = CameraStatus("cam0", 29.97, 0.034, 300, 300, 0, 0, 0, 0, 0, None)
LOST = CameraStatus("cam1", 0.0, None, 200, 190, 10, 5, 1, 2, 3, "lost: [Errno 113] no route to host")
RUN = LiveStatus(10.2, (FINE, LOST), 300, 200, 100, 7, 19.6, 0.071, 0.123, 12_500_000)
SEEN = Seen("DEGRADED", "1 of 2 cameras (cam1: lost: [Errno 113] no route to host)", 3, 5)


def drawn(renderable, width=120):
    console = Console(file=io.StringIO(), width=width, force_terminal=False)
    console.print(renderable)
    return console.file.getvalue()


def test_a_line_says_everything():
    assert line(RUN, SEEN) == (
        "10 s; DEGRADED (1 of 2 cameras (cam1: lost: [Errno 113] no route to host)); workers 3, objects 5; "
        "19.6 sets/s, capture to track 71 ms (95 %: 123), 100 of 300 skipped; cam0 30.0 fps lag 34 ms; "
        "cam1 0.0 fps 18 dropped"
    )


def test_before_the_first_result_a_line_says_what_there_is():
    early = replace(RUN, latency_p50_s=None, latency_p95_s=None, sets=0, skipped=0)
    assert line(early, None) == "10 s; 19.6 sets/s, 0 of 0 skipped; cam0 30.0 fps lag 34 ms; cam1 0.0 fps 18 dropped"


def test_the_table_shows_each_camera_and_the_state_of_the_run():
    text = drawn(table(RUN, SEEN))
    assert "DEGRADED" in text
    assert "workers 3, objects 5" in text
    [row] = [row for row in text.splitlines() if "cam0" in row]
    assert [cell.strip() for cell in row.split("│")[1:-1]] == ["cam0", "30.0", "34 ms", "300", "0", "ok"]
    assert "[Errno 113] no route to host" in text  # not taken for markup
    assert "100 of 300 skipped" in text
    assert "12 MB wait for the disk" in text
    assert "no result yet" in drawn(table(RUN, None))


def test_the_table_fits_a_narrow_terminal():
    text = drawn(table(RUN, SEEN), width=55)
    assert max(len(row) for row in text.splitlines()) <= 55
    headline = text.splitlines()[:2]
    assert headline[1].startswith("1 of 2 cameras (cam1: lost: [Errno")
    assert headline[1].endswith("…")  # whole in the row of the camera
    state = " ".join(row.split("│")[-2].strip() for row in text.splitlines() if "│" in row)
    assert state == "ok lost: [Errno 113] no route to host"


def test_a_recording_that_ended_is_said_as_long_as_the_run_lasts():
    ended = replace(RUN, unrecorded_why="its 3 MB are used up")
    assert "; NOT RECORDED (its 3 MB are used up); 19.6 sets/s" in line(ended, SEEN)
    assert drawn(table(ended, SEEN)).splitlines()[-1] == " NOT RECORDED   its 3 MB are used up"


def test_what_is_not_monitored_is_loud():
    console = Console(file=io.StringIO(), width=120, force_terminal=True, color_system="standard")
    console.print(table(RUN, Seen("NOT MONITORED", "0 of 2 cameras", 0, 0)))
    assert "\x1b[1;37;41m NOT MONITORED" in console.file.getvalue()


def test_the_summary_counts_what_was_lost():
    assert list(summary(RUN)) == [
        "200 of 300 frame sets looked at in 10 s, capture to track 71 ms (95 %: 123); 100 skipped because inference "
        "was late",
        "  cam0: 300 of 300 frames recorded",
        "  cam1: 190 of 200 frames recorded, 10 unrecorded, 5 undecoded, 1 corrupt, 2 late, interrupted 3 times",
    ]
    once = replace(RUN, cameras=(replace(FINE, interruptions=1), replace(FINE, interruptions=2)))
    assert [text.rpartition(", ")[2] for text in summary(once)][1:] == ["interrupted once", "interrupted twice"]


def test_quantiles_are_exact_to_a_millisecond():
    latency = Latency()
    assert latency.quantile_s(0.5) is None
    for n in range(1000):
        latency.add(n * 1e-4)
    assert latency.quantile_s(0.5) == pytest.approx(0.05, abs=1e-3)
    assert latency.quantile_s(0.95) == pytest.approx(0.095, abs=1e-3)
    latency.add(1e6)
    latency.add(-1.0)
    assert latency.quantile_s(1.0) == 10.0
