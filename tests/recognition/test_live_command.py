"""``recognition run`` on streams: a paced capture from the command line to its recording, and what it refuses."""

import errno
import io
import json
import os
import signal
import threading

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from recognition.cli import _show, app
from recognition.cli._amounts import seconds, size_bytes
from recognition.cli._signals import stop_on_signal
from recognition.errors import RecordingError, SourceError
from recognition.live import Entry
from recognition.recording import check_recording, iter_messages, read_metadata, recording_files
from recognition.status import LiveStatus
from recognition.synthetic import semicircle_rig
from rigcal.errors import OptionError, OptionsError, RigcalError
from rigcal.rigfile import document_of_rig, write_rigfile

START_NS = 1_775_986_200_000_000_000
SIZE_WH = (128, 96)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Two cameras, and half a second of a still scene at 20 frames a second."""
    folder = tmp_path_factory.mktemp("site")
    made = semicircle_rig(2, size_wh=SIZE_WH)
    document = document_of_rig(made, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(document, folder / "s.rig.json")
    image = cv2.imencode(".jpg", np.full((SIZE_WH[1], SIZE_WH[0], 3), 90, np.uint8))[1].tobytes()
    for camera in ("cam0", "cam1"):
        for number in range(10):
            path = folder / "capture" / camera / f"{START_NS + number * 50_000_000}.jpg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(image)
    return folder


def command(*arguments):
    done = CliRunner().invoke(app, ["run", *map(str, arguments)], catch_exceptions=True)
    if isinstance(done.exception, RigcalError):
        raise done.exception
    return done


def test_a_capture_runs_at_its_own_pace_and_is_recorded_whole(site, tmp_path):
    done = command(
        site / "s.rig.json", "--source", site / "capture", "--realtime", "-o", tmp_path / "r.mcap", "--json",
        "--poses", tmp_path / "p.npz",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["messages"]["/cam0/image"] == told["messages"]["/cam1/image"] == 10
    live = told["live"]
    assert [one["recorded"] for one in live["cameras"]] == [10, 10]
    assert live["sets"] == live["looked_at"] + live["skipped"] > 0
    assert sum(told["monitoring"].values()) == told["instants"]
    assert told["monitoring_s"]["MONITORED"] > 0
    assert told["unmonitored"] is None
    assert told["rule"] == {"instants": "file times", "pace": "realtime"}
    assert (tmp_path / "p.npz").exists()
    assert check_recording(tmp_path / "r.mcap").ok
    metadata = read_metadata(tmp_path / "r.mcap")
    assert (metadata["association"], metadata["views"]) == ("tracked", "cam0,cam1")


def test_segments_and_the_papers_method_are_chosen_on_the_command_line(site, tmp_path):
    done = command(
        site / "s.rig.json", "--source", site / "capture", "--realtime", "-o", tmp_path / "r.mcap",
        "--association", "paper", "--segment", "90s", "--max-disk", "1GB", "--keep", "newest",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert [path.name for path in recording_files(tmp_path / "r.mcap")] == ["r.000.mcap"]
    assert "cam0: 10 of 10 frames recorded" in done.stdout
    assert read_metadata(tmp_path / "r.000.mcap")["association"] == "paper"


@pytest.mark.parametrize("pace", [(), ("--realtime",)])
def test_a_run_that_monitored_nothing_fails_and_says_why(site, tmp_path, pace):
    done = command(
        site / "s.rig.json", "--source", site / "capture", "--views", "cam0", *pace, "-o", tmp_path / "r.mcap"
    )
    assert done.exit_code == 1
    reason = "1 of 1 cameras" if pace else "two cameras took part in no instant"
    assert f"NOTHING WAS MONITORED: {reason}" in done.stdout.splitlines()
    assert ", 0 of them in 3D (" in done.stdout
    assert check_recording(tmp_path / "r.mcap").ok
    if pace:
        assert "error: NOT MONITORED: 1 of 1 cameras" in done.stderr.splitlines()
        said = [message.message.message for message in iter_messages(tmp_path / "r.mcap", ["/log"])]
        assert "NOT MONITORED: 1 of 1 cameras" in said


def test_a_run_that_was_not_recorded_to_its_end_fails_and_says_why(site, tmp_path):
    done = command(
        site / "s.rig.json", "--source", site / "capture", "--max-disk", "0.001MB", "--keep", "oldest",
        "-o", tmp_path / "r.mcap",
    )  # fmt: skip
    assert done.exit_code == 3, done.output
    assert "NOT RECORDED TO THE END: its 0.001 MB are used up" in done.stdout
    assert check_recording(tmp_path / "r.mcap").ok


LIVE = ("--source", "rtsp://127.0.0.1:1/a", "--source", "rtsp://127.0.0.1:1/b")


def test_what_would_fail_at_the_end_is_refused_at_the_start(site, tmp_path):
    with pytest.raises(RecordingError, match="a folder has the name that the recording is to have"):
        command(site / "s.rig.json", "--source", site / "capture", "-o", tmp_path)
    (tmp_path / "r.mcap").write_bytes(b"of yesterday")
    with pytest.raises(RecordingError) as caught:
        command(site / "s.rig.json", *LIVE, "-o", tmp_path / "r.mcap")
    assert str(caught.value) == (
        "a recording of this name is there already\n"
        f"  where:    {tmp_path / 'r.mcap'}\n"
        "  expected: no such file, as what live cameras showed cannot be recorded again\n"
        "  got:      0.0 MB\n"
        "  do next:  give another name with -o, or move it away: nothing is overwritten"
    )
    assert (tmp_path / "r.mcap").read_bytes() == b"of yesterday"
    with pytest.raises(OptionsError, match="add --segment 10min"):
        command(site / "s.rig.json", *LIVE, "-o", tmp_path / "s.mcap", "--keep", "newest")


@pytest.mark.parametrize("is_terminal", [True, False])
def test_nobody_has_to_listen(monkeypatch, is_terminal):
    """A log file on a full disk, a reader that went away or a terminal that was closed ends no run."""

    class Terminal(io.StringIO):
        is_gone = False

        def isatty(self):
            return is_terminal

        def write(self, text):
            if self.is_gone:
                raise OSError(errno.EIO, "Input/output error")
            return super().write(text)

    class Feed:
        status = LiveStatus(0.0, (), 0, 0, 0, 0, 0.0, None, None, 0)

    terminal, feed = Terminal(), Feed()
    monkeypatch.setattr("sys.stderr", terminal)
    with _show.live_status(feed):
        feed.announce(Entry(0, "error", "NOT MONITORED: 0 of 2 cameras"))
        assert "error: NOT MONITORED: 0 of 2 cameras" in terminal.getvalue()
        terminal.is_gone = True
        feed.announce(Entry(1, "warning", "monitored from here on"))
    assert "monitored from here on" not in terminal.getvalue()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--source", "rtsp://a/1"), "the sources do not suit the rig"),
        (("--source", "http://a/1", "--source", "http://b/1"), "not the address of a live camera"),
        (
            ("--source", "rtsp://a/1", "--source", "rtsp://b/1", "--detections", "d.npz"),
            "a file cannot say what live cameras will see",
        ),
    ],
)
def test_live_sources_that_cannot_be_used_are_refused(site, tmp_path, arguments, words):
    with pytest.raises(SourceError, match=words):
        command(site / "s.rig.json", *arguments, "-o", tmp_path / "r.mcap")
    assert not list(tmp_path.iterdir())


def test_times_and_sizes_have_units():
    assert [seconds("--segment", text) for text in ("90s", "10min", "1.5 h")] == [90.0, 600.0, 5400.0]
    assert [size_bytes("--max-disk", text) for text in ("500MB", "200GB", "1.5TB")] == [5e8, 2e11, 1.5e12]
    for text in ("10", "min", "-1s", "0s", "10 GB"):
        with pytest.raises(OptionError, match="such as 90s, 10min or 1h"):
            seconds("--segment", text)
    with pytest.raises(OptionError, match="such as 500MB"):
        size_bytes("--max-disk", "10 min")


@pytest.mark.parametrize(
    ("number", "who"),
    [
        (signal.SIGINT, "the keyboard"),
        (signal.SIGTERM, "the system (SIGTERM)"),
        (signal.SIGHUP, "the end of its terminal (SIGHUP)"),
    ],
)
def test_signals_are_noted_and_their_handlers_restored(number, who):
    before = signal.signal(number, signal.default_int_handler)  # the tests may run where a signal is ignored
    noted = threading.Event()
    try:
        with stop_on_signal() as stop:
            assert not stop()
            os.kill(os.getpid(), number)
            noted.wait(0.01)
            assert stop()
            assert stop.by == who
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)


def test_a_run_that_is_to_outlive_its_terminal_does():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup leaves it
    try:
        with stop_on_signal() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
