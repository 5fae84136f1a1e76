"""Places and velocities of points with their covariance, and their prediction.

A point moves with nearly constant velocity. Its velocity relative to its carrier (a wrist's to the body) dies out, and
the carrier's own dies out more slowly, as in an Ornstein-Uhlenbeck process: between two frames that is constant
velocity, over a second without sight the point stays with its body and the body comes to a halt.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import exp

import numpy as np

from recognition.triangulation.fusion import Motion
from rigcal.geometry import Floats

OWN_S = 0.2
"""Time constant in which a point loses its velocity relative to its carrier."""
DOUBT_S = 1.0
"""Time constant in which it forgets errors of its velocity, which are those of its carrier too."""
CARRIER_S = 1.5
"""Time constant in which the carrier loses its own."""


def predict(motion: Motion, carrier_m_per_s: Floats, density: Floats, step_s: float) -> Motion:
    """Points a step later.

    Args:
        motion: N points.
        carrier_m_per_s: (N, 3) velocity of what each belongs to.
        density: (N,) of the white acceleration that disturbs each, m^2/s^3.
        step_s: Length of the step.
    """
    step = _step(step_s)
    state = motion.state @ step.change
    state[:, :3] += step.carried_s * carrier_m_per_s
    state[:, 3:] += step.carried * carrier_m_per_s
    count = len(state)
    half = (motion.covariance.reshape(-1, 6) @ step.spread).reshape(count, 6, 6)
    covariance = (half.swapaxes(1, 2).reshape(-1, 6) @ step.spread).reshape(count, 6, 6)
    covariance += density[:, None, None] * step.disturbance
    return Motion.of(state, covariance)


def deviation_change(step_s: float) -> Floats:
    """(6, 6) by which deviations of states, as rows, are multiplied in a step."""
    return _step(step_s).spread


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """What a length of a step says of every point."""

    change: Floats
    """(6, 6) by which states, as rows, are multiplied."""
    spread: Floats
    """(6, 6) the same for their deviations."""
    disturbance: Floats
    """(6, 6) covariance that white acceleration of density 1 adds."""
    carried_s: float
    """Times the carrier's velocity it is what the place gains,"""
    carried: float
    """and what the velocity gains."""


@lru_cache(maxsize=64)
def _step(step_s: float) -> _Step:
    kept, carrier_kept = exp(-step_s / OWN_S), exp(-step_s / CARRIER_S)
    reach_s, carrier_reach_s = OWN_S * (1.0 - kept), CARRIER_S * (1.0 - carrier_kept)
    added, three = np.zeros((6, 6)), np.eye(3)
    added[:3, :3], added[3:, 3:] = three * step_s**3 / 3, three * step_s
    added[:3, 3:] = added[3:, :3] = three * step_s**2 / 2
    doubt_kept = exp(-step_s / DOUBT_S)
    change, spread = _change(reach_s, kept), _change(DOUBT_S * (1.0 - doubt_kept), doubt_kept)
    return _Step(change, spread, added, carrier_reach_s - reach_s, carrier_kept - kept)


def _change(reach_s: float, kept: float) -> Floats:
    """(6, 6) that adds so much of the velocity to the place, and keeps so much of it."""
    change, three = np.zeros((6, 6)), np.eye(3)
    change[:3, :3], change[3:, :3], change[3:, 3:] = three, reach_s * three, kept * three
    return change
