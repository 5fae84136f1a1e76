"""Tracks in arrays: who is there, where, and since when."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from recognition.triangulation.fusion import Motion
from rigcal.geometry import Bools, Floats, Ints

LONG_AGO_NS = -(1 << 60)
NEW_M, NEW_M_PER_S = 0.3, 1.0
"""Standard deviations of a point that two rays placed: of its place, before all rays are fused, and of its velocity."""


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """T tracks and candidates of J points each."""

    track_id: Ints
    """(T,) 0 for candidates."""
    label: Ints
    """(T,) number of the class; 0 for workers."""
    evidence: Ints
    """(T,) gathered while a candidate."""
    placed_ns: Ints
    """(T,) when two cameras or more last saw it."""
    seen_ns: Ints
    """(T, J) when each point was last seen by a camera."""
    known: Bools
    """(T, J) which points have a place."""
    motion: Motion
    """T x J points, those of a track together."""

    @classmethod
    def none(cls, points: int) -> Population:
        """Nobody."""
        return cls.at(np.zeros((0, points, 3)), np.zeros(0, dtype=np.int64))

    @classmethod
    def at(cls, place_m: Floats, label: Ints) -> Population:
        """Candidates at places (T, J, 3), NaN where not known."""
        count, points = place_m.shape[:2]
        known: Bools = np.asarray(np.isfinite(place_m[..., 0]))
        state = np.zeros((count, points, 6))
        state[..., :3] = np.where(known[..., None], place_m, 0.0)
        covariance = np.zeros((count * points, 6, 6)) + np.diag([NEW_M**2] * 3 + [NEW_M_PER_S**2] * 3)
        zero = np.zeros(count, dtype=np.int64)
        long_ago = np.full((count, points), LONG_AGO_NS)
        motion = Motion.of(state.reshape(-1, 6), covariance)
        return cls(zero, label, zero, np.full(count, LONG_AGO_NS), long_ago, known, motion)

    @property
    def points(self) -> int:
        """J."""
        return int(self.known.shape[1])

    @property
    def place_m(self) -> Floats:
        """(T, J, 3) of every point, also of those that are not known."""
        return self.motion.state[:, :3].reshape(*self.known.shape, 3)

    @property
    def variance(self) -> Floats:
        """(T, J) of each coordinate of every point, on average, m^2."""
        return self.motion.variance.reshape(self.known.shape)

    def moved(self, motion: Motion) -> Population:
        """With other places."""
        return Population(self.track_id, self.label, self.evidence, self.placed_ns, self.seen_ns, self.known, motion)

    def rows(self, chosen: Ints | Bools) -> Population:
        """Some of the tracks."""
        shape = self.known.shape
        state = self.motion.state.reshape(*shape, 6)[chosen].reshape(-1, 6)
        covariance = self.motion.covariance.reshape(*shape, 6, 6)[chosen].reshape(-1, 6, 6)
        return Population(
            self.track_id[chosen], self.label[chosen], self.evidence[chosen], self.placed_ns[chosen],
            self.seen_ns[chosen], self.known[chosen], Motion.of(state, covariance),
        )  # fmt: skip

    def joined(self, other: Population) -> Population:
        """These, then others."""
        return Population(
            np.concatenate([self.track_id, other.track_id]),
            np.concatenate([self.label, other.label]),
            np.concatenate([self.evidence, other.evidence]),
            np.concatenate([self.placed_ns, other.placed_ns]),
            np.concatenate([self.seen_ns, other.seen_ns]),
            np.concatenate([self.known, other.known]),
            self.motion.joined(other.motion),
        )

    def anew(self, rows: Ints, place_m: Floats) -> Population:
        """With some tracks starting again at places (R, J, 3), NaN where not known."""
        found = Population.at(place_m, self.label[rows])
        shape = self.known.shape
        state = self.motion.state.reshape(*shape, 6).copy()
        covariance = self.motion.covariance.reshape(*shape, 6, 6).copy()
        known = self.known.copy()
        state[rows] = found.motion.state.reshape(len(rows), -1, 6)
        covariance[rows] = found.motion.covariance.reshape(len(rows), -1, 6, 6)
        known[rows] = found.known
        return replace(self, known=known, motion=Motion.of(state.reshape(-1, 6), covariance.reshape(-1, 6, 6)))

    def with_vague(self, spread_m: float, speed_m_per_s: float) -> Population:
        """With vague places for the points that are not known, around the middle of the others, to be found from."""
        if self.known.all():
            return self
        shape = self.known.shape
        weight = self.known / np.maximum(self.known.sum(axis=1, keepdims=True), 1)
        state = self.motion.state.reshape(*shape, 6)
        middle = weight[:, None] @ state
        hidden = ~self.known
        covariance = self.motion.covariance.copy()
        covariance[hidden.reshape(-1)] = np.diag([spread_m**2] * 3 + [speed_m_per_s**2] * 3)
        motion = Motion.of(np.where(hidden[..., None], middle, state).reshape(-1, 6), covariance)
        return self.moved(motion)
