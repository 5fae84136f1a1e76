"""Clocks from people to a small fraction of a frame: pairs of views, each free of what does not go with the motion.

A pair's residual is the distance of a joint from its epipolar line; it grows with the lag as the joint moves across
the line. Three things would pull a plain regression of the one on the other away from the truth:

- A calibration that is off, and a detector's own idea of a joint, differ from view to view and stay alike over a
  second. Residual and slope are taken less their means over a block of time, joint by joint (the within estimator:
  Wooldridge, Econometric Analysis of Cross Section and Panel Data, 2010, equation 10.46).
- The slope is noisy, and its noise is that of the residual. So each view's slope is paired with the other view's as
  its instrument (two-sample instruments: the same motion seen twice with independent noise), in a form whose weights
  are orthogonal to those of the interpolated position.
- Joints jump to the other leg or to another person. Residuals are weighted by Tukey's biweight.

Standard errors come from leaving out blocks of time, and from leaving out joints; the larger counts. A recording of
two seconds has too few blocks to tell, but many joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rigcal.geometry import Floats, Ints
from rigcal.sync.content.points.clocks import DRIFT, OFFSET, READOUT, Clocks
from rigcal.sync.content.points.interpolate import Interpolated, interpolate
from rigcal.sync.content.points.seen import SeenPoints

BLOCK_S = 2.0
"""Time over which means are taken: two strides. On simulated people the error is 1.4 ms with 1 s, 0.8 ms with 2 s; over
longer times a bias follows where the person walks."""
LEAST_BLOCKS = 5
"""Blocks of time below which their scatter says too little, and that of the joints has to do."""
_OFFSET_SIGMA_S = 0.1  # the search is right to 0.03 s
_TUKEY = 3.0
"""Robust standard deviations beyond which a residual has no weight. With 4.7 (95 % efficient for Gaussian noise) the
error on simulated people is 0.72 ms instead of 0.78, but the standard errors on real ones with many mistaken limbs
are 2.6 to 4.5 times as large."""
_ROUNDS, _DONE_S = 12, 1e-5
_MOST_POINTS = 60_000  # times times points of a pair
_LEAST_VALUES = 5  # of a joint in a block: fewer are used up by their mean
_JOINT_GROUP = np.array([0, 0, 0, 0, 0, *range(1, 13)])
JOINT_GROUPS = 13
"""Joints that are left out one after the other; those of the head are one, group 0."""


@dataclass(frozen=True, slots=True, eq=False)
class FineClocks:
    """Clocks of M cameras and how well the people tell them; those of the first are held."""

    clocks: Clocks
    sigma: Floats
    """(M, 2) standard deviation of offset in seconds and drift as a ratio."""
    blocks: int
    """Blocks of time that were compared."""
    unsettled_s: float
    """For recordings of few blocks: the most that an offset changes where means are taken over half the time, which
    tells what a bias that is not quite constant does. 0 otherwise."""
    residual_s: float
    """How far pairs by themselves disagree with one clock per camera: weighted root-mean-square, in seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """A pair's normal equations of its lag and its change with time, by block of time and joint."""

    matrix: Floats
    """(B, G, 2, 2) instrument times slope."""
    right: Floats
    """(B, G, 2) instrument times residual."""


def refine_people(cameras: Sequence[SeenPoints], clocks: Clocks, drift_sigma: float) -> FineClocks:
    """Solve for the clocks of all cameras but the first.

    Args:
        cameras: (M,) cameras, two or more; their points are the joints of people, 17 each.
        clocks: where to start, within about a tenth of a second; readouts are kept.
        drift_sigma: what is known of the drifts beforehand, as a ratio.
    """
    fine = _refined(cameras, clocks, drift_sigma, BLOCK_S)
    if fine.blocks >= LEAST_BLOCKS:
        return fine
    half = _refined(cameras, fine.clocks, drift_sigma, BLOCK_S / 2)
    change_s = np.abs(half.clocks.values - fine.clocks.values)[:, OFFSET].max()
    return replace(fine, unsettled_s=float(change_s))


def _refined(cameras: Sequence[SeenPoints], clocks: Clocks, drift_sigma: float, block_s: float) -> FineClocks:
    at_s = _compared_times(cameras, clocks)
    count = max(1, round((at_s[-1] - at_s[0]) / block_s))
    block = np.minimum(((at_s - at_s[0]) / (at_s[-1] - at_s[0] + 1e-9) * count).astype(np.int64), count - 1)
    pairs = list(combinations(range(len(cameras)), 2))
    start = clocks.values[:, [OFFSET, DRIFT]]
    beforehand = np.array([_OFFSET_SIGMA_S, drift_sigma]) ** -2.0
    for _ in range(_ROUNDS):
        system = _System.of(pairs, _all_sums(cameras, clocks, pairs, at_s, block), beforehand)
        values = clocks.values.copy()
        step = system.step(start - values[:, [OFFSET, DRIFT]])
        values[:, [OFFSET, DRIFT]] += step
        clocks = replace(clocks, values=values)
        if np.abs(step[:, OFFSET]).max() < _DONE_S:
            break
    sums = _all_sums(cameras, clocks, pairs, at_s, block)
    system = _System.of(pairs, sums, beforehand)
    return FineClocks(clocks, system.sigma(), count, 0.0, _disagreement_s(sums))


