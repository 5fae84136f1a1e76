"""Tracks between their frames: a cubic through four consecutive frames, and two velocities of it.

A least-squares fit of a time offset is biased where the velocity comes from the samples that also give the position:
their noise is correlated, and the offset is pulled to where interpolation averages noise most, half way between two
frames. So there are two velocities: the cubic's own derivative, and one whose weights are orthogonal to those of the
position, which serves as the instrument of the regression (instrumental variables: Sargan, Econometrica 26, 1958).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats
from rigcal.sync.content.points.seen import SeenPoints

_STENCIL = np.arange(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Interpolated:
    """What one camera would have seen at K times; NaN where its frames do not tell."""

    px: Floats
    """(K, P, 2) undistorted pixels."""
    velocity_px_s: Floats
    """(K, P, 2) derivative of the cubic."""
    instrument_px_s: Floats
    """(K, P, 2) velocity whose noise is not correlated with that of ``px``."""
    shared_noise: Floats
    """(K, P) covariance of the two velocities' noise per variance of a pixel, in 1/s^2."""
    row: Floats
    """(K, P) row, -1/2 to 1/2."""


def interpolate(seen: SeenPoints, frames_s: Floats, readout_s: float, at_s: Floats) -> Interpolated:
    """A camera's points at given times.

    Args:
        seen: F frames of P points.
        frames_s: (F,) rig time of each frame's middle row, ascending.
        readout_s: From the first row to the last.
        at_s: (K,) rig times.
    """
    frame = _frame_before(frames_s, at_s[:, None] - readout_s * _rows_near(seen, frames_s, at_s, readout_s))
    nodes = frame[..., None] + _STENCIL
    point = np.arange(seen.px.shape[1])[:, None]
    row = seen.row[nodes, point]
    node_s = frames_s[nodes] + (readout_s * row if readout_s else 0.0) - at_s[:, None, None]
    node_s = np.where(seen.follows[frame][..., None], node_s, np.nan)
    weights, slopes = _lagrange(node_s)
    instrument = _orthogonal_slope(node_s, weights)
    px = seen.px[nodes, point]
    return Interpolated(
        np.einsum("kpn,kpnd->kpd", weights, px),
        np.einsum("kpn,kpnd->kpd", slopes, px),
        np.einsum("kpn,kpnd->kpd", instrument, px),
        np.broadcast_to((slopes * instrument).sum(axis=-1), px.shape[:2]),
        (weights * row).sum(axis=-1),
    )


def _rows_near(seen: SeenPoints, frames_s: Floats, at_s: Floats, readout_s: float) -> Floats:
    """(K, P) rows in the frame before each time, 0 where not seen; (K, 1) zeros for a global shutter."""
    if not readout_s:
        return np.zeros((len(at_s), 1))
    return np.nan_to_num(seen.row[_frame_before(frames_s, at_s)])


def _frame_before(frames_s: Floats, at_s: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Index of the frame before each time that has a frame before it and two behind it."""
    return np.clip(np.searchsorted(frames_s, at_s, side="right") - 1, 1, len(frames_s) - 3)


def _lagrange(node_s: Floats) -> tuple[Floats, Floats]:
    """(..., 4) weights of the values at four nodes for the cubic at time 0, and for its derivative.

    NaN where time 0 is not between the second and the third node, but for rounding.
    """
    inside = (node_s[..., 1] <= 1e-9) & (node_s[..., 2] >= -1e-9)
    weights, slopes = np.empty_like(node_s), np.zeros_like(node_s)
    for k in range(4):
        others = [m for m in range(4) if m != k]
        gap = node_s[..., [k]] - node_s[..., others]
        factor = np.where(inside[..., None], -node_s[..., others] / gap, np.nan)
        weights[..., k] = factor.prod(axis=-1)
        for left, one, two in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
            slopes[..., k] += factor[..., one] * factor[..., two] / gap[..., left]
    return weights, slopes


def _orthogonal_slope(node_s: Floats, weights: Floats) -> Floats:
    """(..., 4) weights that give the slope of a line, little noise, and are orthogonal to ``weights``.

    The outer nodes fade out towards the times at which others take their place: cameras that are triggered together
    are compared at just those times, and an instrument that leaps there has no zero to find.
    """
    share = np.clip(-node_s[..., 1] / (node_s[..., 2] - node_s[..., 1]), 0, 1)
    trust = np.stack([1 - share, np.ones_like(share), np.ones_like(share), share], axis=-1)
    total, along, square = ((trust * weights**power).sum(axis=-1) for power in (0, 1, 2))
    time, product = (trust * node_s).sum(axis=-1), (trust * node_s * weights).sum(axis=-1)
    determinant = total * square - along**2
    level = (time * square - product * along) / determinant
    tilt = (total * product - along * time) / determinant
    direction = trust * (node_s - level[..., None] - tilt[..., None] * weights)
    return np.asarray(direction / (direction * node_s).sum(axis=-1, keepdims=True))
