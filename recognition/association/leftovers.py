"""Which of the detections that no track claimed show one worker or one object.

Every two detections of different views are compared along their epipolar lines: their rays meet, or miss each other by
so many standard deviations. Where they meet they place a body, and a body has limbs of human length: that tells people
apart who stand in one epipolar plane, as heads and hats do before cameras at the height of a head. The placed body is
then looked for in every other view. The hypothesis that explains most detections becomes a group and takes them away
from the others, until none is left. A group is consistent around every cycle of its views, since all of them agree
with one place in 3D.

A hint, somebody who scored too little to count alone, begins no group with another hint, but joins a group and is
claimed by a track like anybody else. Detectors score low whoever stands behind others, and it is those of whom few
cameras see anything. ByteTrack has a second threshold for the same reason (Zhang et al., 2022); it asks the past, this
the other cameras too. In nine rendered sequences of four workers (eight of validation, the demo), 2480 times a worker,
the bundled networks' people (scores from 0.44 on) place a worker 2093 times, and one who is not there 11 times; with
hints from 0.15 on that is 2352 and 6 times, and 2346 and 51 times where the same people are no hints.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import log1p

import numpy as np

from recognition.observed import Detected
from recognition.optics import MIN_PARALLAX_RAD, NEAREST_M, POINTS_AT_ONCE, Optics, midpoints, pairs
from rigcal.geometry import Bools, Floats, Ints

DEGREES = 4.0
"""Of freedom of the errors' distribution, as for claims."""
MOST_PAIRS_EACH = 6
"""Hypotheses kept per detection, those of least cost: more only where a crowd appears at once."""
SEED_VIEWS, MOST_AT_ONCE = 5, 80
"""Of more detections than this, pairs are first taken from the views that have most of them, and then from what is left
in all. Sixteen people who appear at once before twenty cameras are placed in 0.09 s, instead of 0.45 (CPU time)."""
_ENDS = np.array([(5, 7), (6, 8), (7, 9), (8, 10), (11, 13), (12, 14), (13, 15), (14, 16), (5, 6), (5, 11), (6, 12)]).T
_LENGTH_M = np.array([0.30, 0.30, 0.25, 0.25, 0.42, 0.42, 0.41, 0.41, 0.36, 0.50, 0.50])
"""Segments of an adult of 1.70 m (Drillis and Contini)."""
_SPREAD = 0.35
"""Of the logarithm of a placed limb's length over that: children and errors of detectors included."""


@dataclass(frozen=True, slots=True, eq=False)
class Leftovers:
    """G groups of detections of at least two views."""

    members: Ints
    """(G, V) row of the detection in each view, -1 where none."""
    place_m: Floats
    """(G, J, 3) where the best pair of each group places its points; NaN where it does not."""


def group(
    optics: Optics, detected: Detected, free: Ints, *, min_shared: int, max_sigmas: float, max_parallax_var: float
) -> Leftovers:
    """Group detections that are free.

    Args:
        optics: Of the rig.
        detected: Detections.
        free: (L,) rows of those to group, ascending.
        min_shared: How many points two of one group must share.
        max_sigmas: How far they may be apart, in standard deviations.
        max_parallax_var: m^2, the largest variance along its rays with which two views may place a point.
    """
    rules = _Rules(min_shared, max_sigmas, max_parallax_var)
    if len(free) <= MOST_AT_ONCE:
        return _grouped(optics, detected, free, free, rules)
    crowded = np.argsort(-np.bincount(detected.view[free], minlength=optics.views), kind="stable")[:SEED_VIEWS]
    seeds = free[np.isin(detected.view[free], crowded)]
    most = _grouped(optics, detected, free, seeds, rules)
    rest = np.setdiff1d(free, most.members)
    last = _grouped(optics, detected, rest, rest, rules)
    return Leftovers(np.concatenate([most.members, last.members]), np.concatenate([most.place_m, last.place_m]))


@dataclass(frozen=True, slots=True)
class _Rules:
    """What two detections of one group must be: see :func:`group`."""

    min_shared: int
    max_sigmas: float
    max_parallax_var: float

    @property
    def limit(self) -> float:
        """Of the costs."""
        return log1p(self.max_sigmas**2 / DEGREES) * (DEGREES / 2 + 1)


def _grouped(optics: Optics, detected: Detected, free: Ints, seeds: Ints, rules: _Rules) -> Leftovers:
    """Groups of free detections, each begun by two of the seeds."""
    none = Leftovers(np.full((0, optics.views), -1), np.zeros((0, detected.seen.shape[1], 3)))
    if len(seeds) < 2:
        return none
    first, second = _pairs(detected, seeds)
    if not len(first):
        return none
    place, placed, costs = _hypotheses(optics, detected, first, second, rules)
    good = np.flatnonzero(costs < rules.limit)
    if not len(good):
        return none
    good = good[np.argsort(costs[good], kind="stable")[: MOST_PAIRS_EACH * len(seeds)]]
    first, second, place, placed, costs = first[good], second[good], place[good], placed[good], costs[good]
    same = detected.label[free] == detected.label[first][:, None]
    gain = np.where(same, rules.limit - _transferred(optics, detected, free, place, placed, rules.min_shared), 0.0)
    slot = np.full(detected.count, -1)
    slot[free] = np.arange(len(free))
    own, pair = np.stack([slot[first], slot[second]]), np.arange(len(good))
    gain[pair, own[0]] = gain[pair, own[1]] = rules.limit - costs
    return _picked(optics, detected, free, own, np.maximum(gain, 0.0), place, placed)


def _pairs(detected: Detected, free: Ints) -> tuple[Ints, Ints]:
    first, second = pairs(len(free))
    first, second = free[first], free[second]
    able = (detected.view[first] != detected.view[second]) & (detected.label[first] == detected.label[second])
    able &= ~(detected.hint[first] & detected.hint[second])
    return first[able], second[able]


