"""Keypoints of objects that every view names as they lie in its own image."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from recognition.keypoints import KEYPOINTS_OF
from recognition.observations import FrameSet, Instant, Scene, ViewDetections
from recognition.placing import Placer, place_smoothed
from recognition.synthetic import semicircle_rig

RIG = semicircle_rig(4)
PANE = np.array([[-0.6, 0.9, 1.6], [0.5, 1.0, 1.6], [0.5, 1.0, 0.4], [-0.6, 0.9, 0.4]])
DECK = np.array([[0.4, -0.7, 0.9], [0.4, 0.8, 0.9], [-0.5, 0.8, 0.9], [-0.5, -0.7, 0.9]])
LADDER = np.array([[0.0, 0.3, 0.0], [0.0, -0.3, 0.0], [-0.5, 0.25, 2.0], [-0.5, -0.25, 2.0]])
CORNERS = {"large_window": PANE, "platform": DECK, "ladder": LADDER}


def in_rig(corners):
    return RIG.world_from_rig.inverse().apply(corners)


def seen_by(camera, name: str, corners, order, noise_px=0.0) -> ViewDetections:
    px = camera.camera.project(camera.cam_from_rig.apply(in_rig(corners)))
    box = np.concatenate([px.min(axis=0), px.max(axis=0)])[None]
    given = (px + noise_px)[list(order)][None]
    return ViewDetections(np.zeros((0, 17, 2)), np.zeros((0, 17)), (name,), box, np.ones(1), given)


def run_of(views) -> list[Instant]:
    return [Instant(FrameSet(f, (f + 1) * 33_000_000, (None,) * 4), tuple(row)) for f, row in enumerate(views)]


def placed(views) -> list[Scene]:
    placer = Placer(RIG)
    return [placer.place(instant) for instant in run_of(views)]


def order_and_error(name: str, keypoints_m, corners):
    """The symmetry in which keypoints are nearest to the true corners, and the largest distance then."""
    true = in_rig(corners)
    errors = [np.linalg.norm(keypoints_m - true[list(q)], axis=1).max() for q in KEYPOINTS_OF[name].symmetries]
    return int(np.argmin(errors)), min(errors)


def shuffled(name: str, frames: int, seed: int, noise_px: float = 2.0) -> list[list[ViewDetections]]:
    """Every view names the corners in any of the orders of the class, another one at every instant."""
    random = np.random.default_rng(seed)
    symmetries = KEYPOINTS_OF[name].symmetries
    return [
        [
            seen_by(
                camera, name, CORNERS[name], symmetries[random.integers(len(symmetries))],
                random.normal(0.0, noise_px, (4, 2)),
            )
            for camera in RIG.cameras
        ]
        for _ in range(frames)
    ]  # fmt: skip


def with_keypoints(view: ViewDetections, keypoints_px) -> ViewDetections:
    return replace(view, object_keypoints_px=np.asarray(keypoints_px, dtype=float).reshape(1, 4, 2))


@pytest.mark.parametrize("name", CORNERS)
def test_an_object_has_its_true_corners_however_each_view_names_them(name):
    symmetries = KEYPOINTS_OF[name].symmetries
    for orders in list(product(symmetries, repeat=4))[:: 5 if len(symmetries) == 4 else 1]:
        row = [seen_by(c, name, CORNERS[name], q) for c, q in zip(RIG.cameras, orders, strict=True)]
        (thing,) = placed([row] * 4)[-1].objects
        assert order_and_error(name, thing.keypoints_m, CORNERS[name])[1] < 0.03, orders


@pytest.mark.parametrize("name", CORNERS)
def test_names_stay_the_same_along_a_track(name):
    views = shuffled(name, 40, seed=3)
    for row in views[20:26]:
        row[1] = row[2] = ViewDetections.empty()
    told = [scene.objects[0] for scene in placed(views)[4:]]
    found = [order_and_error(name, thing.keypoints_m, CORNERS[name]) for thing in told]
    assert len({order for order, _ in found}) == 1
    assert max(error for _, error in found) < 0.06
    assert len({thing.track_id for thing in told}) == 1


def test_names_stay_while_the_object_turns_around():
    random, frames = np.random.default_rng(5), 60
    symmetries, views, true = KEYPOINTS_OF["large_window"].symmetries, [], []
    middle = PANE.mean(axis=0)
    for angle in np.linspace(0.0, np.pi, frames):
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
        true.append((PANE - middle) @ turn.T + middle)
        orders = random.integers(len(symmetries), size=4)
        views.append(
            [seen_by(c, "large_window", true[-1], symmetries[q]) for c, q in zip(RIG.cameras, orders, strict=True)]
        )
    scenes = placed(views)
    found = [
        order_and_error("large_window", scene.objects[0].keypoints_m, corners)
        for scene, corners in zip(scenes[4:], true[4:], strict=True)
    ]
    assert len({order for order, _ in found}) == 1
    assert max(error for _, error in found) < 0.1


def test_a_view_that_is_far_off_is_left_out():
    views = shuffled("large_window", 12, seed=4)
    for row in views:
        row[2] = with_keypoints(row[2], row[2].object_keypoints_px + np.array([160.0, -120.0]))
    (thing,) = placed(views)[-1].objects
    assert order_and_error("large_window", thing.keypoints_m, PANE)[1] < 0.06


def test_keypoints_on_which_no_three_views_agree_are_not_told():
    views = shuffled("large_window", 12, seed=6)
    random = np.random.default_rng(1)
    for row in views:
        for v, view in enumerate(row):
            low, high = view.object_xyxy[0, :2], view.object_xyxy[0, 2:]
            wrong = random.uniform(low, high, (4, 2))
            row[v] = with_keypoints(view, wrong)
    (thing,) = placed(views)[-1].objects
    assert np.isfinite(thing.centre_m).all()
    assert np.isnan(thing.keypoints_m).any(axis=1).sum() >= 3
    assert np.isnan(thing.keypoint_covariance_m2[np.isnan(thing.keypoints_m[:, 0])]).all()


def test_the_covariance_of_a_keypoint_grows_with_what_views_disagree_by():
    exact = placed(shuffled("ladder", 12, seed=7, noise_px=0.0))[-1].objects[0]
    coarse = placed(shuffled("ladder", 12, seed=7, noise_px=12.0))[-1].objects[0]
    assert np.isfinite(exact.keypoints_m).all()
    variance = [np.trace(thing.keypoint_covariance_m2, axis1=1, axis2=2) / 3 for thing in (exact, coarse)]
    assert (variance[0] <= 0.15**2).all()
    assert np.nanmean(variance[1]) > np.nanmean(variance[0])
    np.testing.assert_array_equal(exact.keypoint_covariance_m2, exact.keypoint_covariance_m2.swapaxes(1, 2))


def test_a_keypoint_that_a_view_does_not_see_takes_no_part():
    views = shuffled("platform", 12, seed=8)
    random = np.random.default_rng(2)
    for row in views:
        for v, view in enumerate(row):
            hidden = view.object_keypoints_px[0].copy()
            hidden[random.integers(4)] = np.nan
            row[v] = with_keypoints(view, hidden)
    told = [scene.objects[0].keypoints_m for scene in placed(views)[6:]]
    for keypoints_m in told:
        true = in_rig(DECK)
        near = np.linalg.norm(keypoints_m[:, None] - true, axis=2)
        assert np.nanmax(np.where(np.isnan(keypoints_m[:, 0]), 0.0, np.min(near, axis=1))) < 0.08
    assert np.mean([np.isfinite(keypoints_m[:, 0]).mean() for keypoints_m in told]) > 0.7


def test_classes_without_symmetries_keep_the_names_that_were_given():
    row = [seen_by(camera, "crate", PANE, (0, 1, 2, 3)) for camera in RIG.cameras]
    (crate,) = placed([row] * 4)[-1].objects
    np.testing.assert_allclose(crate.keypoints_m, in_rig(PANE), atol=0.03)


def test_two_of_a_class_are_named_apart_from_each_other():
    other = PANE + np.array([0.3, -1.6, 0.0])
    views, symmetries = [], KEYPOINTS_OF["large_window"].symmetries
    for frame in range(6):
        row = []
        for v, camera in enumerate(RIG.cameras):
            one = seen_by(camera, "large_window", PANE, symmetries[(frame + v) % 4])
            two = seen_by(camera, "large_window", other, symmetries[(3 * frame + 2 * v) % 4])
            row.append(
                ViewDetections(
                    one.people_px, one.people_score, ("large_window",) * 2,
                    np.concatenate([one.object_xyxy, two.object_xyxy]), np.ones(2),
                    np.concatenate([one.object_keypoints_px, two.object_keypoints_px]),
                )
            )  # fmt: skip
        views.append(row)
    things = placed(views)[-1].objects
    assert len(things) == 2
    for thing in things:
        near = min((PANE, other), key=lambda c: np.linalg.norm(in_rig(c).mean(axis=0) - thing.centre_m))
        assert order_and_error("large_window", thing.keypoints_m, near)[1] < 0.04


def test_smoothed_keypoints_come_with_their_covariance():
    views = shuffled("large_window", 20, seed=9)
    plain, smooth = placed(views), list(place_smoothed(RIG, run_of(views)))
    for before, after in zip(plain[4:], smooth[4:], strict=True):
        (thing,) = after.objects
        assert order_and_error("large_window", thing.keypoints_m, PANE)[1] < 0.06
        own = np.trace(thing.keypoint_covariance_m2, axis1=1, axis2=2)
        filtered = np.trace(before.objects[0].keypoint_covariance_m2, axis1=1, axis2=2)
        assert (own <= filtered + 1e-12).all()
        assert (own > 0).all()


def test_three_cameras_of_four_that_agree_are_believed_and_two_are_not():
    far = np.array([[180.0, 0.0], [0.0, 150.0], [-170.0, 30.0], [60.0, -160.0]])
    told = []
    for wrong in (1, 2):
        views = shuffled("large_window", 12, seed=11, noise_px=0.0)
        for row in views:
            for v in range(wrong):
                row[v] = with_keypoints(row[v], row[v].object_keypoints_px[0] + np.roll(far, v, axis=0))
        (thing,) = placed(views)[-1].objects
        known = thing.keypoints_m[np.isfinite(thing.keypoints_m[:, 0])]
        assert np.linalg.norm(known[:, None] - in_rig(PANE), axis=2).min(axis=1).max() < 0.1
        told.append(len(known))
    assert told == [4, 1]  # one of those that are far off meets the others by chance
