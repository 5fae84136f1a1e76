"""The --detections file: what is written is read, and every bad form is refused with a message."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recognition.errors import DetectionsFileError
from recognition.observations import ViewDetections
from recognition.sources.detections_file import read_detections, write_detections
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, observe, with_noise

RIG = semicircle_rig(4)
CAPTURE = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "recognition" / "pose2sim_multi"
DO_NEXT = (
    "write the arrays det_frame, det_view, det_kpts (and obj_frame, obj_view, obj_class, obj_xyxy, obj_score, "
    "frame_time_s where there are any) as recognition/README.md describes them"
)


def people_arrays(count=3):
    return {
        "det_frame": np.arange(count, dtype=np.int32),
        "det_view": np.zeros(count, dtype=np.int16),
        "det_kpts": np.full((count, 17, 3), 0.5, dtype=np.float32),
    }


def object_arrays(count=2):
    return {
        "obj_frame": np.arange(count, dtype=np.int32),
        "obj_view": np.ones(count, dtype=np.int16),
        "obj_class": np.array(["bucket"] * count),
        "obj_xyxy": np.tile(np.float32([1, 2, 3, 4]), (count, 1)),
        "obj_score": np.full(count, 0.5, dtype=np.float32),
    }


def write(path, **arrays):
    np.savez(path, **arrays)
    return path


def message(path):
    with pytest.raises(DetectionsFileError) as caught:
        read_detections(path, RIG)
    return str(caught.value)


def expected_message(path, what, expected, got):
    return (
        f"detections file: {what}\n  where:    {path}\n  expected: {expected}\n  got:      {got}\n  do next:  {DO_NEXT}"
    )


def assert_same_views(got: ViewDetections, want: ViewDetections):
    known = np.isfinite(want.people_px).all(axis=-1)
    np.testing.assert_allclose(got.people_px[known], want.people_px[known], rtol=1e-6)
    assert np.isnan(got.people_px[~known]).all()
    np.testing.assert_allclose(got.people_score, want.people_score, rtol=1e-6)
    assert got.object_class == want.object_class
    np.testing.assert_allclose(got.object_xyxy, want.object_xyxy, rtol=1e-6)
    np.testing.assert_allclose(got.object_score, want.object_score, rtol=1e-6)


def test_what_is_written_is_read(tmp_path):
    site = simulate(RIG, workers=3, frames=4, fps=10.0)
    noise = DetectorNoise(pixel_sigma=2.0, missing_joint=0.2, missed=0.3, false_per_view=0.5)
    frames = [
        [view.detections for view in with_noise(observe(site, frame), RIG, noise, seed=frame)] for frame in range(4)
    ]
    write_detections(tmp_path / "d.npz", frames, time_s=[0.0, 0.1, 0.2, 0.3])
    file = read_detections(tmp_path / "d.npz", RIG)
    assert file.frames == range(4)
    assert file.time_s.tolist() == [[t] * 4 for t in (0.0, 0.1, 0.2, 0.3)]
    assert not file.has_own_times
    assert not file.time_s.flags.writeable
    for number in file.frames:
        for got, want in zip(file.views(number), frames[number], strict=True):
            assert_same_views(got, want)


def test_hints_are_not_written(tmp_path):
    (view,) = observe(simulate(RIG, workers=3, frames=1), 0)[:1]
    frame = [replace(view.detections, hints=np.array([0, 2])), *[ViewDetections.empty()] * 3]
    write_detections(tmp_path / "d.npz", [frame])
    found = read_detections(tmp_path / "d.npz", RIG).views(0)[0]
    np.testing.assert_allclose(found.people_px, view.detections.people_px[1:2], rtol=1e-6)


def test_the_file_has_the_documented_arrays_and_types(tmp_path):
    views = [view.detections for view in observe(simulate(RIG, workers=2, frames=1), 0)]
    write_detections(tmp_path / "d.npz", [views])
    with np.load(tmp_path / "d.npz") as data:
        forms = {name: (str(data[name].dtype), data[name].shape[1:]) for name in data.files}
        not_detected = data["det_kpts"][..., 2] == 0
        assert (data["det_kpts"][not_detected] == 0).all()
    assert forms == {
        "det_frame": ("int32", ()),
        "det_view": ("int16", ()),
        "det_kpts": ("float32", (17, 3)),
        "obj_frame": ("int32", ()),
        "obj_view": ("int16", ()),
        "obj_class": (forms["obj_class"][0], ()),
        "obj_xyxy": ("float32", (4,)),
        "obj_score": ("float32", ()),
    }
    assert forms["obj_class"][0].startswith("<U")


def test_nothing_detected_can_be_written_and_read(tmp_path):
    write_detections(tmp_path / "d.npz", [[ViewDetections.empty()] * 4] * 3, time_s=[0.0, 0.1, 0.2])
    file = read_detections(tmp_path / "d.npz", RIG)
    assert file.frames == range(3)
    assert [len(view.people_px) for view in file.views(1)] == [0, 0, 0, 0]
    write_detections(tmp_path / "none.npz", [])
    assert read_detections(tmp_path / "none.npz", RIG).frames == range(0)


def test_without_times_the_frames_run_from_the_first_to_the_last_detection(tmp_path):
    arrays = people_arrays() | {"det_frame": np.array([305, 300, 303])}
    file = read_detections(write(tmp_path / "d.npz", **arrays), RIG)
    assert file.frames == range(300, 306)
    assert file.time_s is None
    assert [len(file.views(n)[0].people_px) for n in file.frames] == [1, 0, 0, 1, 0, 1]


def test_rows_may_be_in_any_order_and_keep_it_within_a_view(tmp_path):
    keypoints = np.ones((4, 17, 3), dtype=np.float32)
    keypoints[:, :, 0] = np.arange(4)[:, None]
    arrays = {"det_frame": np.array([1, 0, 1, 0]), "det_view": np.array([2, 3, 2, 0]), "det_kpts": keypoints}
    file = read_detections(write(tmp_path / "d.npz", **arrays), RIG)
    assert file.views(1)[2].people_px[:, 0, 0].tolist() == [0.0, 2.0]
    assert file.views(0)[3].people_px[:, 0, 0].tolist() == [1.0]
    assert file.views(0)[0].people_px[:, 0, 0].tolist() == [3.0]


def test_score_zero_means_not_detected(tmp_path):
    arrays = people_arrays(1)
    arrays["det_kpts"][0, 4] = [np.nan, 7.0, 0.0]
    view = read_detections(write(tmp_path / "d.npz", **arrays), RIG).views(0)[0]
    assert np.isnan(view.people_px[0, 4]).all()
    assert view.people_score[0, 4] == 0.0


def test_arrays_of_other_programs_are_left_alone(tmp_path):
    write(tmp_path / "d.npz", **people_arrays(), made_by=np.array("somebody"))
    assert read_detections(tmp_path / "d.npz", RIG).frames == range(3)


def test_a_missing_file_and_a_file_of_another_kind_are_named(tmp_path):
    missing = tmp_path / "missing.npz"
    assert message(missing) == expected_message(
        missing,
        "cannot read this file",
        "a .npz file of plain arrays",
        f"[Errno 2] No such file or directory: '{missing}'",
    )
    text = tmp_path / "text.npz"
    text.write_text("hello")
    assert "cannot read this file" in message(text)
    empty = tmp_path / "empty.npz"
    empty.write_bytes(b"")
    assert "cannot read this file" in message(empty)
    single = tmp_path / "single.npy"
    np.save(single, np.zeros((2, 3)))
    assert message(single) == expected_message(
        single, "this file is one array", "an archive of arrays (.npz)", "(2, 3)"
    )


def test_a_damaged_file_and_one_of_python_objects_are_refused(tmp_path):
    whole = write(tmp_path / "d.npz", **people_arrays())
    damaged = tmp_path / "damaged.npz"
    data = bytearray(whole.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged.write_bytes(data)
    assert "cannot read this file" in message(damaged)
    cut = tmp_path / "cut.npz"
    cut.write_bytes(whole.read_bytes()[:300])
    assert "cannot read this file" in message(cut)
    objects = write(tmp_path / "o.npz", **people_arrays(), **object_arrays() | {"obj_class": np.array([None, "a"])})
    assert "Object arrays cannot be loaded" in message(objects)


def test_missing_arrays_are_named(tmp_path):
    path = write(tmp_path / "d.npz", det_frame=np.arange(2))
    assert message(path) == expected_message(
        path, "no array det_view, det_kpts", "det_frame, det_view, det_kpts", "det_frame"
    )
    other = write(tmp_path / "other.npz", frames=np.arange(2))
    assert "got:      none of the documented arrays" in message(other)
    objects = object_arrays()
    del objects["obj_score"], objects["obj_class"]
    partly = write(tmp_path / "p.npz", **people_arrays(), **objects)
    assert message(partly) == expected_message(
        partly,
        "no array obj_class, obj_score",
        "all five arrays of objects, or none",
        "obj_frame, obj_view, obj_xyxy",
    )


BAD = [
    ("det_kpts", np.zeros((3, 17, 2)), "det_kpts has another shape", "(N, 17, 3)", "(3, 17, 2)"),
    ("det_frame", np.zeros((3, 1), dtype=int), "det_frame has another shape", "(N)", "(3, 1)"),
    ("det_frame", np.zeros(3), "det_frame has another type", "integers", "float64"),
    ("det_view", np.array(["a", "b", "c"]), "det_view has another type", "integers", "<U1"),
    (
        "det_frame",
        np.arange(2),
        "arrays that belong together differ in length",
        "one row for each detection",
        "det_frame 2, det_view 3, det_kpts 3",
    ),
    (
        "det_view",
        np.array([0, 4, 0]),
        "det_view has no such camera",
        "0 to 3, the cameras cam0, cam1, cam2, cam3 of the rig",
        "4 in row 1",
    ),
    (
        "det_view",
        np.array([0, 0, -1]),
        "det_view has no such camera",
        "0 to 3, the cameras cam0, cam1, cam2, cam3 of the rig",
        "-1 in row 2",
    ),
    ("det_frame", np.array([0, -2, 1]), "det_frame is negative", "0 or more", "-2 in row 1"),
    ("det_kpts", np.full((3, 17, 3), 1.5), "det_kpts[..., 2] has a score out of range", "0 to 1", "1.5"),
    ("det_kpts", np.full((3, 17, 3), np.nan), "det_kpts[..., 2] has a score out of range", "0 to 1", "nan"),
    (
        "det_kpts",
        np.where(np.arange(3) == 0, np.inf, 1.0) * np.ones((3, 17, 3)),
        "det_kpts has numbers that are not finite",
        "finite numbers",
        "51 that are not finite",
    ),
    ("obj_xyxy", np.zeros((2, 5)), "obj_xyxy has another shape", "(N, 4)", "(2, 5)"),
    ("obj_class", np.arange(2), "obj_class has another type", "text", "int64"),
    (
        "obj_score",
        np.ones(3),
        "arrays that belong together differ in length",
        "one row for each detection",
        "obj_frame 2, obj_view 2, obj_class 2, obj_xyxy 2, obj_score 3",
    ),
    (
        "obj_view",
        np.array([9, 0]),
        "obj_view has no such camera",
        "0 to 3, the cameras cam0, cam1, cam2, cam3 of the rig",
        "9 in row 0",
    ),
    ("obj_frame", np.array([0, -1]), "obj_frame is negative", "0 or more", "-1 in row 1"),
    ("obj_score", np.array([0.5, -0.5]), "obj_score has a score out of range", "0 to 1", "-0.5"),
    (
        "obj_xyxy",
        np.array([[1.0, 2, 3, 4], [np.nan, 0, 1, 1]]),
        "obj_xyxy has numbers that are not finite",
        "finite numbers",
        "1 that are not finite",
    ),
    (
        "obj_xyxy",
        np.array([[1.0, 2, 3, 4], [5, 0, 1, 1]]),
        "obj_xyxy has a box that ends before it begins",
        "left, top, right, bottom",
        "[5.0, 0.0, 1.0, 1.0] in row 1",
    ),
    (
        "frame_time_s",
        np.array([0.0, 0.1]),
        "frame_time_s does not cover every frame",
        "3 times or more, one for each frame from 0 to 2",
        "2",
    ),
    (
        "frame_time_s",
        np.array([0.0, 0.2, 0.1]),
        "frame_time_s does not ascend",
        "each time after the one before",
        "0.2 s, then 0.1 s at frame 2",
    ),
    (
        "frame_time_s",
        np.array([0.0, np.nan, 0.1]),
        "frame_time_s has numbers that are not finite",
        "finite numbers",
        "1 that are not finite",
    ),
    (
        "frame_time_s",
        np.zeros((3, 1)),
        "frame_time_s has another shape",
        "(N), or (N, 4) with a time for each camera",
        "(3, 1)",
    ),
    ("frame_time_s", np.array(["a", "b", "c"]), "frame_time_s has another type", "numbers", "<U1"),
    (
        "frame_time_s",
        np.array([[0.0, 0, 0, 0], [0.1, 0.1, np.nan, 0.1], [0.2, 0.05, 0.2, 0.2]]),
        "frame_time_s does not ascend",
        "each time after the one before",
        "0.1 s, then 0.05 s at frame 2",
    ),
    (
        "frame_time_s",
        np.array([[0.0, 0, 0, 0], [np.nan, 0.1, 0.1, 0.1], [0.2, 0.2, 0.2, 0.2]]),
        "det_view names a camera that has no time in its frame",
        "a time in frame_time_s for each detection's frame and view",
        "frame 1, view 0 in row 1",
    ),
]


@pytest.mark.parametrize(("name", "array", "what", "expected", "got"), BAD, ids=[f"{b[0]}: {b[2]}" for b in BAD])
def test_bad_arrays_are_refused_with_what_where_expected_and_got(tmp_path, name, array, what, expected, got):
    path = write(tmp_path / "d.npz", **people_arrays() | object_arrays() | {name: array})
    assert message(path) == expected_message(path, what, expected, got)


def test_each_camera_may_have_times_of_its_own(tmp_path):
    time_s = np.arange(3)[:, None] / 30 + np.array([0.0, 0.01, -0.005, 0.002])
    time_s[1, 1] = np.nan
    file = read_detections(write(tmp_path / "d.npz", **people_arrays(), frame_time_s=time_s), RIG)
    assert file.has_own_times
    assert file.times_ns(1, use=[True, True, True, False], fps=1.0) == (33_333_333, None, 28_333_333, None)


def test_detections_outside_the_instants_are_counted(tmp_path):
    file = read_detections(write(tmp_path / "d.npz", **people_arrays(5), **object_arrays(2)), RIG)
    seen = np.ones((4, 4), dtype=bool)
    assert file.outside(np.arange(4), seen) == 1  # the person in frame 4
    seen[1] = [False, True, True, True]
    assert file.outside(np.arange(4), seen) == 2  # and the one of cam0 in frame 1
    seen[:, 0] = False
    assert file.outside(np.arange(4), seen) == 0  # cam0 is left out altogether, cam1 has its two objects


def test_scores_a_rounding_above_one_are_one(tmp_path):
    arrays = people_arrays(1)
    arrays["det_kpts"][..., 2] = 1.0005
    assert read_detections(write(tmp_path / "d.npz", **arrays), RIG).views(0)[0].people_score.max() == 1.0


def test_the_shared_real_detections_are_read():
    if not CAPTURE.is_dir():
        pytest.skip(f"the shared capture {CAPTURE.name} is not here")
    file = read_detections(CAPTURE / "data.npz", RIG)
    assert file.frames == range(100)
    assert sum(len(view.people_px) for n in file.frames for view in file.views(n)) == 999


def test_messages_end_with_what_to_do_next(tmp_path):
    assert re.search(r"do next:  write the arrays det_frame, det_view, det_kpts", message(tmp_path / "missing.npz"))
