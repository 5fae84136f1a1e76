"""One offset per camera that explains all pairs of views, and what else would explain them nearly as well.

Offsets are in steps of the raster of time; the lag of a pair is the offset of its second view less that of its first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Bools, Floats, Ints
from rigcal.sync.content.people.pairs import PairCurve

_LEAST_OVERLAP = 0.3
"""Share of a pair's greatest number of comparisons below which a lag is not judged."""
LEAST_S = 1.0
"""Time with people in both views below which a lag is not judged: with less, taking out the mean takes out most of the
motion, and on the shared captures lags near the ends then agree better than the true one."""
_SWEEPS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """What each change of one camera's offset costs, if others may change with it where that costs less."""

    change: Ints
    """(D,) change of the offset from the best one, in steps, ascending."""
    agreement: Floats
    """(D,) share of the people that are matched; NaN where too little overlaps to tell."""
    lead: Floats
    """(D,) how far the best leads, in standard errors over pairs of cameras and blocks of time; 0 where unknown."""


class PairTable:
    """The curves of all pairs of views, and offsets that explain them together.

    Args:
        curves: of the pairs (first, second), first below second.
        lags: (K,) lags of the curves, consecutive and symmetric about 0.
    """

    def __init__(self, curves: Mapping[tuple[int, int], PairCurve], lags: Ints) -> None:
        self._reach = int(lags[-1])
        self._curves = {pair: curve for pair, curve in curves.items() if curve.possible.any()}
        self._share = {pair: _share(curve) for pair, curve in self._curves.items()}
        self._weight = {pair: float(curve.possible.sum(axis=1).max()) for pair, curve in self._curves.items()}

    def linked(self, reference: int) -> tuple[int, ...]:
        """The views that pairs with common people join to the reference, itself included, ascending."""
        known, before = {reference}, 0
        while len(known) > before:
            before = len(known)
            known |= {view for pair in self._curves if known.intersection(pair) for view in pair}
        return tuple(sorted(known))

    def best(self, views: Sequence[int], reference: int) -> dict[int, int]:
        """The offsets of the best agreement of all pairs together; the reference's is 0."""
        trials = [self._settled(self._placed(views, root)) for root in views]
        chosen = max(trials, key=self._agreement)
        return {view: step - chosen[reference] for view, step in chosen.items()}

    def profile(self, view: int, offsets: Mapping[int, int], reference: int) -> Profile:
        """What changes of one view's offset would cost.

        A group of views that agree well with one another and badly with the rest may be off as a whole. Groups are
        what the tree of the clearest pairs falls into when one of its links is cut, and single views.
        """
        change = np.arange(-self._reach, self._reach + 1)
        cuts = [self._cut(group, offsets, change) for group in self._groups(view, offsets, reference)]
        middle, columns = self._reach, np.arange(len(change))
        weakest = np.argmin([lead for _, lead in cuts], axis=0)
        behind = np.stack([share[middle] - share for share, _ in cuts])[weakest, columns]
        own = self._cut(frozenset({view}), offsets, change)[0][middle]
        return Profile(change, own - behind, np.stack([lead for _, lead in cuts])[weakest, columns])

    def top(self, view: int, offsets: Mapping[int, int]) -> float:
        """The view's offset in parts of a step: the top of the parabola through the best and its neighbours."""
        tried = offsets[view] + np.arange(-1, 2)
        others = {other: step for other, step in offsets.items() if other != view}
        before, best, after = self._toward(view, others, tried)[0]
        bend = 2 * best - before - after
        return offsets[view] + (float(np.clip((after - before) / (2 * bend), -0.5, 0.5)) if bend > 0 else 0.0)

    def _against(self, pair: tuple[int, int], lag: Ints) -> Floats:
        """Share of a pair that agrees at lags of its first view before its second; the least one where not known."""
        share = self._share[pair]
        inside: Bools = np.abs(lag) <= self._reach
        found = share[np.clip(lag + self._reach, 0, len(share) - 1)]
        return np.where(inside & np.isfinite(found), found, np.nanmin(share))

    def _toward(self, view: int, offsets: Mapping[int, int], tried: Ints) -> tuple[Floats, float]:
        """Weighted sum of the agreement of a view with those that have an offset, at each offset tried; the weight."""
        total, weight = np.zeros(len(tried)), 0.0
        for (first, second), w in self._weight.items():
            if view == second and first in offsets:
                total += w * self._against((first, second), tried - offsets[first])
            elif view == first and second in offsets:
                total += w * self._against((first, second), offsets[second] - tried)
            else:
                continue
            weight += w
        return total, weight

    def _placed(self, views: Sequence[int], root: int) -> dict[int, int]:
        """Offsets given one by one, the clearest next."""
        offsets, tried = {root: 0}, np.arange(-2 * self._reach, 2 * self._reach + 1)
        while len(offsets) < len(views):
            open_views = [view for view in views if view not in offsets]
            totals = {view: self._toward(view, offsets, tried)[0] for view in open_views}
            clearest = max(open_views, key=lambda view: float(totals[view].max() - np.median(totals[view])))
            offsets[clearest] = int(tried[np.argmax(totals[clearest])])
        return offsets

    def _settled(self, offsets: dict[int, int]) -> dict[int, int]:
        """Offsets improved one at a time until none changes."""
        for _ in range(_SWEEPS):
            before = dict(offsets)
            for view in tuple(offsets):
                others = {other: step for other, step in offsets.items() if other != view}
                tried = np.arange(offsets[view] - self._reach, offsets[view] + self._reach + 1)
                offsets[view] = int(tried[np.argmax(self._toward(view, others, tried)[0])])
            if offsets == before:
                break
        return offsets

    def _agreement(self, offsets: Mapping[int, int]) -> float:
        lag = {(a, b): np.array([offsets[b] - offsets[a]]) for a, b in self._weight if a in offsets and b in offsets}
        return float(sum(self._weight[pair] * self._against(pair, lag[pair])[0] for pair in lag))

    def _groups(self, view: int, offsets: Mapping[int, int], reference: int) -> list[frozenset[int]]:
        """Groups with the view but without the reference."""
        everyone = frozenset(offsets)
        halves = [*self._halves(offsets), *(frozenset({v}) for v in everyone)]
        sides = {side if reference not in side else everyone - side for side in halves}
        return sorted((side for side in sides if view in side), key=sorted)

    def _halves(self, offsets: Mapping[int, int]) -> list[frozenset[int]]:
        """One side of each cut of the tree of the clearest pairs (Kruskal)."""
        part = {view: frozenset({view}) for view in offsets}
        halves: list[frozenset[int]] = []
        for pair in sorted(self._weight, key=lambda pair: -self._clearness(pair, offsets)):
            if pair[0] in part and pair[1] in part and part[pair[0]] is not part[pair[1]]:
                halves += [part[pair[0]], part[pair[1]]]
                joined = part[pair[0]] | part[pair[1]]
                part.update(dict.fromkeys(joined, joined))
        return halves

    def _clearness(self, pair: tuple[int, int], offsets: Mapping[int, int]) -> float:
        """How far a pair's agreement at its lag stands out of its curve."""
        if not set(pair) <= offsets.keys():
            return -np.inf
        lag = np.array([offsets[pair[1]] - offsets[pair[0]]])
        return self._weight[pair] * float(self._against(pair, lag)[0] - np.nanmedian(self._share[pair]))

    def _cut(self, group: frozenset[int], offsets: Mapping[int, int], change: Ints) -> tuple[Floats, Floats]:
        """Agreement (D,) across a cut when a group's offsets change together, and by how much no change leads (D,)."""
        score, possible = [], []
        for (first, second), curve in self._curves.items():
            if first not in offsets or second not in offsets or (first in group) == (second in group):
                continue
            lag = offsets[second] - offsets[first] + (change if second in group else -change)
            rows = lag + self._reach
            inside = (rows >= 0) & (rows < len(curve.score)) & self._judged((first, second), rows)
            rows = np.clip(rows, 0, len(curve.score) - 1)
            score.append(np.where(inside[:, None], curve.score[rows], 0.0))
            possible.append(np.where(inside[:, None], curve.possible[rows], 0.0))
        if not score:
            return np.full(len(change), np.nan), np.zeros(len(change))
        return _lead(np.concatenate(score, axis=1), np.concatenate(possible, axis=1), int(np.argmin(np.abs(change))))

    def _judged(self, pair: tuple[int, int], rows: Ints) -> Bools:
        share = self._share[pair]
        return np.asarray(np.isfinite(share[np.clip(rows, 0, len(share) - 1)]))


