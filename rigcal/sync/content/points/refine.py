"""Clocks to a small fraction of a frame: Gauss-Newton over all cameras, and how sure the result is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.geometry import Bools, Floats
from rigcal.sync.content.points.clocks import OFFSET, Clocks
from rigcal.sync.content.points.equations import CLOCK, WIDTH, Comparison, Equations, form_equations
from rigcal.sync.content.points.search import BLOCK_S
from rigcal.sync.content.points.seen import SeenPoints, noise_px

_MOST_VIEWS = 100_000  # cameras times times times points: a third of a second a round
_DONE_S = 1e-6
_SCALED = 4  # rounds after which the scale of the loss is kept, so that weights come to rest
_SETTLED = 0.5  # of a sigma: the last step of robust weights that go to and fro; it counts as uncertainty
_SHORT_BLOCKS = 6  # of a recording of a few seconds; with fewer, bounds are several times too wide
_SHORTEST_BLOCK_S = 1 / 3  # with errors that last as long, and calibrations off by 2 px: bounds still twice too wide
_BIAS_SIGMA_PX = 3.0  # a calibration that is further off is none


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Clocks and their uncertainty."""

    clocks: Clocks
    bias_px: Floats
    """(M, 6) affine field of pixels of each camera that does not go with speed."""
    sigma: Floats
    """(M, 3) standard deviations of offset, drift and readout; 0 where held."""
    blocks: Floats
    """(M,) blocks of time that carry the information, as if all carried as much."""
    block_s: float
    """Length of a block."""
    scale_px: float
    """Robust standard deviation of the residuals per axis."""
    settled: bool
    """Whether the steps came to an end."""


def compare(cameras: Sequence[SeenPoints], clocks: Clocks) -> Comparison:
    """Rig times at which to compare cameras: where frames are, no more of them than are of use."""
    spacing_s = min(seen.spacing_s for seen in cameras)
    frames = np.concatenate([clocks.frames_in_rig_s(c, seen) for c, seen in enumerate(cameras)])
    ticks = np.unique(np.rint(frames / spacing_s))
    points = cameras[0].px.shape[1]
    stride = max(1, -(-len(ticks) * points * len(cameras) // _MOST_VIEWS))
    at_s = ticks[::stride] * spacing_s
    block_s = float(np.clip(np.ptp(at_s) / _SHORT_BLOCKS, _SHORTEST_BLOCK_S, BLOCK_S)) if len(at_s) else BLOCK_S
    _, block = np.unique(at_s // block_s, return_inverse=True)
    return Comparison(cameras, at_s, block, block_s, np.array([noise_px(seen) for seen in cameras]))


def refine(comparison: Comparison, clocks: Clocks, sigma: Floats, *, rounds: int = 25) -> Refined:
    """Solve for clocks and fields of pixels together.

    Args:
        comparison: M cameras.
        clocks: Where to start; also the mean of what is known of the clocks beforehand.
        sigma: (M, 3) how well they are known beforehand; 0: held.
    """
    count = len(comparison.cameras)
    prior, free = _prior(sigma, count)
    start = np.concatenate([clocks.values, np.zeros((count, WIDTH - CLOCK))], axis=1)
    state, step = start.copy(), np.zeros_like(start)
    scale_px = None
    for turn in range(rounds):
        equations = _equations(comparison, clocks, state, scale_px)
        scale_px = equations.scale_px if turn >= _SCALED else None
        before = step
        step = _step(equations, prior, free, (start - state).ravel(), sigma[:, OFFSET].max()).reshape(count, WIDTH)
        if (step * before).sum() < 0:  # robust weights that go to and fro between two states: meet in the middle
            step = step / 2
        state += step
        if np.abs(step[:, OFFSET]).max() < _DONE_S:
            break
    solved = replace(clocks, values=state[:, :CLOCK])
    equations = _equations(comparison, clocks, state, scale_px)
    covariance = _jackknife(equations, prior, free)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0)).reshape(count, WIDTH)
    settled = (np.abs(step[:, OFFSET]) <= np.maximum(_SETTLED * deviation[:, OFFSET], _DONE_S)).all()
    return Refined(
        solved,
        state[:, CLOCK:],
        np.hypot(deviation, step)[:, :CLOCK],
        _effective_blocks(equations, count),
        comparison.block_s,
        equations.scale_px,
        bool(settled),
    )


def _equations(comparison: Comparison, clocks: Clocks, state: Floats, scale_px: float | None) -> Equations:
    return form_equations(comparison, replace(clocks, values=state[:, :CLOCK]), state[:, CLOCK:], scale_px)


def _prior(sigma: Floats, count: int) -> tuple[Floats, Bools]:
    """(p,) inverse variances of what is known beforehand, and (p,) which parameters are free."""
    known = np.concatenate([sigma, np.full((count, WIDTH - CLOCK), _BIAS_SIGMA_PX)], axis=1).ravel()
    free = known > 0
    return np.where(free, 1 / np.maximum(known, 1e-12) ** 2, 0.0), free


def _step(equations: Equations, prior: Floats, free: Bools, from_start: Floats, most_s: float) -> Floats:
    """The Gauss-Newton step, shortened where an offset would go further than ``most_s``."""
    weight = prior * _variance(equations)
    matrix = equations.matrix.sum(axis=0) + np.diag(weight)
    right = equations.right.sum(axis=0) + weight * from_start
    step = np.zeros(len(free))
    step[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
    longest = np.abs(step[OFFSET::WIDTH]).max()
    return np.asarray(step * min(1.0, most_s / longest) if longest > 0 else step)


def _variance(equations: Equations) -> float:
    """Variance of a residual, that what is known beforehand is weighed with."""
    return max(equations.scale_px, 1e-3) ** 2


def _jackknife(equations: Equations, prior: Floats, free: Bools) -> Floats:
    """(p, p) covariance: the solution's changes as each block of time is left out, and what the prior leaves open.

    Left-out blocks (Efron; for clustered residuals Cameron and Miller, J. Human Resources 50, 2015, CV3) need no model
    of how residuals within a block hang together.
    """
    weight = prior * _variance(equations)
    pick = np.ix_(free, free)
    parts = equations.bend * equations.matrix
    whole = parts.sum(axis=0) + np.diag(weight)
    changes = np.stack(
        [np.linalg.solve((whole - part)[pick], right[free]) for part, right in zip(parts, equations.right, strict=True)]
    )
    blocks = len(changes)
    inverse = np.linalg.inv(whole[pick])
    covariance = np.zeros_like(whole)
    covariance[pick] = (blocks - 1) / blocks * changes.T @ changes
    covariance[pick] += inverse * (weight * _variance(equations))[free] @ inverse.T
    return np.asarray(covariance)


def _effective_blocks(equations: Equations, count: int) -> Floats:
    """(M,) how many blocks of equal information would carry as much as those of each camera do."""
    offsets = np.arange(count) * WIDTH + OFFSET
    information = np.maximum(equations.matrix[:, offsets, offsets], 0)
    return np.asarray(information.sum(axis=0) ** 2 / np.maximum((information**2).sum(axis=0), 1e-30))