def _hypotheses(
    optics: Optics, detected: Detected, first: Ints, second: Ints, rules: _Rules
) -> tuple[Floats, Bools, Floats]:
    """What pairs place (H, J, 3), which points of it are placed (H, J), and the costs (H,)."""
    rays = optics.rays(detected.factors[1:3, :-1].transpose(1, 2, 0), detected.view)
    starts = optics.centre_m[detected.view][:, None]
    place, parallax = midpoints(starts[first], rays[first], starts[second], rays[second])
    to_first, to_second = place - starts[first], place - starts[second]
    ahead_first, ahead_second = (to_first * rays[first]).sum(-1), (to_second * rays[second]).sum(-1)
    apart = to_first - ahead_first[..., None] * rays[first]
    square = 4 * (apart * apart).sum(-1)  # the midpoint is half of the distance from either ray
    variance = detected.spread_var[first] + detected.spread_var[second]
    variance += detected.angle_var[first] * ahead_first**2 + detected.angle_var[second] * ahead_second**2
    both = detected.seen[first] & detected.seen[second]
    both &= (ahead_first > NEAREST_M) & (ahead_second > NEAREST_M)
    placed = both & (parallax > MIN_PARALLAX_RAD) & (variance < rules.max_parallax_var * parallax * parallax)
    count = placed.sum(axis=1)
    cost = (np.log1p(square / (DEGREES * variance)) * (DEGREES / 2 + 0.5) * placed).sum(axis=1) / np.maximum(count, 1)
    cost += _unlikely_limbs(place, placed)
    return place, placed, np.where(count >= rules.min_shared, cost, np.inf)


def _unlikely_limbs(place: Floats, placed: Bools) -> Floats:
    """(H,) cost of limbs of other than human length; 0 for objects."""
    if place.shape[1] != 17:
        return np.zeros(len(place))
    limb = place[:, _ENDS[0]] - place[:, _ENDS[1]]
    known = placed[:, _ENDS[0]] & placed[:, _ENDS[1]]
    length = np.sqrt((limb * limb).sum(axis=-1)) / _LENGTH_M
    off = np.log(np.maximum(length, 1e-3)) / _SPREAD
    costs = np.minimum(off * off / 2, 8.0) * known
    return np.asarray(costs.sum(axis=1) / np.maximum(known.sum(axis=1), 1))


def _transferred(
    optics: Optics, detected: Detected, free: Ints, place: Floats, placed: Bools, min_shared: int
) -> Floats:
    """(H, L) cost of each free detection as another sight of what a pair places; infinite where it shares too few."""
    hypotheses, points = placed.shape
    in_cam = optics.in_cameras(place.reshape(-1, 3)).reshape(3, -1, hypotheses, points)
    ends = np.searchsorted(detected.view[free], np.arange(optics.views + 1)).tolist()
    at_once = max(1, POINTS_AT_ONCE // placed.size)
    costs = [
        _off(in_cam[:, view], detected, free[start : min(start + at_once, end)], placed, min_shared)
        for view, (first, end) in enumerate(pairwise(ends))
        for start in range(first, end, at_once)
    ]
    return np.concatenate(costs).T


def _off(in_cam: Floats, detected: Detected, rows: Ints, placed: Bools, min_shared: int) -> Floats:
    """(R, H) cost of detections of one camera as sights of points (3, H, J) in its frame."""
    depth = np.maximum(in_cam[2], NEAREST_M)
    square = in_cam[0] / depth - detected.factors[1, rows, None]
    square *= square
    dy = in_cam[1] / depth - detected.factors[2, rows, None]
    dy *= dy
    square += dy
    variance = detected.spread_var[rows, None] / (depth * depth)
    variance += detected.angle_var[rows, None]
    variance *= 3 * DEGREES
    both = detected.seen[rows, None] & (placed & (in_cam[2] > NEAREST_M))
    costs = np.log1p(np.divide(square, variance, out=square), out=square)
    costs *= DEGREES / 2 + 1
    costs *= both
    count = both.sum(axis=-1)
    return np.where(count >= min_shared, costs.sum(axis=-1) / np.maximum(count, 1), np.inf)


def _picked(
    optics: Optics, detected: Detected, free: Ints, own: Ints, gain: Floats, place: Floats, placed: Bools
) -> Leftovers:
    """Hypotheses by what they explain, each without the detections of those before it."""
    view = detected.view[free]
    there, begin = np.unique(view, return_index=True)
    spans = [slice(*ends) for ends in pairwise([*begin.tolist(), len(view)])]
    best = np.zeros((len(gain), optics.views))
    rows, kept = [], []
    pair = np.arange(len(gain))
    while True:
        best[:, there] = np.maximum.reduceat(gain, begin, axis=1)
        alive = (gain[pair, own[0]] > 0) & (gain[pair, own[1]] > 0)
        total = best.sum(axis=1) * alive
        top = int(total.argmax())
        if total[top] <= 0:
            break
        row = [-1] * optics.views
        for v, span in zip(there.tolist(), spans, strict=True):
            if best[top, v] > 0:
                row[v] = span.start + int(gain[top, span].argmax())
        for slot in own[:, top]:
            row[view[slot]] = int(slot)
        rows.append([int(free[s]) if s >= 0 else -1 for s in row])
        kept.append(np.where(placed[top][:, None], place[top], np.nan))
        gain[:, [s for s in row if s >= 0]] = 0.0
    members = np.array(rows, dtype=np.int64).reshape(-1, optics.views)
    return Leftovers(members, np.array(kept).reshape(-1, place.shape[1], 3))
