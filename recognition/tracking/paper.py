"""Identities over time: the 3D workers and objects of an instant are matched to those before.

Bipartite matching as in the Safe-Construct paper ("Bipartite Matching for Tracking"). The cost of a pair is the mean
distance of the joints that both have. Where they share none, it is the distance of the means of what each has, on the
ground plane (x-y of the world) where the rig has a world, in space where it has none.

The paper matches with the previous instant only, by one threshold, and every pose that is not matched is somebody
new. Here, so that one setting serves every frame rate, short gaps and false reconstructions:

- psi grows with the time since the track was last seen, by a highest speed;
- a track that is not seen keeps its identity for a stated time, and what it remembers follows what is seen with a
  short delay;
- an identity is given when enough evidence has come together, and not to a second reconstruction of a worker who is
  already there; tracks choose first, and what they leave may become a track.

Identifiers count from 1, workers and objects together, and are never used again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recognition.association import match
from recognition.observations import Objects3D, ObjectTrack, People3D, Scene, WorkerTrack
from rigcal.errors import OptionError
from rigcal.geometry import Bools, Floats, Ints, Pose, freeze

_WORKER = "worker"


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """When two 3D poses are one identity.

    The figures: the athlete of the shared multi-person capture from MoveNet, mean and least of 16 settings of the
    association; and 4 s of simulated crowds of four and of eight with 5 px noise, missing joints, false detections.

    Raises:
        OptionError: where a length, speed or time is negative or infinite, or an evidence below 1.
    """

    max_worker_jump_m: float = 0.5
    """psi of workers, without a gap in time: what wrong joints add to the mean distance. The athlete keeps his
    identity in 95.9, at the least 92 of 100 frames (at 0.4: 94.6 and 90; at 0.7: 96.0 and 92)."""
    max_object_jump_m: float = 0.2
    """psi of objects. 1 and 2 exchanges of identity and 0.16 and 0.44 false objects at a time (at 0.5: 1 and 3.7, 0.18
    and 0.82; at 0.1: 1 and 3.7, 0.15 and 0.42)."""
    max_speed_m_per_s: float = 3.0
    """What psi grows by: a worker who runs."""
    follow_s: float = 0.1
    """Time constant with which the remembered pose follows what is seen, so that a track that took a false
    reconstruction for its worker is still near when the worker is seen again. Without it the athlete loses his
    identity in some settings (91.9, at the least 58 frames); 0.03 to 0.2 s are alike."""
    keep_s: float = 0.5
    """How long a track that is not seen keeps its identity."""
    start_worker: int = 45
    """Evidence for a new worker: the sum over known joints of (cameras - 1), added over successive instants. A whole
    body starts at the first instant where four cameras see it, at the second where three do, at the third where two
    do. 4 and 9 identities for four and eight workers (at 34: 6 and 14; at 17: 8.7 and 25.3; at 68: 4 and 8)."""
    start_object: int = 6
    """Evidence for a new object, which has one point: the second instant for four cameras, the third for three, the
    sixth for two. 0.16 and 0.44 false objects at a time (at 4: 0.27 and 1.06; at 2: 0.56 and 2.25)."""
    min_separation_m: float = 0.4
    """A new worker nearer than this to one who is there is the same, reconstructed twice from different views. 4
    identities in the shared capture (at 0.2: 4.5; at 0: 5; three people are there)."""

    def __post_init__(self) -> None:
        for name in ("max_worker_jump_m", "max_object_jump_m", "max_speed_m_per_s", "keep_s", "min_separation_m"):
            if not 0 <= getattr(self, name) < np.inf:
                raise OptionError(name, expected="a number not below 0", got=getattr(self, name))
        if not 0 < self.follow_s < np.inf:
            raise OptionError("follow_s", expected="a time above 0", got=self.follow_s)
        for name in ("start_worker", "start_object"):
            if getattr(self, name) < 1:
                raise OptionError(name, expected="a count of 1 or more", got=getattr(self, name))


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Where something was when it was last seen."""

    label: str
    """``worker``, or the class of the object."""
    points_m: Floats
    """(J, 3) in the rig frame, NaN where not known: 17 joints, or one centre."""
    t_ns: int

    def __post_init__(self) -> None:
        freeze(self, np.float64, points_m=(None, 3))


