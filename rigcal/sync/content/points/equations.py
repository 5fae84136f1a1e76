"""The normal equations of the cameras' clocks, with every point's place eliminated.

At each of many rig times each point is interpolated in every camera that saw it, and placed where all of them agree
best. What is left over in the images is linear in the clocks: a camera that is late by ``dt`` sees a point ``v dt``
behind. Eliminating the place (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973) leaves of two
views exactly the epipolar error; of three and more it keeps what pairs of epipolar lines lose where they nearly
coincide: cameras at one height that watch people walk.

A calibration that is off by pixels leaves residuals that do not go with speed. Six numbers per camera, an affine field
of pixels over its image, take them up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats, Ints
from rigcal.sync.content.points.clocks import OFFSET, READOUT, Clocks
from rigcal.sync.content.points.interpolate import Interpolated, interpolate
from rigcal.sync.content.points.seen import SeenPoints
from rigcal.sync.content.points.triangulate import Triangulated, triangulate

CLOCK, BIAS = 3, 6
WIDTH = CLOCK + BIAS
"""Parameters per camera: offset, drift, readout, and the affine field of its pixels."""
_CAUCHY = 2.385  # 95 % efficient for Gaussian noise


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Normal equations in blocks of time."""

    matrix: Floats
    """(B, p, p) per block; instrument times derivative, not symmetric."""
    right: Floats
    """(B, p) per block; the step is ``solve(matrix, right)``."""
    bend: float
    """By how much less the robust right side changes with the clocks than the matrix says."""
    scale_px: float
    """Robust standard deviation of a residual per axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What is compared: cameras at rig times, in blocks."""

    cameras: Sequence[SeenPoints]
    at_s: Floats
    """(K,) rig times, ascending."""
    block: Ints
    """(K,) block of each, ascending from 0."""
    block_s: float
    """Length of a block."""
    noise_px: Floats
    """(M,) random noise of each camera's points per axis."""


def form_equations(comparison: Comparison, clocks: Clocks, bias_px: Floats, scale_px: float | None = None) -> Equations:
    """Linearise around clocks and a field of pixels.

    Args:
        comparison: The cameras and the times.
        clocks: Clocks of the M cameras.
        bias_px: (M, 6) affine fields of pixels.
        scale_px: Scale of the robust loss; None: that of these residuals.
    """
    cameras = comparison.cameras
    views = [
        interpolate(seen, clocks.frames_in_rig_s(c, seen), clocks.values[c, READOUT], comparison.at_s)
        for c, seen in enumerate(cameras)
    ]
    px = np.stack([view.px.reshape(-1, 2) for view in views], axis=1)
    chosen = np.flatnonzero(np.isfinite(px).all(axis=-1).sum(axis=1) > 1)
    block = np.repeat(comparison.block, cameras[0].px.shape[1])[chosen]
    field, placed, scale_px = _place(px[chosen], cameras, bias_px, scale_px)
    rows = [_Rows.of(view, clocks, c, comparison.at_s, chosen, field[:, c]) for c, view in enumerate(views)]
    matrix, right = _accumulate(placed, rows, comparison.noise_px, block)
    return Equations(matrix, right, _bend(placed.weight), scale_px)


def _place(
    px: Floats, cameras: Sequence[SeenPoints], bias_px: Floats, scale_px: float | None
) -> tuple[Floats, Triangulated, float]:
    """The fields (N, M, 2, 6) at N points, the points in space under a robust loss, and the residuals' scale.

    The fields are taken where the points are projected to, not where they are seen: otherwise a field that shrinks
    the images would shrink their noise.
    """
    px_from_rig = np.stack([seen.px_from_rig for seen in cameras])
    alike = np.ones(px.shape[:2])
    raw = triangulate(px, px_from_rig, alike)
    field = _field(px - raw.residual_px, np.array([seen.size_px for seen in cameras]))
    corrected = px - np.einsum("nmdf,mf->nmd", field, bias_px)
    plain = triangulate(corrected, px_from_rig, alike, raw.points_in_rig)
    scale_px = _scale(plain) if scale_px is None else scale_px
    return field, triangulate(corrected, px_from_rig, _loss_weights(plain, scale_px), plain.points_in_rig), scale_px


def _field(px: Floats, size_px: Floats) -> Floats:
    """(N, M, 2, 6) affine fields of pixels at places (N, M, 2) in the images."""
    base = np.concatenate([np.ones((*px.shape[:-1], 1)), px / size_px[:, None] - 1], axis=-1)
    field = np.zeros((*px.shape, BIAS))
    field[..., 0, :3], field[..., 1, 3:] = base, base
    return field


