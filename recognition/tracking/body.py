"""What is known of every body: how joints hang together, and how long limbs are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recognition.triangulation.fusion import Motion
from rigcal.geometry import Bools, Floats

TORSO = (5, 6, 11, 12)
HEAD = (0, 1, 2, 3, 4)
_CHILD = np.array([7, 8, 13, 14, 0, 1, 2, 3, 4, 9, 10, 15, 16])
_FIRST = np.array([5, 6, 11, 12, 5, 5, 5, 5, 5, 7, 8, 13, 14])
_SECOND = np.array([5, 6, 11, 12, 6, 6, 6, 6, 6, 7, 8, 13, 14])
"""Joints, and the two joints in whose middle each hangs."""
_KIND = np.array([0, 0, 1, 1, 2, 3, 3, 4, 4, 5, 5, 6, 6])
"""Number of the length between; left and right have one."""
LENGTHS_M = np.array([0.30, 0.42, 0.22, 0.23, 0.21, 0.25, 0.41])
"""Upper arm, thigh, nose, eye and ear from the middle of the shoulders, lower arm, shank: of an adult of 1.70 m
(Drillis and Contini)."""
PRIOR_SAMPLES = 5.0
"""How many observations that is worth."""
MOST_SAMPLES = 600.0
"""After so many, a length follows what is seen as if these were the last: 10 s at 30 instants per second."""
LENGTH_SIGMA_M, FIRST_SIGMA_M = 0.025, 0.10
"""Standard deviations of a limb's distance from its length: later, and before it was seen."""
SURPRISE_M = 0.05
"""How far an observed length may pull, once the length is known."""
SWING = 0.5
"""Of a limb's length: standard deviation of its end along each axis where nothing is known but its other end."""
LOOSE_VAR = 0.015**2
"""m^2; joints that are known better than this are not held by their limbs. The lower legs of the shared capture's
athlete vary by 6 mm (median absolute deviation, OpenPose), by 11 at 0.02 m."""
FIRM_VAR = 0.07**2
"""m^2; joints that are known worse than this hold no other: their errors would count as new ones at every instant, and
a body that one camera sees would seem to be known in depth. At 0.05 m the lower arms of the bystander, whom two
cameras see, are 234 and 206 mm long, at 0.07 239 and 223."""


def _incidence() -> Floats:
    """(13, 17) from joints to the vectors along limbs."""
    matrix = np.zeros((len(_CHILD), 17))
    row = np.arange(len(_CHILD))
    np.add.at(matrix, (row, _CHILD), 1.0)
    np.add.at(matrix, (row, _FIRST), -0.5)
    np.add.at(matrix, (row, _SECOND), -0.5)
    return matrix


def _related() -> Floats:
    """(17, 17) how much each joint follows another of which more is known."""
    weight = np.full((17, 17), 0.02)
    weight[np.ix_(HEAD, HEAD)] = 1.0
    weight[np.ix_(HEAD, (5, 6))] = 0.3
    weight[np.ix_(TORSO, TORSO)] = 0.5
    for upper, middle, lower in ((5, 7, 9), (6, 8, 10), (11, 13, 15), (12, 14, 16)):
        weight[lower, middle], weight[lower, upper] = 1.0, 0.3
        weight[middle, upper], weight[middle, lower] = 1.0, 0.5
        weight[upper, middle] = 0.2
    np.fill_diagonal(weight, 0.0)
    return weight


_ALONG, _RELATED = _incidence(), _related()
_PARENTS = np.maximum(-_ALONG.T, 0.0)
"""(17, 13) shares of the joints in what each limb hangs on."""
_OF_KIND = (_KIND[:, None] == np.arange(len(LENGTHS_M))).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Limbs:
    """What is known of T workers' lengths."""

    length_m: Floats
    """(T, 7) in the order of :data:`LENGTHS_M`."""
    samples: Floats
    """(T, 7) how many observations each length is of."""

    @classmethod
    def unknown(cls, count: int) -> Limbs:
        """Of people who have not been seen."""
        return cls(np.tile(LENGTHS_M, (count, 1)), np.zeros((count, len(LENGTHS_M))))

    def extended(self, count: int) -> Limbs:
        """With those of workers who are new, up to so many."""
        if count == len(self.length_m):
            return self
        new = Limbs.unknown(count - len(self.length_m))
        return Limbs(np.concatenate([self.length_m, new.length_m]), np.concatenate([self.samples, new.samples]))

    def rows(self, chosen: Bools) -> Limbs:
        """Of some of the workers."""
        return Limbs(self.length_m[chosen], self.samples[chosen])