@dataclass(frozen=True, slots=True)
class Track:
    """Something with an identity."""

    track_id: int
    last: Sighting


@dataclass(frozen=True, slots=True)
class Candidate:
    """Something that may become a track; seen at the last instant."""

    evidence: int
    last: Sighting


@dataclass(frozen=True, slots=True)
class Memory:
    """What is remembered of workers, or of objects."""

    tracks: tuple[Track, ...] = ()
    candidates: tuple[Candidate, ...] = ()


@dataclass(frozen=True, slots=True)
class TrackerState:
    """All that the tracker knows from one instant to the next; the default is its state before the first."""

    workers: Memory = Memory()
    objects: Memory = Memory()
    next_id: int = 1
    t_ns: int | None = None
    """The last instant."""


@dataclass(frozen=True, slots=True, eq=False)
class _Sightings:
    """N workers, or N objects, that are somewhere at an instant."""

    rows: Ints
    """(N,) row of each in its ``People3D`` or ``Objects3D``."""
    seen: tuple[Sighting, ...]
    evidence: Ints
    start: int
    jump_m: float
    separation_m: float


@dataclass(frozen=True, slots=True)
class Tracker:
    """The rules of tracking for one rig; :meth:`step` is pure, the state goes in and comes out."""

    world_from_rig: Pose | None
    """Of the rig: where the ground plane is."""
    options: TrackingOptions = TrackingOptions()

    def step(
        self, state: TrackerState, people: People3D, objects: Objects3D, *, t_ns: int, index: int
    ) -> tuple[TrackerState, Scene]:
        """Match what was triangulated at one instant.

        Args:
            state: as the last step returned it, or ``TrackerState()``.
            people: workers of the instant; rows without a known joint are passed over.
            objects: objects of the instant; rows without a centre are passed over.
            t_ns: rig time of the instant, later than the last.
            index: number of the instant.

        Returns:
            The new state, and the scene: the tracks that are seen at this instant, by ascending identifier.

        Raises:
            ValueError: where time does not advance.
        """
        if state.t_ns is not None and t_ns <= state.t_ns:
            raise ValueError(f"t_ns: expected a time after {state.t_ns}, the last instant, got {t_ns}")
        here = self._workers(people, t_ns)
        workers, worker_ids, next_id = self._advance(state.workers, here, t_ns, state.next_id)
        there = self._objects(objects, t_ns)
        things, object_ids, next_id = self._advance(state.objects, there, t_ns, next_id)
        scene = Scene(
            index=index,
            t_ns=t_ns,
            workers=tuple(
                WorkerTrack(track_id, people.joints_m[row], people.views[row], people.members[row])
                for track_id, row in _identified(worker_ids, here.rows)
            ),
            objects=tuple(
                ObjectTrack(
                    track_id, objects.classes[row], objects.centre_m[row], int(objects.views[row]), objects.members[row]
                )
                for track_id, row in _identified(object_ids, there.rows)
            ),
        )
        return TrackerState(workers, things, next_id, t_ns), scene

    def _workers(self, people: People3D, t_ns: int) -> _Sightings:
        known: Bools = np.asarray(np.isfinite(people.joints_m).all(axis=-1))
        rows = np.flatnonzero(known.any(axis=1))
        return _Sightings(
            rows=rows,
            seen=tuple(Sighting(_WORKER, people.joints_m[row], t_ns) for row in rows),
            evidence=np.where(known, people.views - 1, 0).sum(axis=1)[rows],
            start=self.options.start_worker,
            jump_m=self.options.max_worker_jump_m,
            separation_m=self.options.min_separation_m,
        )

    def _objects(self, objects: Objects3D, t_ns: int) -> _Sightings:
        rows = np.flatnonzero(np.isfinite(objects.centre_m).all(axis=1))
        return _Sightings(
            rows=rows,
            seen=tuple(Sighting(objects.classes[row], objects.centre_m[row][None], t_ns) for row in rows),
            evidence=objects.views[rows] - 1,
            start=self.options.start_object,
            jump_m=self.options.max_object_jump_m,
            separation_m=0.0,
        )

    def _advance(self, memory: Memory, here: _Sightings, t_ns: int, next_id: int) -> tuple[Memory, Ints, int]:
        """The memory after the instant, the identifier (N,) of each sighting (0: none), and the next one."""
        keep_ns = round(self.options.keep_s * 1e9)
        alive = tuple(track for track in memory.tracks if t_ns - track.last.t_ns <= keep_ns)
        ids = np.zeros(len(here.seen), dtype=np.int64)
        known, found = self._match([track.last for track in alive], here.seen, here.jump_m)
        ids[found] = [alive[i].track_id for i in known]
        left = self._startable(here, ids)
        evidence = here.evidence[left]
        known, found = self._match([c.last for c in memory.candidates], [here.seen[i] for i in left], here.jump_m)
        evidence[found] += np.array([memory.candidates[i].evidence for i in known], dtype=np.int64)
        new = left[evidence >= here.start]
        ids[new] = next_id + np.arange(len(new))
        unseen = tuple(track for track in alive if track.track_id not in ids)
        before = {track.track_id: track.last for track in alive}
        seen = tuple(
            Track(track_id, self._followed(before.get(track_id), here.seen[i]))
            for track_id, i in _identified(ids, np.arange(len(ids)))
        )
        candidates = tuple(
            Candidate(int(amount), here.seen[i]) for amount, i in zip(evidence, left, strict=True) if not ids[i]
        )
        return Memory(unseen + seen, candidates), ids, next_id + len(new)

    def _startable(self, here: _Sightings, ids: Ints) -> Ints:
        """Which of the sightings without an identifier may be, or become, candidates."""
        free, taken = np.flatnonzero(ids == 0), np.flatnonzero(ids)
        apart_m = self._costs_m([here.seen[i] for i in free], [here.seen[i] for i in taken])
        return free[(apart_m >= here.separation_m).all(axis=1)]

    def _match(self, before: Sequence[Sighting], now: Sequence[Sighting], jump_m: float) -> tuple[Ints, Ints]:
        costs_m = self._costs_m(before, now)
        gap_s = np.array([[(b.t_ns - a.t_ns) * 1e-9 for b in now] for a in before]).reshape(costs_m.shape)
        within = costs_m < jump_m + self.options.max_speed_m_per_s * gap_s
        return match(np.where(within, costs_m, np.inf), np.inf)

    def _followed(self, before: Sighting | None, now: Sighting) -> Sighting:
        """What is remembered: the joints that are seen, on the way from where they were to where they are."""
        if before is None:
            return now
        part = -np.expm1((before.t_ns - now.t_ns) * 1e-9 / self.options.follow_s)
        on_the_way_m = before.points_m + part * (now.points_m - before.points_m)
        points_m = np.where(np.isfinite(on_the_way_m), on_the_way_m, now.points_m)
        return Sighting(now.label, points_m, now.t_ns)

    def _costs_m(self, first: Sequence[Sighting], second: Sequence[Sighting]) -> Floats:
        """(M, N) metres between sightings of one label; infinite where the labels differ."""
        if not (first and second):
            return np.zeros((len(first), len(second)))
        points, others = np.array([s.points_m for s in first]), np.array([s.points_m for s in second])
        distance_m = np.linalg.norm(points[:, None] - others[None, :], axis=-1)
        shared = np.isfinite(distance_m)
        count = shared.sum(axis=-1)
        mean_m = np.where(shared, distance_m, 0.0).sum(axis=-1) / np.maximum(count, 1)
        between_means_m = np.linalg.norm(self._places(points)[:, None] - self._places(others)[None, :], axis=-1)
        same = np.array([[a.label == b.label for b in second] for a in first])
        return np.where(same, np.where(count > 0, mean_m, between_means_m), np.inf)

    def _places(self, points_m: Floats) -> Floats:
        """Mean of the known points (N, J, 3): on the ground (N, 2), or in space (N, 3) where there is no world."""
        known = np.isfinite(points_m).all(axis=-1, keepdims=True)
        mean_m = np.where(known, points_m, 0.0).sum(axis=1) / known.sum(axis=1)
        return mean_m if self.world_from_rig is None else self.world_from_rig.apply(mean_m)[:, :2]


def _identified(ids: Ints, rows: Ints) -> list[tuple[int, int]]:
    """(identifier, row) of those that have one, ascending."""
    return sorted((track_id, row) for track_id, row in zip(ids.tolist(), rows.tolist(), strict=True) if track_id)