def _share(curve: PairCurve) -> Floats:
    """(K,) share of the people that agree; NaN at lags where too little overlaps."""
    score, possible = curve.score.sum(axis=1), curve.possible.sum(axis=1)
    enough = (curve.common_s >= LEAST_S - 1e-6) & (possible >= _LEAST_OVERLAP * possible.max())
    return np.where(enough, score / np.maximum(possible, 1), np.nan)


def _lead(score: Floats, possible: Floats, best: int) -> tuple[Floats, Floats]:
    """Share (D,) that agrees at each change, and the lead (D,) of the best in standard errors.

    The best and each change are compared over what can be judged at both, block by block.

    Args:
        score, possible: (D, N) of N observations: blocks of time of every pair.
        best: row of the best.
    """
    weight = np.minimum(possible, possible[best])
    ahead = score[best] / np.maximum(possible[best], 1) - score / np.maximum(possible, 1)
    total = weight.sum(axis=1)
    mean = (weight * ahead).sum(axis=1) / np.maximum(total, 1)
    used = np.count_nonzero(weight, axis=1)
    error = np.sqrt(np.square(weight * (ahead - mean[:, None])).sum(axis=1)) / np.maximum(total, 1)
    error *= np.sqrt(used / np.maximum(used - 1, 1))
    share = score[best].sum() / max(possible[best].sum(), 1.0) - mean
    return np.where(used > 1, share, np.nan), np.where(used > 1, mean / np.maximum(error, 1e-12), 0.0)
