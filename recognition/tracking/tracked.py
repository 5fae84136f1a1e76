"""One instant of the tracked method: predict, claim, group what is left, fuse, and keep the books.

Tracks that are sure of their place claim detections first (:mod:`recognition.association.claims`). What they leave, and
what a worker's track would only claim from far away, is grouped (:mod:`recognition.association.leftovers`), and the
groups are found to be workers who were lost, candidates, or new. All points of all of them are then updated together
(:mod:`recognition.triangulation.fusion`). Hats are claimed with the objects; a worker whose hat is not known yet claims
one where it would be, above the head, so that hats are told apart by their wearers.

The state goes in and comes out; nothing else is remembered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from recognition.observations import Scene, ViewDetections
from recognition.observed import Detected, observe
from recognition.optics import Optics
from recognition.tracking import things as objects
from recognition.tracking import workers as people
from recognition.tracking.body import Limbs
from recognition.tracking.meeting import distances_m
from recognition.tracking.motion import predict
from recognition.tracking.naming import named
from recognition.tracking.options import FollowOptions
from recognition.tracking.population import Population
from recognition.tracking.telling import indices, object_tracks, worker_tracks
from recognition.tracking.things import Heads, Things
from recognition.triangulation.fusion import Fused, Sights, fuse
from recognition.triangulation.systematic import systematic
from rigcal.geometry import Bools, Floats, Ints


@dataclass(frozen=True, slots=True, eq=False)
class FollowState:
    """All that is known from one instant to the next; :meth:`start` is the state before the first."""

    workers: Population
    limbs: Limbs
    things: Things
    labels: tuple[str, ...]
    """Classes of objects, by number."""
    next_id: int
    t_ns: int | None

    @classmethod
    def start(cls) -> FollowState:
        """Nothing known."""
        return cls(Population.none(17), Limbs.unknown(0), Things.none(), (), 1, None)


@dataclass(frozen=True, slots=True, eq=False)
class _Met:
    """Tracks, those of new workers and objects after the others, and their detections."""

    workers: Population
    heads: Heads
    """Of the workers who were there before."""
    who: Detected
    theirs: Ints
    """(T, V) rows of ``who``, -1 where none."""
    things: Things
    what: Detected
    its: Ints
    """(K, V) rows of ``what``, -1 where none."""


@dataclass(frozen=True, slots=True)
class Follower:
    """The rules for one rig; :meth:`step` is pure."""

    optics: Optics
    options: FollowOptions

    def step(
        self, state: FollowState, views: Sequence[ViewDetections], age_s: Floats, *, t_ns: int, index: int
    ) -> tuple[FollowState, Scene]:
        """What is where at one instant.

        Args:
            state: As the last step returned it, or :meth:`FollowState.start`.
            views: (V,) what each camera saw, nothing where it took no part.
            age_s: (V,) how long before ``t_ns`` each saw it.
            t_ns: Rig time, later than the last.
            index: Number of the instant.

        Raises:
            ValueError: where time does not advance.
        """
        if state.t_ns is not None and t_ns <= state.t_ns:
            raise ValueError(f"t_ns: expected a time after {state.t_ns}, the last instant, got {t_ns}")
        labels = {name: number for number, name in enumerate(state.labels)}
        worn = np.array([labels.setdefault(name, len(labels)) for name in self.options.worn], dtype=np.int64)
        seen = observe(self.optics, views, labels, self.options.detector, keypoints=state.things.population.points > 1)
        met = self._met(state, *seen, worn, tuple(labels), t_ns)
        sights = _sights(((met.who, met.theirs), (met.what, met.its)), age_s)
        fused = self._fused(met.workers, met.things.population, sights, t_ns)
        count = met.workers.known.size
        by_joint, by_point = fused.parted(count)
        firm = np.asarray((~met.who.hint[met.theirs]).any(axis=1))
        workers, limbs = people.settled(met.workers, by_joint, state.limbs, firm, t_ns)
        things = objects.scattered(self.optics, met.things, by_point, sights.after(count))
        sure = np.asarray((met.what.score[met.its] >= objects.SURE_SCORE).any(axis=1))
        things = objects.settled(things, by_point, met.heads.at(workers), worn, sure, t_ns)
        workers, next_id = _named(workers, self.options.start_worker, state.next_id)
        population, next_id = _named(things.population, self.options.start_object, next_id)
        extra = systematic(self.optics, fused, sights.factors, self.optics.clock_bounds_s(t_ns))
        scene = Scene(
            index=index,
            t_ns=t_ns,
            workers=worker_tracks(
                workers, by_joint, None if extra is None else extra[:count], indices(met.who, met.theirs, by_joint),
                self.options, t_ns,
            ),
            objects=object_tracks(
                self.optics, things.of(population), tuple(labels), met.what, met.its, by_point,
                None if extra is None else extra[count:], indices(met.what, met.its, by_point), self.options, t_ns,
            ),
        )  # fmt: skip
        alive = self._alive(workers, met.theirs, self.options.apart_m / 2, t_ns)
        there = self._alive(population, met.its, self.options.object_apart_m / 2, t_ns)
        if not alive.all():
            workers, limbs = workers.rows(alive), limbs.rows(alive)
        things = things.of(population) if there.all() else things.of(population).rows(there)
        return FollowState(workers, limbs, things, tuple(labels), next_id, t_ns), scene

    def _met(
        self, state: FollowState, who: Detected, what: Detected, worn: Ints, classes: tuple[str, ...], t_ns: int
    ) -> _Met:
        """Tracks predicted and given their detections, and what is new; with vague places for what is not known."""
        workers = state.workers
        things = state.things.with_keypoints() if what.seen.shape[1] > 1 else state.things
        if state.t_ns is not None:
            workers, things = later(workers, things, (t_ns - state.t_ns) * 1e-9)
        workers, theirs = people.find(self.optics, workers, who, self.options, t_ns)
        heads = Heads.of(self.optics, workers, who, theirs)
        objects.wear(things, heads)
        things, its = objects.find(self.optics, things, heads, what, worn, self.options, t_ns)
        what = named(self.optics, what, its, things.population, classes)
        workers = workers.with_vague(people.UNKNOWN_M, people.UNKNOWN_M_PER_S)
        vague = things.population.with_vague(objects.UNKNOWN_M, objects.UNKNOWN_M_PER_S)
        return _Met(workers, heads, who, theirs, things.of(vague), what, its)

    def _fused(self, workers: Population, things: Population, sights: Sights, t_ns: int) -> Fused:
        """The points of workers and objects updated together."""
        seen_ns = np.concatenate([workers.seen_ns.reshape(-1), things.seen_ns.reshape(-1)])
        return fuse(self.optics, workers.motion.joined(things.motion), sights, (t_ns - seen_ns) * 1e-9)

    def _alive(self, population: Population, members: Ints, apart_m: float, t_ns: int) -> Bools:
        """(T,) which tracks live on: those seen not too long ago; and of two that cameras place in one place, the one
        that more of them see, or the older."""
        named = population.track_id > 0
        keep_ns = np.where(named, round(self.options.keep_s * 1e9), round(self.options.candidate_keep_s * 1e9))
        alive = population.placed_ns >= t_ns - keep_ns
        place = np.add.reduce(population.place_m, axis=1) / population.points
        between = place[:, None] - place
        near = np.add.reduce(between * between, axis=2) < 4 * apart_m**2
        near &= (population.label[:, None] == population.label) & (population.placed_ns == t_ns)
        if np.count_nonzero(near) > np.count_nonzero(near.diagonal()):
            near &= distances_m(population, np.where(population.known[..., None], population.place_m, np.nan)) < apart_m
            rank = np.lexsort((-population.track_id, named, (members >= 0).sum(axis=1)))  # worst first
            order = np.empty(len(rank), dtype=np.int64)
            order[rank] = np.arange(len(rank))
            alive &= ~(near & near.T & (order[:, None] > order)).any(axis=0)
        return alive


def later(workers: Population, things: Things, step_s: float) -> tuple[Population, Things]:
    """Workers and objects a step of seconds later."""
    bodies, points = people.velocities(workers), len(things.population.motion.state)
    carrier = np.zeros((17 * len(bodies) + points, 3))
    carrier[: 17 * len(bodies)].reshape(-1, 17, 3)[:] = bodies[:, None]
    density = np.full(len(carrier), objects.DENSITY)
    density[: 17 * len(bodies)].reshape(-1, 17)[:] = people.DENSITY
    both = predict(workers.motion.joined(things.population.motion), carrier, density, step_s)
    first, second = both.parted(17 * len(bodies))
    return workers.moved(first), things.of(things.population.moved(second))


def _named(population: Population, start: int, next_id: int) -> tuple[Population, int]:
    """Candidates with enough evidence get identifiers, in the order of their rows; and the next one."""
    if population.track_id.all():
        return population, next_id
    new = np.flatnonzero((population.track_id == 0) & (population.evidence >= start))
    track_id = population.track_id.copy()
    track_id[new] = next_id + np.arange(len(new))
    return replace(population, track_id=track_id), next_id + len(new)


def _sights(seen: Sequence[tuple[Detected, Ints]], age_s: Floats) -> Sights:
    """What members (T, V) of detections saw of T x J points: of workers, then of objects."""
    views = len(age_s)
    ends = [0, *accumulate(len(members) * detected.seen.shape[1] for detected, members in seen)]
    factors, variances = np.empty((4, views, ends[-1])), np.empty((2, views, ends[-1]))
    given = np.empty((views, ends[-1]), dtype=np.bool_)
    for (detected, members), first, end in zip(seen, ends, ends[1:], strict=False):
        rows = members.T
        factors[..., first:end] = detected.factors[:, rows].reshape(4, views, -1)
        given[:, first:end] = detected.seen[rows].reshape(views, -1)
        variances[0, :, first:end] = detected.angle_var[rows].reshape(views, -1)
        variances[1, :, first:end] = detected.spread_var[rows].reshape(views, -1)
    return Sights(factors, given, variances[0], variances[1], age_s)
