"""A disk that fills up: what gives way is what was said, everything is told, and what was recorded is whole."""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Chunk

sys.path.insert(0, str(Path(__file__).parent))
from test_recording_write import IMAGE, T0, recorder

from recognition.errors import NoRoomError, RecordingError
from recognition.observations import FrameSet, ViewFrame
from recognition.recording import DiskBudget, check_recording, check_sequence, iter_messages, recover_recording
from recognition.recording import budget as budget_module
from recognition.recording import rotation as rotation_module
from recognition.recording.budget import RESERVE_BYTES, require_room
from recognition.recording.completion import complete
from recognition.recording.container import mapped
from recognition.recording.scan import Placed, scan
from rigcal.errors import OptionError

GB = 1_000_000_000
PERIOD_NS = 40_000_000
FRAME_BYTES = 20_000


def image(k: int) -> bytes:
    return np.random.default_rng(k).integers(0, 256, FRAME_BYTES, dtype=np.uint8).tobytes()


def write(writing, first: int, count: int) -> None:
    for k in range(first, first + count):
        t_ns = T0 + k * PERIOD_NS
        writing.write_frames(FrameSet(k, t_ns, (ViewFrame(k, t_ns, IMAGE, image(k), "jpeg"), None)))


def lines(files) -> list[str]:
    return [m.message.message for file in files for m in iter_messages(file, ["/log"])]


