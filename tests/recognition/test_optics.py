"""The rig's numbers against the camera models, against plain geometry, and against drawn errors."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from recognition.optics import EXACT_PX, Lens, Optics, midpoints, pairs
from recognition.synthetic import semicircle_rig
from rigcal.camera import Camera
from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig
from rigcal.rigdocument import CovarianceEntry
from rigcal.rigfile import document_of_rig, rig_of

RIG = semicircle_rig(4)
OPTICS = Optics.of(RIG)
WIDE = Camera("opencv5", (1920, 1080), np.array([1300.0, 1305.0, 950.0, 545.0, -0.28, 0.08, 1e-3, -5e-4, -0.01]))
FISHEYE = Camera("fisheye4", (1280, 960), np.array([420.0, 421.0, 640.0, 480.0, 0.02, -0.01, 0.003, -0.001]))


@pytest.mark.parametrize("camera", [RIG.cameras[0].camera, WIDE, FISHEYE], ids=["mild", "strong", "fisheye"])
def test_lenses_invert_their_model_to_a_hundredth_of_a_pixel(camera):
    lens = Lens.of(camera)
    pixels = np.random.default_rng(0).uniform(0, 1, (200, 2)) * camera.size_wh
    off_px = np.abs(lens.undistorted(pixels) - camera.undistort(pixels)) * camera.params[0]
    assert off_px.max() < 1.5 * EXACT_PX


def test_a_strong_lens_gets_more_iterations_than_a_mild_one():
    assert Lens.of(WIDE).iterations > Lens.of(RIG.cameras[0].camera).iterations


def test_points_are_projected_as_the_cameras_do():
    points = np.random.default_rng(1).uniform(-1, 1, (30, 3)) + [0.0, 0.0, 4.0]
    in_cam = OPTICS.in_cameras(points)
    for v, mounted in enumerate(RIG.cameras):
        np.testing.assert_allclose(in_cam[:, v].T, mounted.cam_from_rig.apply(points), atol=1e-12)


def test_the_normal_basis_gives_the_normal_equations_of_the_linear_transform():
    rng = np.random.default_rng(2)
    xy, weight = rng.normal(size=(4, 2)), rng.uniform(0.5, 2.0, 4)
    rows, right = [], []
    for (x, y), w, mounted in zip(xy, weight, RIG.cameras, strict=True):
        R, t = mounted.cam_from_rig.rotation, mounted.cam_from_rig.translation_m
        rows += [np.sqrt(w) * (R[0] - x * R[2]), np.sqrt(w) * (R[1] - y * R[2])]
        right += [np.sqrt(w) * (x * t[2] - t[0]), np.sqrt(w) * (y * t[2] - t[1])]
    A, b = np.array(rows), np.array(right)
    factors = weight * np.stack([np.ones(4), xy[:, 0], xy[:, 1], (xy**2).sum(axis=1)])
    got = OPTICS.normal_basis @ factors.reshape(-1)
    np.testing.assert_allclose(got[:6], (A.T @ A)[np.triu_indices(3)], atol=1e-12)
    np.testing.assert_allclose(got[6:], A.T @ b, atol=1e-12)


def test_pairs_are_every_two_once():
    first, second = pairs(4)
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == list(combinations(range(4), 2))
    assert not first.flags.writeable
    assert not second.flags.writeable
    assert len(pairs(1)[0]) == len(pairs(0)[0]) == 0


def test_midpoints_halve_the_shortest_way_between_two_rays():
    point, sine = midpoints(
        np.array([0.0, 0, 0]), np.array([1.0, 0, 0]), np.array([2.0, -3, 0.4]), np.array([0.0, 1, 0])
    )
    np.testing.assert_allclose(point, [2, 0, 0.2], atol=1e-12)
    assert sine == pytest.approx(1.0)


def with_covariance(rig: Rig, covariance) -> Rig:
    return replace(rig, cameras=tuple(replace(c, pose_covariance=covariance) for c in rig.cameras))


def test_pose_doubt_is_half_of_the_mean_square_by_which_drawn_pose_errors_move_a_point():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6)) * np.array([1e-3] * 3 + [5e-3] * 3)[:, None]
    optics = Optics.of(with_covariance(RIG, root @ root.T))
    point = np.array([0.3, -0.2, 4.0])
    monomials = np.array([*np.outer(point, point)[np.triu_indices(3)], *point, 1.0])
    pose: Pose = RIG.cameras[2].cam_from_rig
    draws = rng.normal(size=(4000, 6)) @ root.T
    moved = np.array([pose.perturbed(d[:3], np.zeros(3)).rotation @ point + pose.translation_m + d[3:] for d in draws])
    square = ((moved - pose.apply(point)) ** 2).sum(axis=1).mean()
    assert optics.pose_doubt is not None
    assert monomials @ optics.pose_doubt[:, 2] == pytest.approx(square / 2, rel=0.05)


def test_rigs_without_covariance_have_no_pose_doubt():
    assert OPTICS.pose_doubt is None


def test_clock_bounds_grow_with_age_where_times_are_of_the_epoch():
    clock = ClockModel(0.0, 0.0, "2026-11-22T00:00:00+00:00", 0.001, 1.0, "probe")
    rig = replace(RIG, cameras=(replace(RIG.cameras[0], clock=clock), *RIG.cameras[1:]))
    bounds = Optics.of(rig).clock_bounds_s(round((clock.at_s + 1000.0) * 1e9))
    np.testing.assert_allclose(bounds, [0.002, 0, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(Optics.of(rig).clock_bounds_s(5_000_000_000), [0.001, 0, 0, 0])


def test_the_covariance_of_a_rig_file_reaches_its_cameras():
    document = document_of_rig(RIG, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    order = tuple(f"{camera}.{part}" for camera in ("cam1", "cam3") for part in ("rotation_rad", "translation_m"))
    matrix = np.diag(np.arange(1.0, 13.0))
    known = CovarianceEntry(order=order, matrix=tuple(map(tuple, matrix.tolist())))
    rig = rig_of(document.model_copy(update={"covariance": known}))
    assert [camera.pose_covariance is None for camera in rig_of(document).cameras] == [True] * 4
    np.testing.assert_array_equal(rig.cameras[0].pose_covariance, np.zeros((6, 6)))
    np.testing.assert_array_equal(rig.cameras[3].pose_covariance, np.diag(np.arange(7.0, 13.0)))
