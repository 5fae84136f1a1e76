"""From the world to what a detector reports: three detectors, of which the first sees through walls.

``open`` sees through everything, exactly, and tells the corners of an object apart: what is left is the geometry.
``seen`` is exact, but does not report what nobody could see, a joint hidden by anything but the worker's own body, a
worker or object of which too little shows; its boxes bound what shows, and the keypoints of symmetric objects are in
the order that looks right in each picture, as networks learn them. ``measured`` errs as the bundled networks were seen
to err (:mod:`tools.study.measured`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from recognition.observations import ViewDetections
from rigcal.geometry import Bools, Floats
from tools.sicsg.truth import Visibility
from tools.study.exact import Exact
from tools.study.world import World

_VISIBLE, _HIDDEN_BY_ITSELF, _OBJECT = 0.9, 0.5, 0.8
"""Scores that are reported."""
LEAST_JOINTS = 4
"""Somebody with fewer is not reported, as the model card has it."""
Views = tuple[ViewDetections, ...]
"""(V,) of an instant."""


def open_reports(world: World, exact: Exact, rng: np.random.Generator, pixel: float) -> Iterator[Views]:
    """What a detector that sees through everything reports.

    Args:
        world: The sequence.
        exact: Of :func:`tools.study.exact.exact_views`.
        rng: What errors are drawn from; the same number of draws whatever they are.
        pixel: Standard deviation of every coordinate of joints, boxes and keypoints.
    """
    given, told = exact.inside(exact.joints_px), np.ones(exact.joints_px.shape[:3], dtype=np.bool_)
    boxes, keypoints = exact.whole_xyxy, exact.keypoints_px
    noisy, low_high, points = (px + pixel * rng.standard_normal(px.shape) for px in (exact.joints_px, boxes, keypoints))
    boxes = np.concatenate(
        [np.minimum(low_high[..., :2], low_high[..., 2:]), np.maximum(low_high[..., :2], low_high[..., 2:])], axis=-1
    )
    shown = exact.inside(exact.middles_px) & np.isfinite(boxes).all(axis=-1)
    points = np.where(exact.inside(keypoints)[..., None], points, np.nan)
    return _reports(world, noisy, np.where(given, _VISIBLE, 0.0), told, boxes, points, shown)


def seen_reports(world: World, exact: Exact) -> Iterator[Views]:
    """What a detector without error reports of what shows."""
    at = exact.frame, np.arange(exact.frame.shape[1])
    seen = world.joint_seen[at]
    given = exact.inside(exact.joints_px) & (seen >= Visibility.SELF_OCCLUDED)
    score = np.where(seen == Visibility.VISIBLE, _VISIBLE, _HIDDEN_BY_ITSELF) * given
    points = np.where(exact.inside(exact.learned_px)[..., None], exact.learned_px, np.nan)
    boxes = exact.shown_xyxy
    shown = world.object_given[at] & np.isfinite(boxes).all(axis=-1)
    return _reports(world, exact.joints_px, score, world.worker_given[at], boxes, points, shown)


def with_joints(reports: Iterator[Views], joints: Collection[int]) -> Iterator[Views]:
    """The same by a detector that knows these joints only; nobody with fewer than :data:`LEAST_JOINTS` is reported."""
    unknown = [joint for joint in range(17) if joint not in joints]
    for views in reports:
        yield tuple(_known(view, unknown) for view in views)


def _known(view: ViewDetections, unknown: list[int]) -> ViewDetections:
    people, score = view.people_px.copy(), view.people_score.copy()
    people[:, unknown], score[:, unknown] = np.nan, 0.0
    told = (score > 0).sum(axis=1) >= LEAST_JOINTS
    return ViewDetections(
        people[told], score[told], view.object_class, view.object_xyxy, view.object_score, view.object_keypoints_px
    )


def _reports(
    world: World, joints: Floats, score: Floats, told: Bools, boxes: Floats, points: Floats, shown: Bools
) -> Iterator[Views]:
    people = np.where((score > 0)[..., None], joints, np.nan)
    told = told & ((score > 0).sum(axis=-1) >= LEAST_JOINTS)
    for frame in range(len(joints)):
        found = []
        for view in range(joints.shape[1]):
            at, who, which = (frame, view), told[frame, view], shown[frame, view]
            names = tuple(world.classes[thing] for thing in np.flatnonzero(which).tolist())
            of_objects = boxes[at][which], np.full(len(names), _OBJECT), points[at][which]
            found.append(ViewDetections(people[at][who], score[at][who], names, *of_objects))
        yield tuple(found)