def _scale(placed: Triangulated) -> float:
    """Robust standard deviation per axis, with the freedom that each point's place takes up given back."""
    used = placed.weight > 0
    views = used.sum(axis=1, keepdims=True)
    if not used.any():
        return 0.0
    lost = np.sqrt(2 * views / np.maximum(2 * views - 3, 1))
    length = np.hypot(placed.residual_px[..., 0], placed.residual_px[..., 1]) * lost
    return float(np.median(length[used]) / np.sqrt(2 * np.log(2)))


def _loss_weights(placed: Triangulated, scale_px: float) -> Floats:
    """(N, M) weights of Cauchy's loss."""
    square = (placed.residual_px**2).sum(axis=-1) / (_CAUCHY * max(scale_px, 1e-9)) ** 2
    return np.asarray(1 / (1 + square))


def _bend(weight: Floats) -> float:
    """How much less the robust residuals change than their weights say.

    The derivative of ``w(r) r`` for Cauchy's ``w`` is ``w^2`` in the mean over directions of a plane.
    """
    return float((weight**2).sum() / max(weight.sum(), 1e-12))


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Of one camera: derivatives of its N residuals to its own parameters."""

    slope: Floats
    """(N, 2, 9) by the derivative of the cubic."""
    instrument: Floats
    """(N, 2, 9) by the velocity that shares no noise with the residual."""
    lever: Floats
    """(N, 3) of offset, drift and readout: 1, seconds from the clock's middle, row."""
    shared_noise: Floats
    """(N,) covariance of the two velocities' noise per variance of a pixel."""

    @classmethod
    def of(cls, view: Interpolated, clocks: Clocks, camera: int, at_s: Floats, chosen: Ints, field: Floats) -> _Rows:
        """The rows of the chosen ones of K times and P points, zeros where the camera did not see the point."""
        age_s = at_s - clocks.values[camera, OFFSET] - clocks.at_s[camera]
        lever = np.stack(np.broadcast_arrays(1.0, age_s[:, None], view.row), axis=-1).reshape(-1, CLOCK)[chosen]
        slope, instrument = (
            np.concatenate([velocity.reshape(-1, 2, 1)[chosen] * lever[:, None, :], field], axis=-1)
            for velocity in (view.velocity_px_s, view.instrument_px_s)
        )
        parts = (slope, instrument, lever, view.shared_noise.ravel()[chosen])
        return cls(*(np.nan_to_num(part) for part in parts))


def _accumulate(placed: Triangulated, rows: Sequence[_Rows], noise_px: Floats, block: Ints) -> tuple[Floats, Floats]:
    """Matrix (B, p, p) and right side (B, p) of each block, the points' places eliminated."""
    size, count = len(rows) * WIDTH, int(block.max(initial=-1)) + 1
    starts = np.searchsorted(block, np.arange(count + 1))
    towards = np.swapaxes(placed.px_from_point * placed.weight[..., None, None], -1, -2)  # (N, M, 3, 2)
    slope = np.concatenate([towards[:, c] @ row.slope for c, row in enumerate(rows)], axis=-1)
    instrument = np.concatenate([towards[:, c] @ row.instrument for c, row in enumerate(rows)], axis=-1)
    moved = placed.covariance @ slope
    pull = (towards @ placed.residual_px[..., None])[..., 0].sum(axis=1)
    place = (placed.covariance @ pull[..., None])[..., 0]
    taken = (np.swapaxes(towards, -1, -2) * (placed.px_from_point @ placed.covariance[:, None])).sum(axis=(-1, -2))
    noise = [
        noise_px[c] ** 2 * row.shared_noise * (2 - taken[:, c]) * placed.weight[:, c] for c, row in enumerate(rows)
    ]
    matrix, right = np.zeros((count, size, size)), np.zeros((count, size))
    for b, part in enumerate(map(slice, starts[:-1], starts[1:])):
        matrix[b] = -_over_points(instrument[part], moved[part])
        right[b] = -_over_points(instrument[part], place[part])
        for c, row in enumerate(rows):
            own, clock = slice(c * WIDTH, (c + 1) * WIDTH), slice(c * WIDTH, c * WIDTH + CLOCK)
            lifted = row.instrument[part] * placed.weight[part, c, None, None]
            matrix[b, own, own] += _over_points(lifted, row.slope[part])
            right[b, own] += _over_points(lifted, placed.residual_px[part, c])
            matrix[b, clock, clock] -= (row.lever[part] * noise[c][part, None]).T @ row.lever[part]
    return matrix, right


def _over_points(left: Floats, right: Floats) -> Floats:
    """Sum over the points and rows of products of (n, d, p) and (n, d, q) or (n, d)."""
    return np.asarray(np.tensordot(left, right, axes=((0, 1), (0, 1))))