def carry(state: Floats, predicted_m: Floats, seen: Bools, known: Bools) -> None:
    """Let joints that are known but not seen follow what their neighbours did unexpectedly; in place.

    Args:
        state: (T, 17, 6) after the update.
        predicted_m: (T, 17, 3) before it.
        seen: (T, 17) which joints a camera saw.
        known: (T, 17) which have had a place before.
    """
    lost = known & ~seen
    if not lost.any():
        return
    sources = seen & known
    weight = sources @ _RELATED.T
    follow = (_RELATED @ ((state[..., :3] - predicted_m) * sources[..., None])) / np.maximum(weight, 1e-9)[..., None]
    state[..., :3] += follow * (lost & (weight > 0))[..., None]


def hold(motion: Motion, known: Bools, sure: Bools, limbs: Limbs) -> Limbs:
    """Hold joints at the lengths of their limbs, in place; the lengths after what was seen of them.

    Args:
        motion: T x 17 points.
        known: (T, 17)
        sure: (T, 17) which joints were placed by two cameras or more at this instant.
        limbs: Lengths before.
    """
    along = _ALONG @ motion.state[:, :3].reshape(-1, 17, 3)
    distance = np.sqrt(np.add.reduce(along * along, axis=-1)) + 1e-9
    variance = motion.variance.reshape(-1, 17)
    firm = known & (variance < FIRM_VAR)
    hang = (known & (variance > LOOSE_VAR))[:, _CHILD] & (firm @ _PARENTS > 0.9)
    if hang.any():
        _pull(motion, along / distance[..., None], distance, variance @ _PARENTS, hang, limbs)
    return _learned(limbs, distance, sure)


def _pull(motion: Motion, unit: Floats, distance: Floats, parent_var: Floats, hang: Bools, limbs: Limbs) -> None:
    """Kalman update of joints by their distance from what they hang on, in place.

    Args:
        motion: T x 17 points.
        unit: (T, 13, 3) along limbs.
        distance: (T, 13) of the joints.
        parent_var: (T, 13) of what they hang on, m^2.
        hang: (T, 13) which are held.
        limbs: Lengths.
    """
    length = limbs.length_m[:, _KIND]
    spread = LENGTH_SIGMA_M**2 + FIRST_SIGMA_M**2 / (1.0 + limbs.samples[:, _KIND]) + parent_var
    rows = (17 * np.arange(len(hang))[:, None] + _CHILD)[hang]
    covariance, unit = motion.covariance[rows], unit[hang]
    side = (covariance[:, :, :3] @ unit[..., None])[..., 0]
    gain = 1.0 / (np.add.reduce(side[:, :3] * unit, axis=-1) + spread[hang])
    motion.state[rows] += side * (gain * (length - distance)[hang])[:, None]
    pulled = Motion.of(motion.state[rows], covariance - (side * gain[:, None])[:, :, None] * side[:, None, :])
    most = (SWING * length[hang]) ** 2
    share = np.minimum(most / pulled.variance, 1.0)  # a joint swings about what it hangs on, and no farther
    motion.covariance[rows] = pulled.covariance * share[:, None, None]
    motion.variance[rows] = pulled.variance * share


def _learned(limbs: Limbs, distance: Floats, sure: Bools) -> Limbs:
    measured = sure[:, _CHILD] * (sure @ _PARENTS > 0.9)
    most = SURPRISE_M + 0.3 / (1.0 + limbs.samples[:, _KIND])
    surprise = np.minimum(np.maximum(distance - limbs.length_m[:, _KIND], -most), most) * measured
    samples = np.minimum(limbs.samples + measured @ _OF_KIND, MOST_SAMPLES)
    return Limbs(limbs.length_m + (surprise @ _OF_KIND) / (PRIOR_SAMPLES + samples), samples)
