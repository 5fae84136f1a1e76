"""A detector that errs as the bundled networks were seen to err: their errors, drawn again.

Each worker and object before each camera goes through rows of what was measured (:mod:`tools.study.errors`), one
instant after another, as long as as much of it shows; then through those of another. So what is missed stays missed for
a while, and a joint that is put on the other leg stays there. A joint that is hidden as it was in that row is as far
off as it was; otherwise as it was in any row in which it was hidden so. What was reported of nobody and nothing is
replayed as it was, a whole sequence at a time.

Not simulated: how light, lens, clothes and poses change what is missed, errors of several cameras or workers that have
one cause, a hat that is seen on a bare head (those are replayed where they were), and real people.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from recognition.observations import ViewDetections
from rigcal.geometry import Bools, Floats, Ints
from tools.study.detector import LEAST_JOINTS, Views
from tools.study.errors import NetworkErrors, Report, shows_of, sizes_px
from tools.study.exact import Exact
from tools.study.world import World


class MeasuredDetector:
    """The detector of one network's errors.

    Args:
        errors: What was measured.
    """

    def __init__(self, errors: NetworkErrors) -> None:
        self._errors = errors
        own = errors.workers
        self._rows_of_joint = {
            (joint, seen): np.flatnonzero(own.found & (own.seen[:, joint] == seen))
            for joint in range(17)
            for seen in range(4)
        }

    def reports(self, world: World, exact: Exact, rng: np.random.Generator) -> Iterator[Views]:
        """What it reports of a sequence, instant by instant."""
        views = exact.frame.shape[1]
        people = np.full((views, world.joint_seen.shape[2]), -1)
        things = np.full((views, len(world.classes)), -1)
        shown, worker_shown = shows_of(world.object_share), shows_of(world.worker_share)
        strays = self._strays(rng)
        for number, frames in enumerate(exact.frame.tolist()):
            stray, found = next(strays), []
            for view, frame in enumerate(frames):
                joints, score = self._people(
                    exact.joints_px[number, view],
                    world.joint_seen[frame, view],
                    worker_shown[frame, view],
                    people[view],
                    rng,
                )
                told = self._things(world, exact, (number, view), shown[frame, view], things[view], rng)
                found.append(_inside(joints, score, told, stray[view], exact.size_wh[view]))
            yield tuple(found)

    def _people(
        self, exact_px: Floats, seen: Ints, shows: Ints, last: Ints, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        own, joints, scores = self._errors.workers, [], []
        for who, part in enumerate(shows.tolist()):
            last[who] = row = own.drawn(int(last[who]), part, rng) if part else -1
            if row < 0 or not own.found[row]:
                continue
            rows = np.full(17, row)
            for joint in np.flatnonzero(own.seen[row] != seen[who]).tolist():
                alike = self._rows_of_joint[joint, int(seen[who, joint])]
                rows[joint] = rng.choice(alike) if len(alike) else row
            every = np.arange(17)
            joints.append(exact_px[who] + own.off[rows, every] * sizes_px(exact_px[who]))
            scores.append(own.score[rows, every])
        return np.array(joints).reshape(-1, 17, 2), np.array(scores).reshape(-1, 17)

    def _things(
        self, world: World, exact: Exact, at: tuple[int, int], shows: Ints, last: Ints, rng: np.random.Generator
    ) -> list[tuple[str, Floats, Floats, float]]:
        found = []
        for thing, (name, part) in enumerate(zip(world.classes, shows.tolist(), strict=True)):
            rows, box = self._errors.objects.get(name), exact.shown_xyxy[at][thing]
            last[thing] = row = rows.drawn(int(last[thing]), part, rng) if part and rows else -1
            if row < 0 or rows is None or not np.isfinite(box).all():
                continue
            found += [_placed(report, name, box, exact.learned_px[at][thing]) for report in rows.reports[row]]
        return found

    def _strays(self, rng: np.random.Generator) -> Iterator[Views]:
        while True:
            yield from self._errors.strays[int(rng.integers(len(self._errors.strays)))]


def _placed(report: Report, name: str, box: Floats, learned_px: Floats) -> tuple[str, Floats, Floats, float]:
    middle, size = (box[:2] + box[2:]) / 2, np.maximum(box[2:] - box[:2], 1.0)
    start = learned_px if report.name == name else np.tile(middle, (4, 1))
    edges = np.tile(middle, 2) + report.edges * np.tile(size, 2)
    return report.name, edges, start + report.points * size, report.score


def _inside(
    joints: Floats,
    score: Floats,
    told: list[tuple[str, Floats, Floats, float]],
    stray: ViewDetections,
    size_wh: Ints,
) -> ViewDetections:
    """Everything that is in the image."""

    def within(px: Floats) -> Bools:
        return np.asarray(((px > -0.5) & (px < size_wh - 0.5)).all(axis=-1))

    known = within(joints) & (score > 0)
    kept = known.sum(axis=1) >= LEAST_JOINTS
    joints, score = np.where(known[..., None], joints, np.nan)[kept], np.where(known, score, 0.0)[kept]
    boxes = np.array([box for _, box, _, _ in told]).reshape(-1, 4)
    points = np.array([points for _, _, points, _ in told]).reshape(-1, 4, 2)
    points = np.where(within(points)[..., None], points, np.nan)
    return ViewDetections(
        np.concatenate([joints, stray.people_px]),
        np.concatenate([score, stray.people_score]),
        (*(name for name, _, _, _ in told), *stray.object_class),
        np.concatenate([np.clip(boxes, -0.5, np.tile(size_wh, 2) - 0.5), stray.object_xyxy]),
        np.concatenate([[score for _, _, _, score in told], stray.object_score]),
        np.concatenate([points, stray.object_keypoints_px]),
    )
