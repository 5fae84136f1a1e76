"""Triangulation against the truth of a simulated site, and against OpenCV."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from recognition.association import Association, Groups, associate
from recognition.epipolar import RigGeometry
from recognition.observations import ViewDetections
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from recognition.triangulation import MIN_PARALLAX_RAD, triangulate, triangulate_objects, triangulate_people
from rigcal.geometry import Pose
from rigcal.rig import RigCamera

RIG = semicircle_rig(4)
GEOMETRY = RigGeometry.of(RIG)


def true_groups(views, workers):
    """The association that a perfect matcher would find."""
    members = np.full((workers, 4), -1)
    for v, view in enumerate(views):
        for d, worker in enumerate(view.worker_idx):
            if worker >= 0:
                members[worker, v] = d
    none = np.zeros(4, dtype=int)
    people = Groups(members, np.full(members.shape, np.nan), none, none)
    objects = Groups(np.zeros((0, 4)), np.zeros((0, 4)), none, none)
    return Association(people, objects, (), 0.2)


def seen_from(points_in_rig, rig=RIG):
    """(N, V, 2) exact normalised coordinates, also of points behind a camera."""
    in_cam = np.stack([c.cam_from_rig.apply(points_in_rig) for c in rig.cameras], axis=1)
    return in_cam[..., :2] / in_cam[..., 2:]


def in_rig(points_in_world):
    return RIG.world_from_rig.inverse().apply(points_in_world)


POINTS = in_rig(np.random.default_rng(0).uniform([-2, -2, 0], [2, 2, 2], (30, 3)))


def test_exact_detections_give_the_joints_to_a_micrometre():
    site = simulate(RIG, workers=4, frames=4, fps=1.0, seed=3)
    for frame in range(4):
        views = observe(site, frame)
        association = associate(GEOMETRY, [view.detections for view in views])
        people = triangulate_people(GEOMETRY, [view.detections for view in views], association)
        found = RIG.world_from_rig.apply(people.joints_m)
        truth = site.joints_in_world_m[frame]
        for row, joints in zip(people.members, found, strict=True):
            v, d = next((v, d) for v, d in enumerate(row) if d >= 0)
            known = np.isfinite(joints).all(axis=1)
            assert known.sum() >= 15
            assert np.abs(joints - truth[views[v].worker_idx[d]])[known].max() < 1e-6
        assert np.nanmax(people.error_px) < 1e-5


@pytest.mark.parametrize("kept", [(0, 1), (1, 3), (0, 1, 2), (0, 1, 2, 3)])
def test_any_two_cameras_are_enough(kept):
    xy = seen_from(POINTS)
    xy[:, [v for v in range(4) if v not in kept]] = np.nan
    found = triangulate(GEOMETRY, xy)
    np.testing.assert_allclose(found.points_m, POINTS, atol=1e-9)
    assert (found.views == len(kept)).all()


@pytest.mark.parametrize("kept", [(), (2,)])
def test_fewer_than_two_cameras_give_nan_and_never_zero(kept):
    xy = seen_from(POINTS)
    xy[:, [v for v in range(4) if v not in kept]] = np.nan
    found = triangulate(GEOMETRY, xy)
    assert np.isnan(found.points_m).all()
    assert np.isnan(found.error_px).all()
    assert (found.views == len(kept)).all()


def test_two_exact_views_agree_with_opencv():
    xy = seen_from(POINTS)[:, [0, 2]]
    poses = [np.c_[RIG.cameras[v].cam_from_rig.rotation, RIG.cameras[v].cam_from_rig.translation_m] for v in (0, 2)]
    homogeneous = cv2.triangulatePoints(*poses, np.ascontiguousarray(xy[:, 0].T), np.ascontiguousarray(xy[:, 1].T))
    full = np.full((len(xy), 4, 2), np.nan)
    full[:, [0, 2]] = xy
    np.testing.assert_allclose(triangulate(GEOMETRY, full).points_m, (homogeneous[:3] / homogeneous[3]).T, atol=1e-9)


def test_three_pixels_of_noise_become_thirteen_millimetres():
    # measured: median 13.0 mm, 95 % below 24.0 mm, reprojection error 3.2 px (four cameras at 5 m, f = 1152 px)
    errors, error_px = [], []
    noise = DetectorNoise(pixel_sigma=3.0)
    for seed in range(3):
        site = simulate(RIG, workers=4, frames=10, fps=1.0, seed=seed)
        for frame in range(10):
            views = with_noise(observe(site, frame), RIG, noise, seed=[seed, frame])
            people = triangulate_people(GEOMETRY, [view.detections for view in views], true_groups(views, 4))
            found = RIG.world_from_rig.apply(people.joints_m)
            errors.append(np.linalg.norm(found - site.joints_in_world_m[frame], axis=-1))
            error_px.append(people.error_px)
    known = np.isfinite(errors)
    assert known.all()
    assert np.median(np.array(errors)[known]) < 0.0145
    assert np.quantile(np.array(errors)[known], 0.95) < 0.027
    assert np.nanmedian(error_px) == pytest.approx(3.2, abs=0.3)


def test_the_reprojection_error_is_that_of_the_camera_model():
    views = with_noise(
        observe(simulate(RIG, workers=1, frames=1, seed=4), 0), RIG, DetectorNoise(pixel_sigma=5.0), seed=1
    )
    people = triangulate_people(GEOMETRY, [view.detections for view in views], true_groups(views, 1))
    square = np.full((4, 17), np.nan)
    for v, (mounted, view) in enumerate(zip(RIG.cameras, views, strict=True)):
        in_cam = mounted.cam_from_rig.apply(people.joints_m[0])
        pinhole_px = in_cam[:, :2] / in_cam[:, 2:] * mounted.camera.params[:2] + mounted.camera.params[2:4]
        observed_px = mounted.camera.undistorted_px(view.detections.people_px[0])
        square[v] = ((pinhole_px - observed_px) ** 2).sum(axis=1)
    known = np.isfinite(people.error_px[0])
    np.testing.assert_allclose(people.error_px[0][known], np.sqrt(np.nanmean(square, axis=0))[known], rtol=1e-9)


def test_points_behind_a_camera_are_refused():
    behind_camera_0 = np.array([[0.5, 0.2, -1.0]])
    xy = seen_from(behind_camera_0)
    xy[:, 2:] = np.nan
    found = triangulate(GEOMETRY, xy)
    assert np.isnan(found.points_m).all()
    assert found.views.tolist() == [2]


def test_nearly_parallel_rays_are_refused():
    beside = RigCamera("beside", RIG.cameras[0].camera, Pose(np.eye(3), [-1.0, 0.0, 0.0]))
    rig = replace(RIG, cameras=(RIG.cameras[0], beside))
    limit_m = 0.5 / np.tan(MIN_PARALLAX_RAD / 2)
    points = np.array([[0.5, 0.0, 0.99 * limit_m], [0.5, 0.0, 1.01 * limit_m]])
    found = triangulate(RigGeometry.of(rig), seen_from(points, rig))
    np.testing.assert_allclose(found.points_m[0], points[0], rtol=1e-6)
    assert np.isnan(found.points_m[1]).all()
    assert found.views.tolist() == [2, 2]


def test_cameras_in_one_place_give_nan_and_no_exception():
    twin = RigCamera("twin", RIG.cameras[0].camera, Pose.from_rvec([0.0, 0.2, 0.0], [0.0, 0.0, 0.0]))
    rig = replace(RIG, cameras=(RIG.cameras[0], twin))
    found = triangulate(RigGeometry.of(rig), seen_from(np.array([[0.3, 0.1, 4.0]]), rig))
    assert np.isnan(found.points_m).all()
    assert found.views.tolist() == [2]


def test_joints_with_low_scores_are_not_used():
    views = observe(simulate(RIG, workers=1, frames=1, seed=4), 0)
    spoilt = [view.detections for view in views]
    px, score = spoilt[1].people_px + 80.0, np.full(spoilt[1].people_score.shape, 0.19)
    spoilt[1] = replace(spoilt[1], people_px=px, people_score=score)
    people = triangulate_people(GEOMETRY, spoilt, true_groups(views, 1))
    assert people.views.max() == 3
    assert np.nanmax(people.error_px) < 1e-5


def test_a_view_of_low_confidence_counts_less():
    xy = seen_from(POINTS)
    xy[:, 1] += 0.01
    confidence = np.ones((len(POINTS), 4))
    equal = np.linalg.norm(triangulate(GEOMETRY, xy, confidence=confidence).points_m - POINTS, axis=1)
    confidence[:, 1] = 0.2
    lower = np.linalg.norm(triangulate(GEOMETRY, xy, confidence=confidence).points_m - POINTS, axis=1)
    assert (lower < 0.5 * equal).all()
    confidence[:, 1] = 0.0
    without = triangulate(GEOMETRY, xy, confidence=confidence)
    np.testing.assert_allclose(without.points_m, POINTS, atol=1e-9)
    assert (without.views == 3).all()


def test_a_view_that_the_others_contradict_is_weighed_down():
    # measured: a view that is 0.1 rad (115 px) wrong moves the point by 29 mm, without the weight by 278 mm (medians)
    xy = seen_from(POINTS)
    xy[:, 1] += 0.1
    moved_m = np.linalg.norm(triangulate(GEOMETRY, xy).points_m - POINTS, axis=1)
    assert np.median(moved_m) < 0.04


def test_groups_of_one_view_are_kept_as_rows_of_nan():
    views = [view.detections for view in observe(simulate(RIG, workers=2, frames=1, seed=0), 0)]
    views[1:] = [ViewDetections.empty()] * 3
    association = associate(GEOMETRY, views)
    people = triangulate_people(GEOMETRY, views, association)
    objects = triangulate_objects(GEOMETRY, views, association)
    assert people.joints_m.shape == (2, 17, 3)
    assert np.isnan(people.joints_m).all()
    assert people.views.max() == 1
    assert len(objects.classes) == len(views[0].object_class)
    assert np.isnan(objects.centre_m).all()
    assert (objects.views == 1).all()


def test_nothing_associated_is_nothing_triangulated():
    views = [ViewDetections.empty()] * 4
    association = associate(GEOMETRY, views)
    assert triangulate_people(GEOMETRY, views, association).joints_m.shape == (0, 17, 3)
    assert triangulate_objects(GEOMETRY, views, association).centre_m.shape == (0, 3)


def test_centres_of_boxes_are_near_the_centres_of_objects():
    # measured over these frames: hats (28 cm) within 11 mm, everything within 99 mm: the centre of a box is not the
    # projection of the centre of a thing as large as a window
    site = simulate(RIG, workers=4, frames=5, fps=1.0, seed=1)
    for frame in range(5):
        views = observe(site, frame)
        members = np.full((14, 4), -1)
        for v, view in enumerate(views):
            members[view.object_idx, v] = np.arange(len(view.object_idx))
        none = np.zeros(4, dtype=int)
        objects = Groups(members, np.full(members.shape, np.nan), none, none)
        association = Association(true_groups(views, 4).people, objects, site.object_class, 0.2)
        found = triangulate_objects(GEOMETRY, [view.detections for view in views], association)
        assert found.classes == site.object_class
        off_m = np.linalg.norm(RIG.world_from_rig.apply(found.centre_m) - site.object_centre_in_world_m[frame], axis=1)
        assert np.nanmax(off_m[:4]) < 0.012
        assert np.nanmax(off_m) < 0.11


@pytest.mark.parametrize("stage", [triangulate_people, triangulate_objects])
def test_another_number_of_views_than_cameras_is_refused(stage):
    association = associate(GEOMETRY, [ViewDetections.empty()] * 4)
    with pytest.raises(ValueError, match="views: expected 4, one per camera of the rig, got 1"):
        stage(GEOMETRY, [ViewDetections.empty()], association)
