"""Offsets of cameras to within half a frame: epipolar errors at every offset of a grid, pair by pair, then together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rigcal.geometry import Bools, Floats, Ints
from rigcal.sync.content.points.epipolar import fundamental, sampson_px
from rigcal.sync.content.points.seen import SeenPoints

SAMPLES = 6000
"""Points compared per pair of cameras and offset; a pair takes about a second for 3 s either way at 30 fps."""
STEPS_PER_FRAME = 3
BLOCK_S = 1.0
"""What is seen within a second is one observation: hands and people move no faster to and fro."""
_LEAST_SCALE_PX = 0.5
_LEAST_SHARE = 0.3  # of a pair's greatest overlap, below which an offset is not judged
_LEAST_COMPARED = 30
_SWEEPS = 8
_SEED = 20_112  # of the choice of points


@dataclass(frozen=True, slots=True, eq=False)
class PairCost:
    """What each lag ``offset of first - offset of second`` costs a pair of cameras."""

    first: int
    second: int
    cost: Floats
    """(B, L) sum of costs between 0 and 1 in each block of time, per lag."""
    count: Ints
    """(B, L) points compared."""

    @property
    def mean(self) -> Floats:
        """(L,) cost per point; NaN for lags at which too little overlaps."""
        count = self.count.sum(axis=0)
        enough = count >= max(_LEAST_COMPARED, _LEAST_SHARE * count.max(initial=0))
        return np.where(enough, self.cost.sum(axis=0) / np.maximum(count, 1), np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Where the search put one camera, all others being where they were put."""

    offset_s: float
    offsets_s: Floats
    """(L,) every offset that was tried."""
    cost: Floats
    """(L,) its cost per point; NaN where too little overlaps."""
    rival_s: float | None
    """The second-best offset, a minimum of its own; None where there is none."""
    rival_height: float
    """How much more the rival costs than the best, as a share of how much more the median offset does; infinite
    without a rival."""
    lead: float
    """How far the best leads before the rival, in standard errors over blocks of time; infinite without a rival."""
    depth: float
    """Cost of the best over the median cost, as a share."""
    at_edge: bool
    """Whether the best is at an end of what was searched."""


