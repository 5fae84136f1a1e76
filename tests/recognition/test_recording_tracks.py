"""``/tracks``: what was judged comes back to the last bit, and what is damaged is refused."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from test_recording_write import T0, recorder, stock_messages

from recognition.errors import RecordingError
from recognition.observations import FrameSet, ObjectTrack, Scene, ViewDetections, WorkerTrack
from recognition.recording import TRACKS, TrackedInstant, check_recording, holds_tracks, iter_tracks
from recognition.recording.tracks import tracked_instant, tracks_message

VIEWS = 3


def worker(track_id: int, seed: int) -> WorkerTrack:
    rng = np.random.default_rng(seed)
    joints = rng.normal(size=(17, 3)) * 10.0 ** rng.integers(-300, 300, size=(17, 3))
    joints[4] = np.nan
    joints[5] = -0.0, 0.0, 5e-324
    return WorkerTrack(track_id, joints, rng.integers(0, 9, size=17), rng.integers(-1, 4, size=VIEWS))


def thing(track_id: int, name: str, seed: int) -> ObjectTrack:
    rng = np.random.default_rng(seed)
    keypoints = rng.normal(size=(4, 3)) if seed % 2 else np.full((4, 3), np.nan)
    size = (0.1 + 0.2, 1 / 3) if seed % 2 else (float("nan"), float("nan"))
    return ObjectTrack(
        track_id, name, rng.normal(size=3), 2, rng.integers(-1, 4, size=VIEWS), keypoints_m=keypoints, size_m=size
    )


def instant(workers=(), objects=(), *, is_placed=True, status="DEGRADED", reason="2 of 3 cameras", cameras=2):
    said = status if is_placed else "NOT MONITORED"
    scene = Scene(7, T0, tuple(workers), tuple(objects), said, reason, cameras)
    return TrackedInstant(scene, is_placed, status)


def same(one: TrackedInstant, other: TrackedInstant) -> bool:
    """Every field but covariances; arrays by type, shape and bytes."""

    def fields(track):
        values = {name: getattr(track, name) for name in type(track).__slots__ if "covariance" not in name}
        return {n: (v.dtype, v.shape, v.tobytes()) if isinstance(v, np.ndarray) else repr(v) for n, v in values.items()}

    def all_of(given):
        scene = given.scene
        rest = (scene.index, scene.t_ns, scene.status, scene.reason, scene.cameras, given.is_placed, given.status)
        return [*map(fields, (*scene.workers, *scene.objects)), rest]

    return all_of(one) == all_of(other)


@pytest.mark.parametrize(
    "told",
    [
        instant(),
        instant([worker(3, 1)]),
        instant(objects=[thing(2**40, "ladder", 2)]),
        instant(
            [worker(1, 3), worker(12, 4)], [thing(1, "ladder", 5), thing(2, "hard_hat", 6), thing(9, "échelle", 7)]
        ),
        instant(is_placed=False, status="MONITORED", reason="", cameras=None),
        instant(is_placed=False, status="NOT MONITORED", reason="0 of 3 cameras", cameras=0),
    ],
)
def test_what_was_judged_comes_back_to_the_last_bit(told):
    again = tracked_instant(tracks_message(told).SerializeToString())
    assert same(told, again)
    for track in (*again.scene.workers, *again.scene.objects):
        assert np.isnan(track.covariance_m2).all()
        assert not any(getattr(track, name).flags.writeable for name in ("members", "covariance_m2"))


def test_messages_that_do_not_fit_together_are_refused():
    message = tracks_message(instant([worker(1, 1)], [thing(2, "ladder", 1)]))
    for change in (
        lambda m: m.workers.joints_m.append(1.0),
        lambda m: m.workers.track_id.append(4),
        lambda m: m.workers.views.pop(),
        lambda m: m.objects.views.pop(),
        lambda m: m.objects.object_class.append("ladder"),
        lambda m: m.objects.size_m.pop(),
        lambda m: setattr(m, "status", "FINE"),
    ):
        damaged = type(message).FromString(message.SerializeToString())
        change(damaged)
        with pytest.raises(ValueError):  # noqa: PT011  # numpy's own words
            tracked_instant(damaged.SerializeToString())
    with pytest.raises(ValueError, match=r"no recognition\.Tracks"):
        tracked_instant(b"\xff\xff\xff")


@pytest.fixture
def recording(tmp_path):
    """Twenty instants, and their detections."""
    path = tmp_path / "r.mcap"
    with recorder(path) as writer:
        for k in range(20):
            t_ns = T0 + k * 100_000_000
            seen = (ViewDetections.empty(),) * 2
            writer.write_detections(FrameSet(k, t_ns, (None,) * 2), seen)
            scene = Scene(k, t_ns, (worker(1, k),), (thing(1, "ladder", k),))
            writer.write_tracks(TrackedInstant(scene, True, "MONITORED"))
    return path


def test_they_come_in_order_with_their_numbers_and_any_reader_decodes_them(recording):
    found = list(iter_tracks(recording))
    assert [(number, told.scene.index) for number, told in found] == [(k, k) for k in range(20)]
    assert holds_tracks([recording])
    check = check_recording(recording)
    assert check.ok, check.findings
    assert check.messages[TRACKS] == 20
    _, first = stock_messages(recording)[TRACKS][0]
    assert list(first.workers.track_id) == [1]
    assert first.objects.object_class[0] == "ladder"


def test_a_file_that_holds_detections_without_tracks_does_not_count(recording, tmp_path):
    with recorder(tmp_path / "d.mcap") as writer:
        writer.write_detections(FrameSet(0, T0, (None,) * 2), (ViewDetections.empty(),) * 2)
    with recorder(tmp_path / "l.mcap") as writer:
        writer.log("info", "nothing", T0)
    assert not holds_tracks([tmp_path / "d.mcap"])
    assert not holds_tracks([tmp_path / "l.mcap"])
    assert not holds_tracks([recording, tmp_path / "d.mcap"])
    assert holds_tracks([recording, tmp_path / "l.mcap"])


def test_what_is_cut_or_changed_is_refused_in_words(recording, tmp_path):
    whole = recording.read_bytes()
    broken = tmp_path / "b.mcap"
    data_end = whole.rindex(b"\x0f" + struct.pack("<Q", 4))
    for cut in (0, 5, *range(8, data_end, 997), data_end):
        broken.write_bytes(whole[:cut])
        with pytest.raises(RecordingError, match=r"not an MCAP file|unfinished or damaged"):
            list(iter_tracks(broken))
    start = whole.index(b"\x06", whole.index(b"recognition"))
    chunk = next(n for n in range(start, len(whole)) if whole[n] == 6 and whole[n + 37 : n + 45] == b"\x04\0\0\0zstd")
    for place in (chunk + 60, chunk + 200):
        broken.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        with pytest.raises(RecordingError, match="a chunk is damaged"):
            list(iter_tracks(broken))
    broken.write_bytes(whole[:chunk] + b"\x7f" + whole[chunk + 1 :])
    with pytest.raises(RecordingError, match=f"no record begins at byte {chunk}"):
        list(iter_tracks(broken))
    broken.write_bytes(whole[:chunk] + struct.pack("<BQ", 6, 2**60) + whole[chunk + 9 :])
    with pytest.raises(RecordingError, match=f"no record begins at byte {chunk}"):
        list(iter_tracks(broken))
