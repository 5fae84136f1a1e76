"""Exact views are the lens model's projections; noise is what was asked for."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from rigcal.camera import Camera
from rigcal.errors import OptionError
from rigcal.geometry import Pose

RIG = semicircle_rig(4)
SITE = simulate(RIG, workers=4, frames=40, fps=2.0, seed=1)
EXACT = [observe(SITE, frame) for frame in range(40)]


def test_joints_are_where_opencv_projects_them():
    for v, (mounted, view) in enumerate(zip(RIG.cameras, EXACT[3], strict=True)):
        pose = SITE.cam_from_world[v]
        for worker, px in zip(view.worker_idx, view.detections.people_px, strict=True):
            expected, _ = cv2.projectPoints(
                SITE.joints_in_world_m[3, worker],
                pose.rvec_rad,
                pose.translation_m,
                mounted.camera.matrix,
                mounted.camera.distortion,
            )
            known = np.isfinite(px).all(axis=1)
            assert known.sum() > 10
            np.testing.assert_allclose(px[known], expected[known, 0], atol=1e-6)


def test_a_box_holds_the_projected_corners_and_no_more():
    view = EXACT[0][0]
    k = int(np.flatnonzero(view.object_idx == 6)[0])  # the platform
    centre, size = SITE.object_centre_in_world_m[0, 6], SITE.object_size_m[6]
    grid = np.array(np.meshgrid(*[np.linspace(-0.5, 0.5, 5)] * 3)).reshape(3, -1).T
    px = RIG.cameras[0].camera.project(SITE.cam_from_world[0].apply(centre + grid * size))
    left, top, right, bottom = view.detections.object_xyxy[k]
    assert view.detections.object_class[k] == SITE.object_class[6]
    np.testing.assert_allclose([left, top], px.min(axis=0), atol=0.5)
    np.testing.assert_allclose([right, bottom], px.max(axis=0), atol=0.5)


def test_what_is_outside_the_image_or_behind_the_camera_is_not_detected():
    for views in EXACT:
        for mounted, view in zip(RIG.cameras, views, strict=True):
            seen = np.isfinite(view.detections.people_px).all(axis=-1)
            px = view.detections.people_px[seen]
            assert (px >= -0.5).all()
            assert (px <= np.array(mounted.camera.size_wh) - 0.5).all()
            np.testing.assert_array_equal(view.detections.people_score, seen.astype(float))
            assert seen.any(axis=1).all()
    about_face = Pose(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    away = replace(SITE, cam_from_world=tuple(about_face @ pose for pose in SITE.cam_from_world))
    for view in observe(away, 0):
        assert view.detections.people_px.shape == (0, 17, 2)
        assert view.detections.object_class == ()


def test_points_that_the_lens_polynomial_folds_into_the_image_are_not_detected():
    lens = RIG.cameras[0].camera
    folding = Camera("opencv5", lens.size_wh, np.array([*lens.params[:4], -0.5, 0.0, 0.0, 0.0, 0.0]))
    rig = replace(RIG, cameras=tuple(replace(mounted, camera=folding) for mounted in RIG.cameras))
    folded = 0
    for frame in range(40):
        for v, view in enumerate(observe(replace(SITE, rig=rig), frame)):
            in_cam = SITE.cam_from_world[v].apply(SITE.joints_in_world_m[frame])
            naive = folding.project(in_cam)
            inside = ((naive > 0) & (naive < np.array(lens.size_wh))).all(axis=-1)
            radius = np.hypot(in_cam[..., 0], in_cam[..., 1]) / in_cam[..., 2]
            beyond = inside & (in_cam[..., 2] > 0) & (radius > (3 * 0.5) ** -0.5 + 0.01)
            folded += beyond.sum()
            for worker, px in zip(view.worker_idx, view.detections.people_px, strict=True):
                assert np.isnan(px[beyond[worker]]).all()
    assert folded > 50


def test_no_noise_changes_the_order_and_the_scores_only():
    for view, same in zip(EXACT[2], with_noise(EXACT[2], RIG, DetectorNoise(), seed=0), strict=True):
        order = np.argsort(same.worker_idx)
        np.testing.assert_array_equal(same.detections.people_px[order], view.detections.people_px)
        things = np.argsort(same.object_idx)
        np.testing.assert_array_equal(same.detections.object_xyxy[things], view.detections.object_xyxy)
        assert [same.detections.object_class[k] for k in things] == list(view.detections.object_class)
        seen = np.isfinite(same.detections.people_px).all(axis=-1)
        assert (same.detections.people_score[seen] >= 0.5).all()
        assert (same.detections.people_score[~seen] == 0).all()


def test_noise_has_the_size_and_the_rates_that_were_asked_for():
    noise = DetectorNoise(pixel_sigma=3.0, missing_joint=0.2, missed=0.1, false_per_view=0.5, shuffled=False)
    off, missing, missed, false, false_objects = [], [], [], [], []
    for frame, views in enumerate(EXACT):
        for exact, view in zip(views, with_noise(views, RIG, noise, seed=[7, frame]), strict=True):
            true = view.worker_idx >= 0
            rows = [exact.worker_idx.tolist().index(i) for i in view.worker_idx[true]]
            given = exact.detections.people_px[rows]
            off.append((view.detections.people_px[true] - given).ravel())
            was_seen = np.isfinite(given).all(axis=-1)
            missing.append(np.isnan(view.detections.people_px[true]).all(axis=-1)[was_seen])
            missed.append(len(exact.worker_idx) - true.sum())
            false.append((~true).sum())
            false_objects.append((view.object_idx < 0).sum())
    assert np.nanstd(np.concatenate(off)) == pytest.approx(3.0, rel=0.03)
    assert np.concatenate(missing).mean() == pytest.approx(0.2, abs=0.01)
    assert np.sum(missed) / 640 == pytest.approx(0.1, abs=0.03)
    assert np.mean(false) == pytest.approx(0.5, abs=0.15)
    assert np.mean(false_objects) == pytest.approx(0.5, abs=0.15)


def test_detections_are_shuffled_unless_told_otherwise():
    kept = with_noise(EXACT[0], RIG, DetectorNoise(shuffled=False), seed=1)
    assert all((view.worker_idx == exact.worker_idx).all() for view, exact in zip(kept, EXACT[0], strict=True))
    mixed = with_noise(EXACT[0], RIG, DetectorNoise(), seed=1)
    assert any((view.object_idx != exact.object_idx).any() for view, exact in zip(mixed, EXACT[0], strict=True))


def test_the_same_seed_gives_the_same_bytes():
    noise = DetectorNoise(pixel_sigma=2.0, missing_joint=0.1, missed=0.1, false_per_view=1.0)
    one, same, other = (with_noise(EXACT[0], RIG, noise, seed=[seed, 0]) for seed in (1, 1, 2))
    assert all(
        a.detections.people_px.tobytes() == b.detections.people_px.tobytes()
        and a.detections.object_xyxy.tobytes() == b.detections.object_xyxy.tobytes()
        and a.detections.object_score.tobytes() == b.detections.object_score.tobytes()
        for a, b in zip(one, same, strict=True)
    )
    assert any(
        a.detections.people_px.tobytes() != b.detections.people_px.tobytes() for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("pixel_sigma", -1.0, "a number in 0..inf"),
        ("missing_joint", 1.1, "a number in 0..1"),
        ("missed", float("nan"), "a number in 0..1"),
        ("false_per_view", -0.5, "a number in 0..inf"),
    ],
)
def test_noise_out_of_range_says_what_is_expected(name, value, expected):
    with pytest.raises(OptionError) as caught:
        DetectorNoise(**{name: value})
    assert str(caught.value) == (
        f"option {name} is out of range\n  expected: {expected}\n  got:      {value!r}\n"
        f"  do next:  give {name} as {expected}"
    )
