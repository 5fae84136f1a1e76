"""Detections come back from a recording to the last bit, and any reader of MCAP can decode them."""

from __future__ import annotations

import struct
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from test_recording_write import IMAGE, T0, recorder, stock_messages

from recognition.observations import FrameSet, ViewDetections, ViewFrame
from recognition.recording import RecordedView, check_recording, iter_detections
from recognition.recording.detections import detections_message, recorded_view
from recognition.recording.rotation import Rotation

FIELDS = ("people_px", "people_score", "object_xyxy", "object_score", "object_keypoints_px")
ODD = np.array([np.nan, -0.0, 5e-324, 0.1 + 0.2, -np.inf, 1.7976931348623157e308, 2**53 + 1.0, 1 / 3])


def seen(seed: int, people: int = 2, objects: int = 3) -> ViewDetections:
    """Random detections, with numbers that text or 32 bits would change."""
    random = np.random.default_rng(seed)
    px = random.uniform(0, 1920, (people, 17, 2))
    px.reshape(-1)[: ODD.size] = ODD[: px.size]
    keypoints = np.where(random.uniform(size=(objects, 4, 2)) < 0.5, np.nan, random.uniform(0, 1080, (objects, 4, 2)))
    return ViewDetections(
        px,
        random.uniform(size=(people, 17)),
        tuple(random.choice(["hard_hat", "Leiter", "梯子"], objects).tolist()),
        random.uniform(-5, 1920, (objects, 4)),
        random.uniform(size=objects),
        keypoints,
    )


def assert_same_bits(one: ViewDetections, other: ViewDetections):
    assert one.object_class == other.object_class
    for name in FIELDS:
        assert getattr(one, name).shape == getattr(other, name).shape
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def view(**changed) -> RecordedView:
    both = seen(1)
    fields = {"camera_id": "cam0", "index": 7, "instant_ns": T0, "views": 2, "t_ns": T0 + 1, "frame_idx": 12}
    return RecordedView(**{**fields, "seen": both, "common": both, "interpolated": False, **changed})


@pytest.mark.parametrize(("people", "objects"), [(2, 3), (0, 3), (4, 0), (0, 0)])
def test_every_number_comes_back_to_the_last_bit(people, objects):
    recorded = view(seen=seen(2, people, objects), common=seen(3, people, objects), interpolated=True)
    read = recorded_view(detections_message(recorded).SerializeToString())
    assert_same_bits(read.seen, recorded.seen)
    assert_same_bits(read.common, recorded.common)
    assert (read.camera_id, read.index, read.instant_ns, read.views) == ("cam0", 7, T0, 2)
    assert (read.t_ns, read.frame_idx, read.interpolated) == (T0 + 1, 12, True)


def test_hints_come_back_and_old_recordings_have_none():
    recorded = view(seen=replace(seen(2, 4), hints=np.array([1, 3])))
    read = recorded_view(detections_message(recorded).SerializeToString())
    assert read.seen.hints.tolist() == [1, 3]
    assert read.seen.counted.tolist() == [0, 2]
    message = detections_message(recorded)
    message.seen.ClearField("hints")
    assert recorded_view(message.SerializeToString()).seen.hints.tolist() == []


@pytest.mark.parametrize("hints", [[2], [-1], [0, 0]])
def test_a_hint_must_be_one_of_the_people(hints):
    with pytest.raises(ValueError, match=r"hints: expected some of the 2 people, each once, got \["):
        replace(seen(1, 2), hints=np.array(hints))


def test_what_is_not_known_is_absent_and_not_zero():
    read = recorded_view(detections_message(view(t_ns=None, frame_idx=None)).SerializeToString())
    assert (read.t_ns, read.frame_idx) == (None, None)
    read = recorded_view(detections_message(view(t_ns=0, frame_idx=0)).SerializeToString())
    assert (read.t_ns, read.frame_idx) == (0, 0)
    assert read.common is read.seen


