"""Two views' people at every lag between their clocks: how much of what both see lies on epipolar lines.

What is compared is the signed distance of a joint from the epipolar line of the same joint in the other view, over
the person's size. Its mean over a second is taken out first, within limits: a calibration that is off by pixels and a
detector's own idea of where a hip is leave such a mean at every lag, while a clock that is off leaves distances that
follow the motion. (On the shared captures one camera is off by 36 px: with the mean left in, its three pairs are best
3 to 4 frames away from the truth; without it, all are best at the truth.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from rigcal.geometry import Floats, Ints
from rigcal.sync.content.people.views import PeopleView, Singles

TRUNCATION = 0.03
"""Distance from the epipolar line, over the person's size, at which a joint counts as not matched: 25 px for an
athlete of 800 px, 9 px for a worker of 300 px."""
MAX_BIAS = 0.06
"""Largest mean distance that is taken out, over the person's size; what is beyond it speaks against the match."""
BIAS_S = 1.0
"""Time over which the mean is taken: about a stride."""
MATCHED_S = 1 / 3
"""Time over which who is who across the views is decided at once: long enough for noise to average out, short enough
that a tracklet which changed persons is soon matched rightly again."""
BLOCK_S = 0.3334
"""Time whose agreement is kept as one figure: the unit of evidence."""
_MIN_JOINTS = 3
"""Joints that two people must share to be compared."""
_MIN_SINE = 0.05
"""Sine of the angle to the other camera below which a joint has no useful epipolar line."""


@dataclass(frozen=True, slots=True, eq=False)
class PairCurve:
    """Agreement of two views at K lags, in B blocks of time."""

    score: Floats
    """(K, B) instants times people that were matched, each counted by how near its joints are to the epipolar lines
    (1: on them, 0: farther than the truncation)."""
    possible: Floats
    """(K, B) instants times people that could have been matched: those of the view that has fewer."""
    common_s: Floats
    """(K,) time in which both views see somebody."""


class ViewPair:
    """Two views and the baseline between their cameras, with what does not depend on the lag computed once."""

    def __init__(self, first: PeopleView, second: PeopleView, baseline_in_rig: Floats) -> None:
        unit = (baseline_in_rig / np.linalg.norm(baseline_in_rig)).astype(np.float32)
        self.first, self.second = first, second
        self._normal, by_first = _planes(first, unit)
        by_second = _planes(second, unit)[1]
        half = np.float32(0.5 / TRUNCATION)
        self._first_scale = half * by_first, half / first.size_rad[..., None]
        self._second_scale = by_second, 1 / second.size_rad[..., None]
        self._counts = first.people.sum(axis=0), second.people.sum(axis=0)

    def curve(self, lags: Ints) -> PairCurve:
        """The agreement at each lag: an instant of the first view meets the one ``lag`` steps before in the second."""
        block = max(1, round(BLOCK_S / self.first.step_s))
        blocks = -(-self.first.instants // block)
        score, possible = np.zeros((len(lags), blocks)), np.zeros((len(lags), blocks))
        common_s = np.zeros(len(lags))
        for row, lag in enumerate(lags):
            here, there = self.overlap(int(lag))
            which = np.arange(here.start, here.stop) // block
            could = np.minimum(self._counts[0][here], self._counts[1][there])
            common_s[row] = np.count_nonzero(could) * self.first.step_s
            possible[row] = np.bincount(which, could, minlength=blocks)
            score[row] = np.bincount(which, self._matched(here, there), minlength=blocks)
        return PairCurve(score, possible, common_s)

    def overlap(self, lag: int) -> tuple[slice, slice]:
        """Columns of the first and of the second view that meet at a lag."""
        shift = self.second.first + lag - self.first.first
        start = min(max(0, shift), self.first.instants)
        stop = max(start, min(self.first.instants, self.second.instants + shift))
        return slice(start, stop), slice(start - shift, stop - shift)

    def nearness(self, here: slice, there: slice) -> Singles:
        """(P, Q, T') mean over the shared joints of 1 - (distance / truncation)^2, where that is above 0."""
        normal, direction = self._normal[:, :, None, here], self.second.direction[:, None, :, there]
        distance = normal[0] * direction[0]
        distance += normal[1] * direction[1]
        distance += normal[2] * direction[2]
        (sine_a, size_a), (sine_b, size_b) = self._first_scale, self._second_scale
        scale = sine_a[:, None, here] * size_b[None, :, there]
        scale += size_a[:, None, here] * sine_b[None, :, there]
        distance *= scale
        known = np.isfinite(distance)
        distance[~known] = 0
        distance -= _local_mean(distance, known, max(1, round(BIAS_S / self.first.step_s)))
        near = 1 - np.square(distance)
        shared = known.sum(axis=-1)
        total = np.where(known & (near > 0), near, np.float32(0)).sum(axis=-1)
        return np.asarray(np.where(shared >= _MIN_JOINTS, total / np.maximum(shared, 1), 0), dtype=np.float32)

    def _matched(self, here: slice, there: slice) -> Singles:
        """(T',) nearness of the people that are matched, summed over them."""
        near = self.nearness(here, there)
        found = np.zeros(near.shape[2], dtype=np.float32)
        length = max(1, round(MATCHED_S / self.first.step_s))
        starts = np.arange(0, near.shape[2], length)
        totals = np.add.reduceat(near, starts, axis=2) if len(starts) else near
        for k, start in enumerate(starts):
            rows, columns = linear_sum_assignment(totals[:, :, k], maximize=True)
            found[start : start + length] = near[rows, columns, start : start + length].sum(axis=0)
        return found


def _planes(view: PeopleView, baseline: Singles) -> tuple[Singles, Singles]:
    """Normals (3, P, T, 13) of the epipolar planes times the sine of the angle to the baseline, and 1 / sine."""
    normal = np.cross(baseline, view.direction, axisb=0, axisc=0).astype(np.float32)
    sine = np.sqrt(np.square(normal).sum(axis=0))
    return normal, np.where(sine > _MIN_SINE, 1 / np.maximum(sine, np.float32(_MIN_SINE)), np.float32(np.nan))


def _local_mean(distance: Singles, known: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], window: int) -> Singles:
    """The mean around each instant of the known values over a window that is whole at the ends too, within limits.

    Values and limits are in units of the truncation; what is unknown is 0 in ``distance``.
    """
    limit = np.float32(MAX_BIAS / TRUNCATION)
    length = distance.shape[2]
    start = np.clip(np.arange(length) - window // 2, 0, max(length - window, 0))
    end = np.minimum(start + window, length)
    total = _running_sum(np.clip(distance, -limit - 1, limit + 1))
    count = _running_sum(known)
    mean = (total[:, :, end] - total[:, :, start]) / np.maximum(count[:, :, end] - count[:, :, start], 1)
    return np.asarray(np.clip(mean, -limit, limit), dtype=np.float32)


def _running_sum(values: Singles | np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> Singles:
    """(P, Q, T + 1, 13) sums of all values before each instant."""
    sums = np.zeros((*values.shape[:2], values.shape[2] + 1, values.shape[3]), dtype=np.float32)
    np.cumsum(values, axis=2, out=sums[:, :, 1:])
    return sums
