"""The robust update against exact points, drawn noise, and rays that are wrong."""

from dataclasses import replace

import numpy as np
import pytest

from recognition.optics import Optics
from recognition.synthetic import semicircle_rig
from recognition.triangulation.fusion import Motion, Sights, fuse
from recognition.triangulation.systematic import systematic
from rigcal.rig import Rig

RIG = semicircle_rig(4)
OPTICS = Optics.of(RIG)
SIGMA_RAD = 0.003
VAGUE = np.diag([0.5**2] * 3 + [1.0] * 3)


def points(count, seed=0):
    """Places in the rig frame, in the middle of the site."""
    in_world = np.random.default_rng(seed).uniform(-1, 1, (count, 3)) + [0, 0, 1.0]
    return RIG.world_from_rig.inverse().apply(in_world)


def sights(place, noise=None, seen=None, age_s=None, velocity=None) -> Sights:
    """What the cameras see of places (N, 3), with noise (V, N, 2) in radians."""
    age_s = np.zeros(4) if age_s is None else age_s
    in_cam = OPTICS.in_cameras(place)
    if velocity is not None:
        in_cam = in_cam - OPTICS.turned(velocity) * age_s[:, None]
    xy = in_cam[:2] / in_cam[2]
    if noise is not None:
        xy = xy + np.moveaxis(noise, -1, 0)
    count = len(place)
    factors = np.stack([np.ones((4, count)), xy[0], xy[1], (xy**2).sum(axis=0)])
    seen = np.ones((4, count), dtype=bool) if seen is None else seen
    return Sights(factors, seen, np.full((4, count), SIGMA_RAD**2), np.zeros((4, count)), age_s)


def prior(place, off=0.0, covariance=VAGUE, velocity=0.0) -> Motion:
    state = np.concatenate([place + off, np.broadcast_to(velocity, place.shape)], axis=1)
    return Motion.of(state, np.broadcast_to(covariance, (len(place), 6, 6)).copy())


LONG = np.full(1, 1e3)


def test_exact_rays_place_points_exactly_whatever_the_prior():
    place = points(20)
    vast = np.diag([1e4] * 3 + [1.0] * 3)
    fused = fuse(OPTICS, prior(place, off=0.2, covariance=vast), sights(place), np.repeat(LONG, 20))
    np.testing.assert_allclose(fused.motion.state[:, :3], place, atol=1e-6)
    assert fused.agreed.all()


def test_the_covariance_is_that_of_drawn_noise():
    place, count = points(1), 3000
    noise = np.random.default_rng(1).normal(0, SIGMA_RAD, (4, count, 2))
    many = np.repeat(place, count, axis=0)
    fused = fuse(OPTICS, prior(many), sights(many, noise), np.repeat(LONG, count))
    drawn = np.cov((fused.motion.state[:, :3] - many).T)
    stated = fused.motion.covariance[:, :3, :3].mean(axis=0)
    assert np.trace(drawn) / np.trace(stated) == pytest.approx(1.0, abs=0.15)


def test_the_variance_is_the_mean_of_the_diagonal():
    place = points(5)
    motion = fuse(OPTICS, prior(place), sights(place), np.repeat(LONG, 5)).motion
    np.testing.assert_allclose(motion.variance, np.trace(motion.covariance[:, :3, :3], axis1=1, axis2=2) / 3)


def test_one_wrong_ray_of_four_is_left_out():
    place = points(10)
    noise = np.zeros((4, 10, 2))
    noise[2, :, 0] = 0.1
    fused = fuse(OPTICS, prior(place, off=0.02, covariance=VAGUE / 100), sights(place, noise), np.repeat(LONG, 10))
    np.testing.assert_allclose(fused.motion.state[:, :3], place, atol=0.01)
    assert not fused.agreed[2].any()
    assert fused.agreed[[0, 1, 3]].all()


def test_a_wrong_ray_is_found_without_a_good_prior_too():
    place = points(10)
    noise = np.zeros((4, 10, 2))
    noise[1, :, 1] = 0.15
    fused = fuse(OPTICS, prior(place, off=0.3), sights(place, noise), np.repeat(LONG, 10))
    assert not fused.agreed[1].any()
    np.testing.assert_allclose(fused.motion.state[:, :3], place, atol=0.02)


def test_three_rays_that_agree_move_a_point_from_a_prior_that_is_sure_and_wrong():
    place = points(4)
    sure = np.diag([0.01**2] * 3 + [0.1] * 3)
    fused = fuse(OPTICS, prior(place, off=0.4, covariance=sure), sights(place), np.full(4, 0.03))
    assert np.linalg.norm(fused.motion.state[:, :3] - place, axis=1).max() < 0.02


def test_two_rays_move_it_only_as_far_as_a_joint_can_have_moved():
    place, sure = points(4), np.diag([0.01**2] * 3 + [0.1] * 3)
    seen = np.zeros((4, 4), dtype=bool)
    seen[:2] = True
    far = fuse(OPTICS, prior(place, off=0.6, covariance=sure), sights(place, seen=seen), np.full(4, 0.03))
    assert np.linalg.norm(far.motion.state[:, :3] - place, axis=1).min() > 0.9
    later = fuse(OPTICS, prior(place, off=0.6, covariance=sure), sights(place, seen=seen), np.full(4, 0.5))
    assert np.linalg.norm(later.motion.state[:, :3] - place, axis=1).max() < 0.05


