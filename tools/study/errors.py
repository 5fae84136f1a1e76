"""How the bundled networks err: what they reported of rendered validation sequences, beside what was true.

A row is one worker or object before one camera at one instant: how much of it showed, whether it was reported, and how
far off. Rows of the same worker or object stand in order of time, so that misses that last, errors that stay and long
tails can be drawn again as they were (:mod:`tools.study.measured`). What was reported of nobody and nothing is kept as
it was, all cameras of an instant together. Objects that are taken for another class (a scaffold for a platform) are
reports of the object that they overlap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from recognition.evaluation.violations import ObservedSequence
from recognition.observations import ViewDetections
from rigcal.geometry import Bools, Floats, Ints
from tools.study.exact import Exact, exact_views
from tools.study.world import World

SHARES = (0.02, 0.15, 0.5, 0.85)
"""Borders of how much of somebody shows, within which errors are alike; what shows less than the first is not there."""
_PERSON_OFF, _SAME_IOU, _OTHER_IOU = 0.25, 0.2, 0.5
"""Reported people are the worker whose joints are nearest, up to this share of its size; boxes are of the object of
their class, or else of another class, that they overlap by so much."""


@dataclass(frozen=True, slots=True)
class Report:
    """What was reported of an object."""

    name: str
    """Of the class, right or wrong."""
    edges: Floats
    """(4,) of the box, from the middle of that of what shows, in its widths and heights."""
    points: Floats
    """(4, 2) keypoints: of its own class from where they are, otherwise from the middle; in widths and heights."""
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """N rows of workers, or of objects of a class."""

    follows: Bools
    """(N,) whether the next row is the same worker or object one instant later."""
    shows: Ints
    """(N,) which part of :data:`SHARES`."""

    def drawn(self, last: int, shows: int, rng: np.random.Generator) -> int:
        """The row after the last one, if as much shows in it; otherwise any in which as much does; -1: none."""
        if last >= 0 and self.follows[last] and self.shows[last + 1] == shows:
            return last + 1
        rows = np.flatnonzero(self.shows == shows)
        return int(rng.choice(rows)) if len(rows) else -1


@dataclass(frozen=True, slots=True, eq=False)
class WorkerRows(Rows):
    """Rows of workers."""

    found: Bools
    """(N,)"""
    seen: Ints
    """(N, 17) what hides each joint, of :class:`tools.sicsg.truth.Visibility`."""
    off: Floats
    """(N, 17, 2) how far off it was, in sizes of the worker; NaN where it was not reported."""
    score: Floats
    """(N, 17)"""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectRows(Rows):
    """Rows of objects of a class."""

    reports: tuple[tuple[Report, ...], ...]
    """(N,)"""


@dataclass(frozen=True, slots=True, eq=False)
class NetworkErrors:
    """All that was measured."""

    workers: WorkerRows
    objects: Mapping[str, ObjectRows]
    strays: tuple[tuple[tuple[ViewDetections, ...], ...], ...]
    """Of each sequence, instant and camera: what was reported of nobody and nothing."""


def shows_of(share: Floats) -> Ints:
    """(...) which part of :data:`SHARES`: 0 of what is not there."""
    return np.asarray(np.searchsorted(SHARES, share, side="right"))


def sizes_px(joints_px: Floats) -> Floats:
    """(...) of workers with joints (..., 17, 2): the diagonal of all joints, hidden or not."""
    return np.asarray(np.linalg.norm(joints_px.max(axis=-2) - joints_px.min(axis=-2), axis=-1))


def measured_errors(seen: Sequence[tuple[World, ObservedSequence]]) -> NetworkErrors:
    """Compare what the networks reported of sequences with what was true of them."""
    workers: list[tuple[Bools, Ints, Bools, Ints, Floats, Floats]] = []
    objects: dict[str, list[tuple[Bools, Ints, tuple[tuple[Report, ...], ...]]]] = {}
    strays = []
    for world, observed in seen:
        frames, views, count = len(world.truth.t_ns), len(world.rig.cameras), world.joint_seen.shape[2]
        exact = exact_views(world, (0.0,) * views)
        off, score = np.full((frames, views, count, 17, 2), np.nan), np.zeros((frames, views, count, 17))
        told: list[list[list[list[Report]]]] = [
            [[[] for _ in world.classes] for _ in range(views)] for _ in range(frames)
        ]
        left = [[ViewDetections.empty()] * views for _ in range(frames)]
        for instant in observed.instants:
            frame = int(np.abs(world.truth.t_ns - instant.frame_set.t_ns).argmin())
            for view, found in enumerate(instant.views):
                people = _workers(exact, world, frame, view, found, off, score)
                things = _objects(exact, world, frame, view, found, told[frame][view])
                left[frame][view] = _only(found, people, things)
        strays.append(tuple(tuple(row) for row in left))
        follows = np.arange(frames) < frames - 1
        shows = shows_of(world.worker_share)
        for view in range(views):
            for who in range(count):
                at = (slice(None), view, who)
                workers.append(
                    (
                        follows,
                        shows[at],
                        np.asarray((score[at] > 0).any(axis=1)),
                        world.joint_seen[at],
                        off[at],
                        score[at],
                    )
                )
            for thing, name in enumerate(world.classes):
                own = tuple(tuple(told[frame][view][thing]) for frame in range(frames))
                objects.setdefault(name, []).append((follows, shows_of(world.object_share[:, view, thing]), own))
    return NetworkErrors(
        WorkerRows(*(np.concatenate(parts) for parts in zip(*workers, strict=True))),
        {
            name: ObjectRows(
                np.concatenate([row[0] for row in rows]),
                np.concatenate([row[1] for row in rows]),
                tuple(reports for row in rows for reports in row[2]),
            )
            for name, rows in objects.items()
        },
        tuple(strays),
    )


def _workers(
    exact: Exact, world: World, frame: int, view: int, found: ViewDetections, off: Floats, score: Floats
) -> Bools:
    """Write down how far off each worker's joints are; (P,) which of the people are nobody."""
    stray = np.ones(len(found.people_px), dtype=np.bool_)
    there = np.flatnonzero(shows_of(world.worker_share[frame, view]) > 0)
    if not len(there) or not len(stray):
        return stray
    joints = exact.joints_px[frame, view, there]
    apart = found.people_px[:, None] - joints
    known = np.isfinite(apart[..., 0])
    distance = np.where(known, np.linalg.norm(apart, axis=-1), 0.0).sum(axis=-1) / np.maximum(known.sum(axis=-1), 1)
    cost = np.where(known.any(axis=-1), distance / sizes_px(joints), np.inf)
    cost = np.where(np.isfinite(cost), cost, 1e3)
    for person, near in zip(*linear_sum_assignment(cost), strict=True):
        if cost[person, near] <= _PERSON_OFF:
            at = (frame, view, there[near])
            off[at] = apart[person, near] / sizes_px(joints[near])
            score[at] = np.where(known[person, near], found.people_score[person], 0.0)
            stray[person] = False
    return stray