def _compared_times(cameras: Sequence[SeenPoints], clocks: Clocks) -> Floats:
    """Rig times of the frames of the camera with the fewest a second, no more than are of use."""
    slowest = int(np.argmax([seen.spacing_s for seen in cameras]))
    frames_s = clocks.frames_in_rig_s(slowest, cameras[slowest])
    stride = max(1, -(-len(frames_s) * cameras[0].px.shape[1] // _MOST_POINTS))
    return frames_s[::stride]


def _all_sums(
    cameras: Sequence[SeenPoints], clocks: Clocks, pairs: Sequence[tuple[int, int]], at_s: Floats, block: Ints
) -> list[_Sums]:
    """The normal equations of every pair at these clocks."""
    views = [
        interpolate(seen, clocks.frames_in_rig_s(c, seen), clocks.values[c, READOUT], at_s)
        for c, seen in enumerate(cameras)
    ]
    middle_s = clocks.at_s[0] + clocks.values[0, OFFSET]
    return [_pair_sums([cameras[c] for c in pair], [views[c] for c in pair], at_s - middle_s, block) for pair in pairs]


def _pair_sums(seen: Sequence[SeenPoints], views: Sequence[Interpolated], age_s: Floats, block: Ints) -> _Sums:
    residual, slopes, instruments = _epipolar(seen, views)
    count = int(block[-1]) + 1
    known = np.isfinite(residual + slopes.sum(axis=0) + instruments.sum(axis=0))
    values = np.where(known, np.concatenate([residual[None], slopes, instruments]), 0.0)
    weight, scale_px = _weights(values[0], known, block, count)
    residual, *motion = _within(values, weight, block, count)
    lever = np.broadcast_to(age_s[:, None], residual.shape)
    weight /= scale_px**2
    powers = np.stack([np.ones_like(lever), lever])
    product = weight * (motion[2] * motion[1] + motion[3] * motion[0]) / 2
    pull = weight * (motion[2] + motion[3]) / 2 * residual
    group = np.resize(_JOINT_GROUP, residual.shape[1])
    matrix = np.stack([[_by_cluster(product * a * b, block, group, count) for a in powers] for b in powers])
    right = np.stack([_by_cluster(pull * a, block, group, count) for a in powers])
    return _Sums(np.moveaxis(matrix, (0, 1), (2, 3)), np.moveaxis(right, 0, 2))


def _epipolar(seen: Sequence[SeenPoints], views: Sequence[Interpolated]) -> tuple[Floats, Floats, Floats]:
    """Residual (K, P) in px, its slopes (2, K, P) by the lag from each view, and their instruments (2, K, P), in px/s.

    The residual is Sampson's (Hartley and Zisserman, equation 11.9); the lag is the second's offset less the first's.
    """
    fundamental = fundamental_matrix(seen[0], seen[1])
    first, second = (np.concatenate([v.px, np.ones((*v.px.shape[:-1], 1))], axis=-1) for v in views)
    line, back = first @ fundamental.T, second @ fundamental
    size = np.sqrt((line[..., :2] ** 2).sum(axis=-1) + (back[..., :2] ** 2).sum(axis=-1))
    residual = (second * line).sum(axis=-1) / size
    normals = back[..., :2] / size[..., None], -line[..., :2] / size[..., None]
    slopes = [(n * v.velocity_px_s).sum(axis=-1) for n, v in zip(normals, views, strict=True)]
    instruments = [(n * v.instrument_px_s).sum(axis=-1) for n, v in zip(normals, views, strict=True)]
    return residual, np.stack(slopes), np.stack(instruments)


def fundamental_matrix(first: SeenPoints, second: SeenPoints) -> Floats:
    """(3, 3) ``second^T F first = 0`` for undistorted pixels (Hartley and Zisserman, equation 9.1)."""
    to_second = second.px_from_rig[:, :3] @ np.linalg.inv(first.px_from_rig[:, :3])
    epipole = second.px_from_rig[:, 3] - to_second @ first.px_from_rig[:, 3]
    return np.asarray(np.cross(np.eye(3), epipole, axis=-1).T @ to_second)


def _weights(
    residual: Floats, known: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], block: Ints, count: int
) -> tuple[Floats, float]:
    """(K, P) Tukey's weights of residuals about their medians in each block, and their robust standard deviation."""
    about = np.where(known, residual, np.nan)
    for b in range(count):
        rows = slice(*np.searchsorted(block, (b, b + 1)))
        number = known[rows].sum(axis=0)
        middle = np.take_along_axis(np.sort(about[rows], axis=0), np.maximum(number - 1, 0)[None] // 2, axis=0)
        about[rows] -= np.where(number >= _LEAST_VALUES, middle, np.nan)
    kept = np.isfinite(about)
    if not kept.any():
        return np.zeros_like(residual), 1.0
    scale = max(float(np.median(np.abs(about[kept]))) / 0.6745, 1e-6)
    near = np.maximum(1 - np.square(np.where(kept, about, np.inf) / (_TUKEY * scale)), 0)
    return np.square(near), scale


def _within(values: Floats, weight: Floats, block: Ints, count: int) -> Floats:
    """(N, K, P) values less their weighted means in each block."""
    starts = np.searchsorted(block, np.arange(count))
    total = np.add.reduceat(values * weight, starts, axis=1)
    mean = total / np.maximum(np.add.reduceat(weight, starts, axis=0), 1e-12)
    return np.asarray(values - mean[:, block])


def _by_cluster(values: Floats, block: Ints, group: Ints, count: int) -> Floats:
    """(B, G) sums over blocks of time and groups of joints."""
    groups = JOINT_GROUPS
    code = block[:, None] * groups + group
    return np.asarray(
        np.bincount(code.ravel(), values.ravel(), count * groups).reshape(count, groups), dtype=np.float64
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Contributions of N parts of the evidence to the normal equations of all cameras but the first."""

    matrix: Floats
    """(N, p, p) with p = 2 (M - 1): offset and drift of each camera."""
    right: Floats
    """(N, p); the sum gives the step."""

    @classmethod
    def of(cls, pairs: Sequence[tuple[int, int]], matrices: Floats, rights: Floats) -> _Part:
        """Join equations of pairs.

        Args:
            pairs: L pairs of cameras.
            matrices: (L, N, 2, 2) of each pair.
            rights: (L, N, 2).
        """
        cameras, parts = max(j for _, j in pairs) + 1, matrices.shape[1]
        matrix, right = np.zeros((parts, cameras, 2, cameras, 2)), np.zeros((parts, cameras, 2))
        for (i, j), own, pull in zip(pairs, matrices, rights, strict=True):
            for one, other, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                matrix[:, one, :, other] += sign * own
            right[:, i] += pull
            right[:, j] -= pull
        size = 2 * cameras
        return cls(matrix.reshape(parts, size, size)[:, 2:, 2:], right.reshape(parts, size)[:, 2:])


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """The normal equations of all cameras, divided in three ways."""

    by_block: _Part
    by_joint: _Part
    by_pair: _Part
    beforehand: Floats
    """(p,) inverse variances of what is known beforehand."""

    @classmethod
    def of(cls, pairs: Sequence[tuple[int, int]], sums: Sequence[_Sums], beforehand: Floats) -> _System:
        """Join the equations of pairs."""
        matrix, right = np.stack([s.matrix for s in sums]), np.stack([s.right for s in sums])
        block, joint = (_Part.of(pairs, matrix.sum(axis=axis), right.sum(axis=axis)) for axis in (2, 1))
        alone = np.eye(len(pairs))
        pair = _Part.of(
            pairs,
            alone[..., None, None] * matrix.sum(axis=(1, 2))[:, None],
            alone[..., None] * right.sum(axis=(1, 2))[:, None],
        )
        return cls(block, joint, pair, np.tile(beforehand, len(block.right[0]) // 2))

    def step(self, to_start: Floats) -> Floats:
        """(M, 2) change of offsets and drifts; ``to_start`` (M, 2) leads back to what was known beforehand."""
        pull = self.by_pair.right.sum(axis=0) + self.beforehand * to_start[1:].ravel()
        return _by_camera(np.linalg.solve(self._whole(), pull))

    def sigma(self) -> Floats:
        """(M, 2) standard errors: the largest over the ways of leaving out, and what was known beforehand."""
        inverse = np.linalg.inv(self._whole())
        known = ((inverse * self.beforehand) @ inverse.T).diagonal()
        ways = [self.by_joint]
        ways += [self.by_block] if len(self.by_block.right) >= LEAST_BLOCKS else []
        ways += [self.by_pair] if len(self.by_pair.right) > 1 else []
        return np.sqrt(_by_camera(np.max([self._jackknife(way) for way in ways], axis=0) + known))

    def _whole(self) -> Floats:
        return np.asarray(self.by_pair.matrix.sum(axis=0) + np.diag(self.beforehand))

    def _jackknife(self, part: _Part) -> Floats:
        """(p,) variances from leaving out each part."""
        total = part.right.sum(axis=0)
        steps = np.linalg.solve(self._whole() - part.matrix, (total - part.right)[..., None])[..., 0]
        return np.asarray((len(steps) - 1) / len(steps) * np.square(steps - steps.mean(axis=0)).sum(axis=0))


def _by_camera(values: Floats) -> Floats:
    """(M, 2) with zeros for the first camera."""
    return np.concatenate([np.zeros((1, 2)), values.reshape(-1, 2)])


def _disagreement_s(sums: Sequence[_Sums]) -> float:
    """Root-mean-square lag that pairs by themselves still want, each weighed by what it knows."""
    knows = np.array([s.matrix[..., 0, 0].sum() for s in sums])
    wants = np.array([s.right[..., 0].sum() for s in sums])
    total = np.maximum(knows, 0).sum()
    return float(np.sqrt((wants**2 / np.maximum(knows, 1e-12))[knows > 0].sum() / total)) if total > 0 else 0.0
