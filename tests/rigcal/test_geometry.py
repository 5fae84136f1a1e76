"""Poses: composition, inverses, perturbations, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigcal.geometry import Pose

angles = st.floats(-4.0, 4.0)
vectors = st.tuples(angles, angles, angles)


@given(vectors, vectors)
def test_a_pose_times_its_inverse_is_the_identity(rvec, translation):
    pose = Pose.from_rvec(rvec, translation)
    assert np.allclose((pose @ pose.inverse()).matrix, np.eye(4), atol=1e-12)


@given(vectors, vectors, vectors, vectors)
def test_composition_applies_the_right_pose_first(rvec1, t1, rvec2, t2):
    a_from_b, b_from_c = Pose.from_rvec(rvec1, t1), Pose.from_rvec(rvec2, t2)
    point = np.array([0.3, -0.2, 1.5])
    assert np.allclose((a_from_b @ b_from_c).apply(point), a_from_b.apply(b_from_c.apply(point)), atol=1e-12)


@given(vectors, vectors)
def test_quaternions_round_trip(rvec, translation):
    pose = Pose.from_rvec(rvec, translation)
    assert np.allclose(Pose.from_quat_wxyz(pose.quat_wxyz, translation).matrix, pose.matrix, atol=1e-12)
    assert pose.quat_wxyz[0] >= 0


@pytest.mark.parametrize("shape", [(3,), (0, 3), (5, 3), (2, 4, 3)])
def test_apply_keeps_batch_shapes_and_nan(shape):
    points = np.ones(shape)
    points[..., 0][...] = np.nan
    moved = Pose.from_rvec([0.1, 0, 0], [1, 2, 3]).apply(points)
    assert moved.shape == shape
    assert np.isnan(moved).all() or points.size == 0


def test_a_small_perturbation_is_a_left_one():
    pose = Pose.from_rvec([0.4, -0.2, 0.9], [1.0, 2.0, 3.0])
    moved = pose.perturbed([1e-6, 0, 0], [0, 1e-6, 0])
    point = np.array([0.5, 0.7, -0.3])
    turned = pose.rotation @ point
    expected = pose.apply(point) + np.cross([1e-6, 0, 0], turned) + [0, 1e-6, 0]
    assert np.allclose(moved.apply(point), expected, atol=1e-11)


def test_reflections_and_sheared_matrices_are_refused():
    for matrix in (np.diag([1.0, 1.0, -1.0]), np.eye(3) + 0.01):
        with pytest.raises(ValueError, match="not a rotation"):
            Pose(matrix, np.zeros(3))


def test_poses_are_read_only_copies():
    rotation = np.eye(3)
    pose = Pose(rotation, np.zeros(3))
    rotation[0, 0] = 5
    assert pose.rotation[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        pose.rotation[0, 0] = 2