@pytest.fixture
def watchful(monkeypatch):
    """The disk is looked at with every call, and chunks reach the file with every frame."""
    monkeypatch.setattr(rotation_module, "LOOK_S", 0.0)
    monkeypatch.setattr("recognition.recording.container.CHUNK_BYTES", FRAME_BYTES // 2)


def test_the_newest_segments_are_kept_and_the_oldest_are_deleted(tmp_path, watchful):
    budget = DiskBudget(max_bytes=600_000, keep="newest")
    with recorder(tmp_path / "run.mcap", segment_s=0.2, budget=budget) as writing:
        write(writing, 0, 100)
    done = writing.close()
    assert done.stopped is None
    assert done.unrecorded == {}
    assert done.messages["/cam0/image"] == 100
    there = sorted(tmp_path.iterdir())
    assert there == list(done.files)
    assert [path.name for path in (*done.dropped, *done.files)] == [f"run.{k:03d}.mcap" for k in range(20)]
    assert done.bytes == sum(path.stat().st_size for path in there) <= 600_000 + 5 * FRAME_BYTES
    check = check_sequence(done.files)
    assert check.ok
    assert [f.text for f in check.findings] == [f"the first {len(done.dropped)} segments of the run are not there"]
    last = done.dropped[-1].name
    assert f"segment {last} was deleted, as the newest are to be kept: its 0.6 MB are used up" in lines(done.files)


@pytest.mark.parametrize("segment_s", [None, 0.2])
def test_the_oldest_are_kept_and_recording_ends_whole_while_the_run_goes_on(tmp_path, watchful, segment_s):
    budget = DiskBudget(max_bytes=600_000, keep="oldest")
    with recorder(tmp_path / "run.mcap", segment_s=segment_s, budget=budget) as writing:
        write(writing, 0, 20)
        assert writing.stopped is None
        write(writing, 20, 80)
        assert writing.stopped == "its 0.6 MB are used up"
    done = writing.close()
    assert done.stopped == "its 0.6 MB are used up"
    assert done.dropped == ()
    kept = done.messages["/cam0/image"]
    assert 25 <= kept <= 31
    assert done.unrecorded == {"/cam0/image": 100 - kept}
    check = check_sequence(done.files)
    assert (check.ok, check.findings) == (True, ())
    assert lines(done.files) == ["recording ends here and recognition goes on: its 0.6 MB are used up"]
    assert sorted(tmp_path.iterdir()) == list(done.files)


def test_room_is_left_for_the_rest_of_the_system(tmp_path, watchful, monkeypatch):
    free = iter([GB, GB, GB, RESERVE_BYTES - 1])
    monkeypatch.setattr(budget_module, "free_on_disk", lambda _path: next(free))
    monkeypatch.setattr(rotation_module, "free_on_disk", lambda _path: next(free))
    with recorder(tmp_path / "run.mcap") as writing:
        write(writing, 0, 10)
    done = writing.close()
    assert done.stopped == "the disk has 0.256 GB left, and 0.256 GB are kept free"
    assert done.messages["/cam0/image"] == 3
    assert check_recording(done.path).ok


def test_the_disk_is_asked_after_so_many_bytes_and_not_with_every_frame(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(rotation_module, "free_on_disk", lambda _path: asked.append(len(asked)) or GB)
    monkeypatch.setattr(rotation_module, "LOOK_S", 1e9)
    monkeypatch.setattr(rotation_module, "LOOK_BYTES", 5 * FRAME_BYTES)
    with recorder(tmp_path / "run.mcap") as writing:
        looks = [write(writing, k, 1) or len(asked) for k in range(20)]
    assert looks == [1] * 5 + [2] * 5 + [3] * 5 + [4] * 5


def test_newest_without_a_finished_segment_ends_like_oldest(tmp_path, watchful):
    budget = DiskBudget(max_bytes=300_000, keep="newest")
    with recorder(tmp_path / "run.mcap", segment_s=100, budget=budget) as writing:
        write(writing, 0, 50)
    assert writing.close().stopped == "its 0.3 MB are used up"
    assert check_sequence(writing.close().files).ok


def test_the_start_is_refused_where_there_is_no_room(tmp_path, monkeypatch):
    monkeypatch.setattr(budget_module, "free_on_disk", lambda _path: RESERVE_BYTES)
    with pytest.raises(NoRoomError) as caught:
        recorder(tmp_path / "run.mcap")
    assert str(caught.value) == (
        "the disk has no room for a recording\n"
        f"  where:    {tmp_path}\n"
        "  expected: more than 0.256 GB free\n"
        "  got:      0.256 GB free, of which 0 MB may be recorded\n"
        "  do next:  free some space, or record to another disk with -o"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_known_not_to_fit_needs_a_policy(tmp_path, monkeypatch):
    monkeypatch.setattr(budget_module, "free_on_disk", lambda _path: 8 * GB)
    path = tmp_path / "run.mcap"
    with pytest.raises(NoRoomError) as caught:
        recorder(path, expected_bytes=10 * GB)
    assert str(caught.value) == (
        "the recording will not fit\n"
        f"  where:    {tmp_path}\n"
        "  expected: room for about 10 GB\n"
        "  got:      8 GB free, of which 7.74 GB may be recorded\n"
        "  do next:  free some space, or say what gives way: --keep newest with --segment, or --keep oldest"
    )
    assert require_room(path, DiskBudget(), 7 * GB) is None
    assert require_room(path, DiskBudget(max_bytes=5 * GB), None) is None
    assert require_room(path, DiskBudget(max_bytes=5 * GB, keep="newest"), 10 * GB) == (
        "the run takes about 10 GB and may take 5 GB: from there on, the oldest segments are deleted"
    )
    with recorder(path, expected_bytes=10 * GB, budget=DiskBudget(keep="oldest")) as writing:
        assert writing.notices == (
            "the run takes about 10 GB and may take 7.74 GB: from there on, recording ends and recognition goes on",
        )
    with pytest.raises(OptionError, match="max_bytes is out of range"):
        DiskBudget(max_bytes=0)


@contextlib.contextmanager
def largest_file(size: int):
    """The system refuses to let any file grow beyond ``size``: a real refusal, and of any byte."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("size", [200_000, 200_017, 215_551, 231_003])
def test_a_disk_that_refuses_in_the_middle_leaves_a_sound_recording(tmp_path, watchful, size):
    path = tmp_path / "run.mcap"
    with largest_file(size):
        with recorder(path) as writing:
            write(writing, 0, 50)
        done = writing.close()
    assert done.stopped == "the disk refused: File too large"
    assert done.files == (path,)
    assert list(tmp_path.iterdir()) == [path]
    check = check_recording(path)
    assert check.ok, check.findings
    assert 8 <= check.messages["/cam0/image"] <= 50 - done.unrecorded["/cam0/image"]
    assert check.bytes == done.bytes <= size


def test_an_index_that_has_no_room_takes_the_place_of_the_last_chunks(tmp_path, watchful):
    path, part = tmp_path / "run.mcap", tmp_path / "run.mcap.part"
    with recorder(path) as writing:
        write(writing, 0, 10)
    with mapped(path) as data:
        chunks = [p.end for p in scan(data) if isinstance(p, Placed) and isinstance(p.record, Chunk)]
    part.write_bytes(path.read_bytes()[: chunks[-1] + 200])
    path.unlink()
    with largest_file(chunks[-1] + 200):
        complete(part, path)
    check = check_recording(path)
    assert check.ok
    assert 0 < check.messages["/cam0/image"] < 10


def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path, monkeypatch):
    def no_room(_handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "run.mcap"
    with recorder(path, fsync_interval_s=0.02) as writing:
        write(writing, 0, 3)
        time.sleep(0.05)
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", no_room)
            write(writing, 3, 3)
            time.sleep(0.1)
            write(writing, 6, 3)
            assert writing.stopped == "the disk refused: No space left on device"
    done = writing.close()
    assert done.stopped == "the disk refused: No space left on device"
    assert 1 <= done.unrecorded["/cam0/image"] <= 6
    check = check_recording(path)
    assert check.ok
    assert check.messages["/cam0/image"] >= 3


def test_a_recording_that_cannot_even_be_finished_names_the_command(tmp_path, monkeypatch):
    def no_room(_handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "run.mcap"
    part = path.with_name("run.mcap.part")
    with recorder(path, fsync_interval_s=0.02) as writing:
        for k in range(4):
            write(writing, k, 1)
            time.sleep(0.05)
        monkeypatch.setattr(os, "fsync", no_room)
    done = writing.close()
    assert done.files == ()
    assert done.stopped == (
        f"the disk refused: No space left on device; to save what it took, run `recognition recover {part} -o {path}`"
    )
    monkeypatch.undo()
    assert recover_recording(part, path).messages["/cam0/image"] >= 1


def test_whatever_the_disk_took_is_made_whole_where_it_lies(tmp_path, watchful):
    """A sound file cut anywhere: the cut tail is given up, and everything before it stays as it was."""
    with recorder(tmp_path / "whole.mcap") as writing:
        write(writing, 0, 8)
    whole, random = (tmp_path / "whole.mcap").read_bytes(), np.random.default_rng(3)
    everything = [m.message.SerializeToString() for m in iter_messages(tmp_path / "whole.mcap")]
    least = 0
    for size in sorted({len(whole) - 9, *random.integers(6_000, len(whole), 30).tolist()}):
        part, path = tmp_path / "run.mcap.part", tmp_path / "run.mcap"
        part.write_bytes(whole[:size])
        assert complete(part, path) == path.stat().st_size
        found = check_recording(path)
        assert [f for f in found.findings if "index" in f.text or "damaged" in f.text or "end" in f.text] == []
        kept = list(iter_messages(path))
        assert [m.message.SerializeToString() for m in kept] == everything[: len(kept)]
        assert len(kept) >= least
        least = len(kept)
    assert least == len(everything)


def test_another_fault_of_the_disk_is_raised_at_the_next_call_and_ever_after(tmp_path, monkeypatch):
    def broken(_handle):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    path = tmp_path / "run.mcap"
    writing = recorder(path, fsync_interval_s=0.02)
    monkeypatch.setattr(os, "fsync", broken)
    with contextlib.suppress(RecordingError):  # where the disk was asked before this call
        writing.log("info", "x", T0)
    time.sleep(0.2)
    for call in (lambda: writing.log("info", "y", T0 + 1), writing.close, writing.close):
        with pytest.raises(RecordingError, match="cannot write the recording") as caught:
            call()
        assert caught.value.got == "Input/output error"
    assert path.with_name("run.mcap.part").exists()
    assert not path.exists()