def search_offsets(cameras: Sequence[SeenPoints], start_s: Floats, *, search_s: float) -> list[Found | None]:
    """The likeliest offset of every camera; the first's is its start.

    Args:
        cameras: M cameras.
        start_s: (M,) offsets around which to search.
        search_s: The most that two cameras may be apart from where they start.

    Returns:
        Per camera what was found; None for one that overlaps with no other.
    """
    step_s = min(seen.spacing_s for seen in cameras) / STEPS_PER_FRAME
    reach = max(1, round(search_s / step_s))
    lags = np.arange(-reach, reach + 1)
    blocks = _Blocks.of(cameras, start_s)
    pairs = [
        _pair_cost(cameras, (a, b), start_s[a] - start_s[b] + lags * step_s, blocks, start_s)
        for a, b in combinations(range(len(cameras)), 2)
    ]
    table = _Table(len(cameras), reach, pairs)
    placed = table.place()
    return [table.found(c, placed, start_s[c], step_s) if c in placed else None for c in range(len(cameras))]


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Blocks of time that all cameras share."""

    first: int
    count: int

    @classmethod
    def of(cls, cameras: Sequence[SeenPoints], start_s: Floats) -> _Blocks:
        ends = [
            (seen.t_s[[0, -1]] + start) // BLOCK_S
            for seen, start in zip(cameras, start_s, strict=True)
            if len(seen.t_s)
        ]
        low, high = int(np.min(ends, initial=np.inf)), int(np.max(ends, initial=-np.inf))
        return cls(low, high - low + 1)


def _pair_cost(
    cameras: Sequence[SeenPoints],
    pair: tuple[int, int],
    lag_s: Floats,
    blocks: _Blocks,
    start_s: Floats,
) -> PairCost:
    one, two = (cameras[c] for c in pair)
    frame, point = _choose(one, two)
    matrix = fundamental(one.px_from_rig, two.px_from_rig)
    error = np.full((len(lag_s), len(frame)), np.nan, dtype=np.float32)
    if len(two.t_s) > 1:
        for row, lag in enumerate(lag_s):
            there = _linear(two, one.t_s[frame] + lag, point)
            error[row] = sampson_px(one.px[frame, point], there, matrix)
    known = np.isfinite(error)
    cost = np.where(known, _robust(error, known), 0.0)
    block = ((one.t_s[frame] + start_s[pair[0]]) // BLOCK_S).astype(np.int64) - blocks.first
    member = (block[:, None] == np.arange(blocks.count)).astype(np.float32)
    return PairCost(*pair, (cost @ member).T.astype(np.float64), np.rint(known @ member).T.astype(np.int64))


def _choose(one: SeenPoints, two: SeenPoints) -> tuple[Ints, Ints]:
    """Frames and points to compare, at most :data:`SAMPLES`: those that move, of points that the other saw too."""
    step = np.linalg.norm(np.diff(one.px, axis=0), axis=-1)
    speed = np.concatenate([step, step[-1:]]) if len(step) else np.zeros(one.px.shape[:2])
    usable = np.isfinite(one.px).all(axis=-1) & np.isfinite(two.px).all(axis=-1).any(axis=0)
    frame, point = np.nonzero(usable)
    if len(frame) > SAMPLES:
        rng = np.random.default_rng(_SEED)
        weight = np.minimum(np.nan_to_num(speed[frame, point]), 20.0) + 0.1
        picked = np.sort(rng.choice(len(frame), SAMPLES, replace=False, p=weight / weight.sum()))
        frame, point = frame[picked], point[picked]
    return frame, point


def _linear(seen: SeenPoints, at_s: Floats, point: Ints) -> Floats:
    """(N, 2) undistorted pixels at times between two frames that follow one another; NaN elsewhere."""
    after = np.clip(np.searchsorted(seen.t_s, at_s, side="right"), 1, len(seen.t_s) - 1)
    before = after - 1
    gap = seen.t_s[after] - seen.t_s[before]
    share = (at_s - seen.t_s[before]) / np.maximum(gap, 1e-9)
    share = np.where((share >= 0) & (share <= 1) & (gap < 2 * seen.spacing_s), share, np.nan)[:, None]
    return np.asarray((1 - share) * seen.px[before, point] + share * seen.px[after, point])


def _robust(error: np.ndarray[tuple[int, int], np.dtype[np.float32]], known: Bools) -> Floats:
    """Costs between 0 and 1 (Geman and McClure), scaled by what the best lag leaves over, and by the grid's step.

    Otherwise a sharp minimum would look deeper than its like whose middle lies between two steps.
    """
    count = known.sum(axis=1)
    enough = np.flatnonzero(count >= max(_LEAST_COMPARED, _LEAST_SHARE * count.max(initial=0)))
    if not len(enough):
        return np.ones(error.shape)
    size = [float(np.median(np.abs(error[row, known[row]]))) for row in enough]
    best = int(enough[np.argmin(size)])
    beside = np.abs(np.diff(error[max(best - 1, 0) : best + 2], axis=0))
    per_step = float(np.median(beside[np.isfinite(beside)])) if np.isfinite(beside).any() else 0.0
    scale = max(2 * min(size), per_step, _LEAST_SCALE_PX)
    return np.asarray(error**2 / (error**2 + scale**2), dtype=np.float64)


class _Table:
    """Costs of all pairs, and offsets of cameras in steps of the grid."""

    def __init__(self, count: int, reach: int, pairs: Sequence[PairCost]) -> None:
        self._count, self._reach = count, reach
        self._pairs = {(p.first, p.second): p for p in pairs}
        self._mean = {key: pair.mean for key, pair in self._pairs.items()}

    def place(self) -> dict[int, int]:
        """Steps of every camera that overlaps with the others: the clearest first, then each in turn again."""
        placed = {0: 0}
        while len(placed) < self._count:
            profiles = {c: self._profile(c, placed) for c in range(self._count) if c not in placed}
            contrast = {c: _contrast(p) for c, p in profiles.items() if np.isfinite(p).any()}
            if not contrast:
                break
            clearest = max(contrast, key=lambda c: contrast[c])
            placed[clearest] = int(np.nanargmin(profiles[clearest])) - self._reach
        for _ in range(_SWEEPS):
            before = dict(placed)
            for camera in [c for c in placed if c]:
                placed[camera] = int(np.nanargmin(self._profile(camera, placed))) - self._reach
            if placed == before:
                break
        return placed

    def found(self, camera: int, placed: Mapping[int, int], start_s: float, step_s: float) -> Found:
        """What the search says of one camera."""
        steps = np.arange(-self._reach, self._reach + 1)
        offsets_s = np.asarray(start_s + steps * step_s, dtype=np.float64)
        profile = self._profile(camera, placed)
        if camera == 0 or not np.isfinite(profile).any():
            return Found(start_s, offsets_s, profile, None, np.inf, np.inf, 1.0, False)
        best = int(np.nanargmin(profile))
        rival = _rival(profile, best)
        tried = np.flatnonzero(np.isfinite(profile))
        return Found(
            float(offsets_s[best]),
            offsets_s,
            profile,
            None if rival is None else float(offsets_s[rival]),
            np.inf if rival is None else float((profile[rival] - profile[best]) / max(_contrast(profile), 1e-12)),
            np.inf if rival is None else self._lead(camera, placed, int(steps[best]), int(steps[rival])),
            float(profile[best] / max(float(np.nanmedian(profile)), 1e-12)),
            best - tried[0] < STEPS_PER_FRAME or tried[-1] - best < STEPS_PER_FRAME,
        )

    def _profile(self, camera: int, placed: Mapping[int, int]) -> Floats:
        """(L,) mean cost of a camera's offsets against all others that are placed; NaN where none overlaps."""
        total, pairs = np.zeros(2 * self._reach + 1), np.zeros(2 * self._reach + 1)
        for other, step in placed.items():
            if other == camera:
                continue
            cost = self._against(camera, other, step)
            known = np.isfinite(cost)
            total[known] += cost[known]
            pairs[known] += 1
        enough = (pairs > 0) & (pairs >= 0.5 * pairs.max())
        return np.where(enough, total / np.maximum(pairs, 1), np.nan)

    def _against(self, camera: int, other: int, step: int) -> Floats:
        """(L,) the pair's cost of each offset of the camera, where the other is ``step`` steps off."""
        forward = (camera, other) in self._mean
        mean = self._mean[camera, other] if forward else self._mean[other, camera][::-1]
        lag = np.arange(-self._reach, self._reach + 1) - step + self._reach
        inside = (lag >= 0) & (lag < len(mean))
        return np.where(inside, mean[np.clip(lag, 0, len(mean) - 1)], np.nan)

    def _lead(self, camera: int, placed: Mapping[int, int], best: int, rival: int) -> float:
        """How much less the best costs than the rival, in standard errors over blocks of time."""
        difference: list[Floats] = []
        for (first, second), pair in self._pairs.items():
            if camera not in (first, second) or not {first, second} <= placed.keys():
                continue
            other, sign = (second, 1) if camera == first else (first, -1)
            columns = [sign * (step - placed[other]) + self._reach for step in (best, rival)]
            if min(columns) < 0 or max(columns) >= pair.cost.shape[1]:
                continue
            cost, count = pair.cost[:, columns], pair.count[:, columns]
            both = (count > 0).all(axis=1)
            difference.append(np.where(both, (cost / np.maximum(count, 1)) @ [-1.0, 1.0] * count[:, 0], 0.0))
        total = np.sum(difference, axis=0)
        used = total[total != 0]
        if len(used) < 2:
            return 0.0
        return float(used.mean() / (used.std(ddof=1) / np.sqrt(len(used)) + 1e-12))


def _contrast(profile: Floats) -> float:
    return float(np.nanmedian(profile) - np.nanmin(profile))


def _rival(profile: Floats, best: int) -> int | None:
    """The least minimum that is further than a frame and a half from the best one."""
    filled = np.where(np.isfinite(profile), profile, np.inf)
    padded = np.concatenate([[np.inf], filled, [np.inf]])
    lowest = np.isfinite(filled) & (padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:])
    lowest[max(0, best - 3 * STEPS_PER_FRAME // 2) : best + 3 * STEPS_PER_FRAME // 2 + 1] = False
    others = np.flatnonzero(lowest)
    return int(others[np.argmin(filled[others])]) if len(others) else None