def _objects(
    exact: Exact, world: World, frame: int, view: int, found: ViewDetections, told: list[list[Report]]
) -> Bools:
    """Write down what is reported of each object; (K,) which of the reports are of nothing."""
    stray = np.ones(len(found.object_class), dtype=np.bool_)
    boxes = exact.shown_xyxy[frame, view]
    there = (shows_of(world.object_share[frame, view]) > 0) & np.isfinite(boxes).all(axis=-1)
    for number, (name, box) in enumerate(zip(found.object_class, found.object_xyxy, strict=True)):
        overlap = np.where(there, _overlaps(box, boxes), 0.0)
        same = np.array([own == name for own in world.classes])
        value = np.where(overlap >= np.where(same, _SAME_IOU, _OTHER_IOU), overlap + same, 0.0)
        if not len(value) or value.max() == 0.0:
            continue
        thing, stray[number] = int(value.argmax()), False
        middle, size = _frame_of(boxes[thing])
        start = exact.learned_px[frame, view, thing] if same[thing] else np.tile(middle, (4, 1))
        points = (found.object_keypoints_px[number] - start) / size
        edges = (box - np.tile(middle, 2)) / np.tile(size, 2)
        told[thing].append(Report(name, edges, points, float(found.object_score[number])))
    return stray


def _frame_of(box: Floats) -> tuple[Floats, Floats]:
    """Middle and size of a box, one pixel at the least."""
    return (box[:2] + box[2:]) / 2, np.maximum(box[2:] - box[:2], 1.0)


def _overlaps(box: Floats, boxes: Floats) -> Floats:
    """(T,) intersection over union of a box with boxes (T, 4)."""
    with np.errstate(invalid="ignore"):
        shared = np.clip(np.minimum(box[2:], boxes[:, 2:]) - np.maximum(box[:2], boxes[:, :2]), 0.0, None).prod(axis=-1)
        areas = [np.prod(each[..., 2:] - each[..., :2], axis=-1) for each in (box, boxes)]
        return np.asarray(np.nan_to_num(shared / (areas[0] + areas[1] - shared)))


def _only(found: ViewDetections, people: Bools, things: Bools) -> ViewDetections:
    names = tuple(name for name, kept in zip(found.object_class, things.tolist(), strict=True) if kept)
    return ViewDetections(
        found.people_px[people], found.people_score[people], names, found.object_xyxy[things],
        found.object_score[things], found.object_keypoints_px[things],
    )  # fmt: skip