def test_arrays_are_laid_out_as_they_are_read_back():
    """Sums depend on the order in which memory is walked, so that a transposed array may differ in the last bit."""
    both = seen(4)
    turned = {name: np.asfortranarray(getattr(both, name)) for name in FIELDS}
    made = ViewDetections(object_class=both.object_class, **turned)
    assert all(getattr(made, name).flags.c_contiguous for name in FIELDS)


def test_messages_that_do_not_fit_together_are_refused():
    message = detections_message(view())
    message.seen.people_score.append(0.5)
    with pytest.raises(ValueError, match="reshape"):
        recorded_view(message.SerializeToString())
    with pytest.raises(ValueError, match=r"no recognition\.Detections"):
        recorded_view(b"\xff")


def frame_set(index: int, own_ns: tuple[int | None, ...]) -> FrameSet:
    frames = tuple(None if t_ns is None else ViewFrame(index + 3, t_ns, IMAGE) for t_ns in own_ns)
    return FrameSet(index, T0 + index * 40_000_000, frames)


def test_any_reader_decodes_them_by_the_schema_in_the_file(tmp_path):
    path = tmp_path / "run.mcap"
    views = [seen(1), seen(2)]
    with recorder(path) as writing:
        writing.write_detections(frame_set(5, (T0 + 9, None)), [views[0], None], common=[views[1], None])
    ((record, message),) = stock_messages(path)["/cam0/detections"]
    assert message.DESCRIPTOR.full_name == "recognition.Detections"
    assert struct.pack("<68d", *message.seen.people_px) == views[0].people_px.tobytes()
    assert struct.pack("<68d", *message.common.people_px) == views[1].people_px.tobytes()
    assert list(message.seen.object_class) == list(views[0].object_class)
    assert (message.frame_id, message.instant, message.views, message.frame_number) == ("cam0", 5, 1, 8)
    assert (message.timestamp.ToNanoseconds(), record.publish_time) == (T0 + 9, T0 + 9)
    assert message.instant_time.ToNanoseconds() == T0 + 5 * 40_000_000
    assert "/cam1/detections" not in stock_messages(path)


def test_the_views_of_an_instant_stand_together_in_the_order_of_recording(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        for k in (0, 1, 2):
            own_ns = (T0 + k * 40_000_000 + 5, T0 + k * 40_000_000 - 5)
            writing.write_detections(frame_set(k, own_ns), [seen(2 * k), seen(2 * k + 1)])
    read = list(iter_detections(path))
    assert [(r.index, r.camera_id, r.views) for r in read] == [(k, f"cam{v}", 2) for k in range(3) for v in range(2)]
    for k, recorded in enumerate(read):
        assert_same_bits(recorded.seen, seen(k))
        assert recorded.common is recorded.seen
        assert not recorded.interpolated
    assert check_recording(path).findings == ()


def test_an_instant_that_lost_a_camera_is_a_warning(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        writing.write_detections(frame_set(0, (T0, T0)), [seen(1), seen(2)])
        rotation: Rotation = writing._rotation
        whole = rotation._put
        rotation._put = lambda items: whole(items[:2])  # the second camera's messages are lost
        writing.write_detections(frame_set(1, (T0 + 40_000_000,) * 2), [seen(1), seen(2)])
    check = check_recording(path)
    assert check.ok
    assert [f.text for f in check.findings] == ["1 instants lost the detections of a camera: a replay leaves them out"]


def test_the_detections_of_a_frame_set_cost_less_than_a_millisecond():
    """Four views of 4 workers and 14 objects; the best of ten, for the machine may be busy."""
    views = [view(seen=(both := seen(v, 4, 14)), common=both) for v in range(4)]
    took_s = []
    for _ in range(10):
        start = time.thread_time()
        for one in views:
            detections_message(one).SerializeToString()
        took_s.append(time.thread_time() - start)
    assert min(took_s) < 1e-3