def test_one_ray_holds_a_point_across_it_and_leaves_it_free_along_it():
    place = points(6)
    seen = np.zeros((4, 6), dtype=bool)
    seen[1] = True
    fused = fuse(OPTICS, prior(place, off=0.01, covariance=VAGUE / 25), sights(place, seen=seen), np.repeat(LONG, 6))
    ray = place - OPTICS.centre_m[1]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    along = np.einsum("ni,nij,nj->n", ray, fused.motion.covariance[:, :3, :3], ray)
    whole = np.trace(fused.motion.covariance[:, :3, :3], axis1=1, axis2=2)
    assert np.sqrt(along).min() > 0.099
    assert np.sqrt(whole - along).max() < 0.05


def test_unseen_points_stay_as_they_were():
    place = points(3)
    before = prior(place, off=0.1)
    fused = fuse(OPTICS, before, sights(place, seen=np.zeros((4, 3), dtype=bool)), np.repeat(LONG, 3))
    np.testing.assert_allclose(fused.motion.state, before.state)
    np.testing.assert_allclose(fused.motion.covariance, before.covariance)
    assert (fused.information == 0).all()


def test_rays_that_are_nearly_parallel_leave_the_point_uncertain():
    far = RIG.world_from_rig.inverse().apply(np.array([[0.0, -80.0, 1.0]]))
    seen = np.array([[False], [True], [True], [False]])  # 5 m apart, before them
    fused = fuse(OPTICS, prior(far), sights(far, seen=seen), LONG)
    assert np.sqrt(fused.motion.variance[0]) > 0.2


def test_late_cameras_see_a_moving_point_where_it_was():
    place, velocity = points(5), np.tile([1.5, 0.0, 0.5], (5, 1))
    age_s = np.array([0.0, 0.02, -0.015, 0.03])
    known = np.diag([0.3**2] * 3 + [1e-6] * 3)
    seen = sights(place, age_s=age_s, velocity=velocity)
    fused = fuse(OPTICS, prior(place, covariance=known, velocity=velocity), seen, np.repeat(LONG, 5))
    np.testing.assert_allclose(fused.motion.state[:, :3], place, atol=1e-4)
    blind = fuse(OPTICS, prior(place, covariance=known), replace(seen, age_s=np.zeros(4)), np.repeat(LONG, 5))
    assert np.linalg.norm(blind.motion.state[:, :3] - place, axis=1).min() > 5e-3


def test_pose_errors_of_the_cameras_enter_the_covariance():
    """Against rigs whose cameras are drawn from the covariance."""
    rng, place = np.random.default_rng(4), points(1)
    sigma = np.array([1e-3] * 3 + [3e-3] * 3)
    rig = replace(RIG, cameras=tuple(replace(c, pose_covariance=np.diag(sigma**2)) for c in RIG.cameras))
    found = []
    for _ in range(150):
        errors = rng.normal(0, sigma, (4, 6))
        true = Rig(
            "true", tuple(replace(c, cam_from_rig=c.cam_from_rig.perturbed(e[:3], e[3:])) if i else c
                          for i, (c, e) in enumerate(zip(RIG.cameras, errors, strict=True))), "cam0", "PASS",
        )  # fmt: skip
        in_cam = Optics.of(true).in_cameras(place)
        xy = in_cam[:2] / in_cam[2]
        seen = sights(place)
        factors = np.stack([np.ones((4, 1)), xy[0], xy[1], (xy**2).sum(axis=0)])
        found.append(fuse(OPTICS, prior(place), replace(seen, factors=factors), LONG).motion.state[0, :3])
    optics = Optics.of(replace(rig, cameras=(RIG.cameras[0], *rig.cameras[1:])))
    seen = sights(place)
    fused = fuse(optics, prior(place), seen, LONG)
    stated = systematic(optics, fused, seen.factors, np.zeros(4))
    drawn = np.cov(np.array(found).T)
    assert stated is not None
    ratio = np.sqrt(np.trace(stated[0]) / np.trace(drawn))
    assert 0.9 < ratio < 1.5  # what a camera moves along its own ray is counted too, and does not matter


def test_clock_errors_enter_the_covariance_of_what_moves():
    place = points(2)
    moving = prior(place, covariance=np.diag([0.25] * 3 + [1e-6] * 3), velocity=np.array([[0, 0, 0], [2.0, 0, 0]]))
    fused = fuse(OPTICS, moving, sights(place), np.repeat(LONG, 2))
    stated = systematic(OPTICS, fused, sights(place).factors, np.full(4, 0.01))
    assert stated is not None
    sigma_m = np.sqrt(np.trace(stated, axis1=1, axis2=2))
    assert sigma_m[0] < 1e-6
    assert 0.002 < sigma_m[1] < 0.03  # 2 m/s for 10 ms are 20 mm at the most
    assert systematic(OPTICS, fused, sights(place).factors, np.zeros(4)) is None
