"""The geometry of a rig against independent computations: OpenCV's lines, projection matrices, exact projections."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from recognition.epipolar import RigGeometry
from recognition.observations import ViewDetections
from recognition.synthetic import semicircle_rig
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

RIG = semicircle_rig(4)
GEOMETRY = RigGeometry.of(RIG)


def undistorted_px(rig: Rig, points_in_world: np.ndarray) -> np.ndarray:
    """(V, N, 2) through the lens and back."""
    points_in_rig = rig.world_from_rig.inverse().apply(points_in_world)
    return np.array(
        [c.camera.undistorted_px(c.camera.project(c.cam_from_rig.apply(points_in_rig))) for c in rig.cameras]
    )


def points(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 2.0], (count, 3))


def test_projections_of_one_point_lie_on_each_others_lines_to_a_millionth_of_a_pixel():
    px = undistorted_px(RIG, points(17))
    distances = GEOMETRY.line_distances_px(px, np.arange(4))
    others = ~np.eye(4, dtype=bool)
    assert np.isfinite(distances[others]).all()
    assert distances[others].max() < 1e-6


def test_the_distance_is_that_of_opencvs_epipolar_lines():
    px = undistorted_px(RIG, points(6)) + np.random.default_rng(1).normal(0, 20, (4, 6, 2))
    distances = GEOMETRY.line_distances_px(px, np.arange(4))
    for i, j in [(0, 1), (2, 0), (1, 3)]:
        into_j = cv2.computeCorrespondEpilines(px[i].reshape(-1, 1, 2), 1, GEOMETRY.fundamental[i, j])[:, 0]
        into_i = cv2.computeCorrespondEpilines(px[j].reshape(-1, 1, 2), 2, GEOMETRY.fundamental[i, j])[:, 0]
        to_j = np.abs((into_j * np.c_[px[j], np.ones(6)]).sum(1))
        to_i = np.abs((into_i * np.c_[px[i], np.ones(6)]).sum(1))
        np.testing.assert_allclose(distances[i, j], (to_i + to_j) / 2, rtol=1e-9)


def test_a_point_moved_off_its_line_by_ten_pixels_is_ten_pixels_from_it():
    px = undistorted_px(RIG, points(1))
    line = GEOMETRY.fundamental[0, 1] @ np.append(px[0, 0], 1.0)
    px[1, 0] += 10 * line[:2] / np.hypot(*line[:2])
    one_way = np.abs(line @ np.append(px[1, 0], 1.0)) / np.hypot(*line[:2])
    back = GEOMETRY.fundamental[1, 0] @ np.append(px[1, 0], 1.0)
    other_way = np.abs(back @ np.append(px[0, 0], 1.0)) / np.hypot(*back[:2])
    assert one_way == pytest.approx(10.0)
    assert GEOMETRY.line_distances_px(px, np.arange(4))[0, 1, 0] == pytest.approx((10.0 + other_way) / 2)


def test_fundamental_matrices_are_those_of_the_projection_matrices_up_to_scale():
    projections = [c.camera.matrix @ np.c_[c.cam_from_rig.rotation, c.cam_from_rig.translation_m] for c in RIG.cameras]
    for i, j in [(0, 1), (3, 1), (2, 3)]:
        centre = np.append(RIG.cameras[i].cam_from_rig.inverse().translation_m, 1.0)
        epipole = projections[j] @ centre
        cross = np.cross(np.eye(3), epipole)
        expected = cross.T @ projections[j] @ np.linalg.pinv(projections[i])
        got = GEOMETRY.fundamental[i, j]
        expected /= np.linalg.norm(expected)
        got = got / np.linalg.norm(got)
        assert min(np.abs(got - expected).max(), np.abs(got + expected).max()) < 1e-12


def test_one_camera_and_points_that_are_not_seen_have_no_distance():
    px = undistorted_px(RIG, points(3))
    px[2, 1] = np.nan
    distances = GEOMETRY.line_distances_px(px, [0, 0, 1, 2])
    assert np.isnan(distances[0, 1]).all()
    assert np.isnan(np.diagonal(distances)).all()
    assert np.isnan(distances[2, [0, 1, 3], 1]).all()
    assert np.isfinite(distances[2, [0, 1, 3]][:, [0, 2]]).all()


def test_no_detections_have_no_distances():
    assert GEOMETRY.line_distances_px(np.zeros((0, 17, 2)), np.zeros(0, dtype=int)).shape == (0, 0, 17)


def test_cameras_in_one_place_have_no_epipolar_geometry():
    turned = Pose.from_rvec([0.0, 0.3, 0.0], [0.0, 0.0, 0.0])
    twin = RigCamera("twin", RIG.cameras[0].camera, turned)
    geometry = RigGeometry.of(replace(RIG, cameras=(RIG.cameras[0], twin)))
    assert np.isnan(geometry.fundamental).all()


def test_another_number_of_views_is_refused():
    with pytest.raises(ValueError, match="views: expected 4, one per camera of the rig, got 3"):
        GEOMETRY.check_views([ViewDetections.empty()] * 3)
