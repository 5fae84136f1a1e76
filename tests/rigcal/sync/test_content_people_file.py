from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recognition.synthetic import semicircle_rig
from rigcal.errors import KeypointsFileError
from rigcal.sync.content.people.keypoints import read_keypoints

RIG = semicircle_rig(2)


def arrays(**changes):
    kpts = np.zeros((3, 17, 3), dtype=np.float32)
    kpts[..., 2] = 0.5
    whole = {"det_frame": np.array([0, 1, 1]), "det_view": np.array([0, 0, 1]), "det_kpts": kpts} | changes
    return {name: array for name, array in whole.items() if array is not None}


def read(tmp_path: Path, **changes):
    path = tmp_path / "people.npz"
    np.savez(path, **arrays(**changes))
    return read_keypoints(path, RIG)


def kpts(**cells):
    changed = arrays()["det_kpts"].copy()
    for column, value in cells.items():
        changed[1, 2, "xys".index(column)] = value
    return changed


def test_what_was_written_is_read(tmp_path):
    found = read(tmp_path, frame_time_s=np.array([0.0, 0.1]), obj_frame=np.array([[1]]), other=np.zeros(2))
    assert found.frame.tolist() == [0, 1, 1]
    assert found.view.tolist() == [0, 0, 1]
    assert found.kpts.shape == (3, 17, 3)
    assert found.frame_time_s.tolist() == [0.0, 0.1]
    assert found.frames == 2


def test_frames_without_people_count_where_the_file_has_times(tmp_path):
    assert read(tmp_path, frame_time_s=np.arange(5.0)).frames == 5


def test_a_file_without_detections_has_no_frames(tmp_path):
    empty = arrays()
    assert read(tmp_path, **{name: array[:0] for name, array in empty.items()}).frames == 0


def test_a_hidden_joint_may_be_anywhere(tmp_path):
    assert read(tmp_path, det_kpts=kpts(x=np.nan, s=0.0)).kpts[1, 2, 2] == 0


@pytest.mark.parametrize(
    ("changes", "problem", "expected", "got"),
    [
        ({"det_view": None}, "no array det_view", "det_frame, det_view, det_kpts", "det_frame, det_kpts"),
        ({"det_kpts": np.zeros((3, 16, 3))}, "det_kpts has another shape", "(N, 17, 3)", "(3, 16, 3)"),
        ({"det_frame": np.zeros((3, 1), int)}, "det_frame has another shape", "(N,)", "(3, 1)"),
        ({"frame_time_s": np.zeros((3, 1))}, "frame_time_s has another shape", "(F,)", "(3, 1)"),
        ({"det_frame": np.array([0.0, 1.0, 1.0])}, "det_frame has another type", "integers", "float64"),
        ({"det_kpts": np.full((3, 17, 3), "a")}, "det_kpts has another type", "numbers", "<U1"),
        (
            {"det_view": np.array([0, 1])},
            "arrays that belong together differ in length",
            "one row for each detection",
            "det_frame 3, det_view 2, det_kpts 3",
        ),
        (
            {"det_view": np.array([0, 2, 1])},
            "det_view has no such camera",
            "0 to 1, the cameras cam0, cam1 of the rig",
            "2 in row 1",
        ),
        ({"det_frame": np.array([0, 1, -4])}, "det_frame is negative", "0 or more", "-4 in row 2"),
        ({"det_kpts": kpts(s=1.5)}, "det_kpts has a score out of range", "0 to 1", "1.5"),
        ({"det_kpts": kpts(s=np.nan)}, "det_kpts has a score out of range", "0 to 1", "nan"),
        (
            {"det_kpts": kpts(x=np.nan)},
            "det_kpts has numbers that are not finite",
            "finite numbers",
            "1 that are not finite",
        ),
        (
            {"frame_time_s": np.array([0.0])},
            "frame_time_s does not cover every frame",
            "2 times or more, one for each frame from 0 to 1",
            "1",
        ),
        (
            {"frame_time_s": np.array([0.0, 0.2, 0.1])},
            "frame_time_s does not ascend",
            "each time after the one before",
            "0.2 s, then 0.1 s at frame 2",
        ),
        (
            {"frame_time_s": np.array([0.0, np.inf])},
            "frame_time_s has numbers that are not finite",
            "finite numbers",
            "1 that are not finite",
        ),
    ],
)
def test_a_file_that_is_not_as_documented_is_refused(tmp_path, changes, problem, expected, got):
    with pytest.raises(KeypointsFileError) as caught:
        read(tmp_path, **changes)
    assert str(caught.value) == (
        f"detections file: {problem}\n"
        f"  where:    {tmp_path / 'people.npz'}\n"
        f"  expected: {expected}\n"
        f"  got:      {got}\n"
        "  do next:  write the arrays det_frame, det_view, det_kpts (and frame_time_s where there are times) as "
        "recognition/README.md describes them"
    )


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 broken"])
def test_a_file_that_cannot_be_read_says_so(tmp_path, content):
    path = tmp_path / "people.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(KeypointsFileError, match="detections file: cannot read this file"):
        read_keypoints(path, RIG)


def test_a_single_array_is_no_detections_file(tmp_path):
    path = tmp_path / "people.npz"
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(KeypointsFileError, match="detections file: this file is one array"):
        read_keypoints(path, RIG)
