"""What is known of an instant when what came after it is known too: the smoother of Rauch, Tung and Striebel.

The filter's state of each instant is corrected backwards in time by how the next smoothed state differs from what it
had predicted (Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", 1965). Gaps close: a
worker or a joint that was not seen for a while is told where it must have been. Identities are those of the filter.

Instants wait until :data:`AHEAD_S` after them is known, so that a recording of any length takes a bounded amount of
memory; what comes later than that changes nothing that could be told.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from recognition.observations import ObjectTrack, Scene, WorkerTrack
from recognition.tracking.motion import deviation_change
from recognition.tracking.options import FollowOptions
from recognition.tracking.population import Population
from recognition.tracking.telling import spheres
from recognition.tracking.tracked import FollowState, later
from rigcal.geometry import Bools, Floats, Ints

AHEAD_S = 4.0
"""A track that is not seen is forgotten sooner, and a filter's error dies out in less than a second."""


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A scene, and the state after it."""

    scene: Scene
    state: FollowState
    cameras: int
    """V, of the rig."""


@dataclass(frozen=True, slots=True, eq=False)
class _Tracks:
    """The points of all tracks of one kind at one instant."""

    track_id: Ints
    """(T,)"""
    known: Bools
    """(T, J)"""
    state: Floats
    """(T, J, 6)"""
    covariance: Floats
    """(T, J, 6, 6)"""
    told: Bools
    """(T, J) which points were seen a short time ago, or will be."""
    placed: Bools
    """(T,) which tracks were seen by two cameras a short time ago, or will be."""

    @classmethod
    def of(cls, tracks: Population, since_ns: int) -> _Tracks:
        """As the filter has them; ``since_ns`` is a short time ago."""
        shape, motion = tracks.known.shape, tracks.motion
        return cls(
            tracks.track_id, tracks.known, motion.state.reshape(*shape, 6), motion.covariance.reshape(*shape, 6, 6),
            tracks.seen_ns >= since_ns, tracks.placed_ns >= since_ns,
        )  # fmt: skip

    def corrected(self, predicted: Population, after: _Tracks, step_s: float) -> _Tracks:
        """Smoothed, by the smoothed points of the next instant and what was predicted of them."""
        rows, columns = np.nonzero((self.track_id[:, None] == after.track_id) & (self.track_id[:, None] > 0))
        if not len(rows) or self.known.shape[1] != after.known.shape[1]:
            return self
        shape = predicted.known.shape
        guess = predicted.motion.state.reshape(*shape, 6)[rows]
        doubt = predicted.motion.covariance.reshape(*shape, 6, 6)[rows]
        across = self.covariance[rows] @ deviation_change(step_s)
        gain = np.linalg.solve(doubt, across.swapaxes(-1, -2)).swapaxes(-1, -2)
        both = (self.known[rows] & after.known[columns])[..., None]
        surprise = (gain @ (after.state[columns] - guess)[..., None])[..., 0]
        sharper = gain @ (after.covariance[columns] - doubt) @ gain.swapaxes(-1, -2)
        state, covariance, told, placed = (
            self.state.copy(),
            self.covariance.copy(),
            self.told.copy(),
            self.placed.copy(),
        )
        state[rows] += np.where(both, surprise, 0.0)
        covariance[rows] += np.where(both[..., None], sharper, 0.0)
        told[rows] |= after.told[columns]
        placed[rows] |= after.placed[columns]
        return _Tracks(self.track_id, self.known, state, covariance, told, placed)


def smoothed(followed: Iterable[Followed], options: FollowOptions) -> Iterator[Scene]:
    """The scenes of a run with every track smoothed, in order, as soon as enough is known.

    Args:
        followed: Of the tracked method, in order.
        options: Those of the run.
    """
    waiting: list[Followed] = []
    for each in followed:
        waiting.append(each)
        if (each.scene.t_ns - waiting[0].scene.t_ns) * 1e-9 >= 2 * AHEAD_S:
            scenes = _backwards(waiting, options)
            ready = sum((each.scene.t_ns - one.scene.t_ns) * 1e-9 >= AHEAD_S for one in waiting)
            yield from scenes[:ready]
            del waiting[:ready]
    yield from _backwards(waiting, options)


def _backwards(run: list[Followed], options: FollowOptions) -> list[Scene]:
    """The scenes of a run, from the last to the first, and then in order."""
    scenes: list[Scene] = []
    ahead: tuple[int, _Tracks, _Tracks] | None = None
    for one in reversed(run):
        t_ns, state = one.scene.t_ns, one.state
        since_ns = t_ns - round(options.carry_s * 1e9)
        workers, things = _Tracks.of(state.workers, since_ns), _Tracks.of(state.things.population, since_ns)
        if ahead is not None:
            step_s = (ahead[0] - t_ns) * 1e-9
            next_workers, next_things = later(state.workers, state.things, step_s)
            workers = workers.corrected(next_workers, ahead[1], step_s)
            things = things.corrected(next_things.population, ahead[2], step_s)
        ahead = t_ns, workers, things
        scenes.append(
            replace(
                one.scene,
                workers=_workers(one, workers, options),
                objects=_objects(one, things, options),
            )
        )
    return scenes[::-1]


def _workers(one: Followed, tracks: _Tracks, options: FollowOptions) -> tuple[WorkerTrack, ...]:
    """The scene's workers where they were, and those that it lacks."""
    seen = {worker.track_id: worker for worker in one.scene.workers}
    told = _certain(tracks, options) & tracks.placed[:, None]
    for row in np.flatnonzero(told.any(axis=1)).tolist():
        track_id, joints = int(tracks.track_id[row]), told[row]
        before = seen.get(track_id)
        extra = _extra(before.covariance_m2, one.state.workers, row) if before else 0.0
        seen[track_id] = WorkerTrack(
            track_id,
            np.where(joints[:, None], tracks.state[row, :, :3], np.nan),
            before.views if before else np.zeros(17, dtype=np.int64),
            before.members if before else np.full(one.cameras, -1),
            np.where(joints[:, None, None], tracks.covariance[row, :, :3, :3] + extra, np.nan),
        )
    return tuple(seen[track_id] for track_id in sorted(seen))


def _objects(one: Followed, tracks: _Tracks, options: FollowOptions) -> tuple[ObjectTrack, ...]:
    """The scene's objects where they were, and those that it lacks."""
    seen = {thing.track_id: thing for thing in one.scene.objects}
    things = one.state.things
    alike_m2 = np.concatenate([np.zeros((len(things.owner), 1)), things.scatter_m2], axis=1)[:, : tracks.known.shape[1]]
    told = _certain(tracks, options, alike_m2)
    for row in np.flatnonzero(told[:, 0]).tolist():
        track_id, state = int(tracks.track_id[row]), tracks.state[row, :, :3]
        before = seen.get(track_id)
        extra = spheres(np.where(told[row], alike_m2[row], 0.0))
        if before:
            stated = np.concatenate([before.covariance_m2[None], before.keypoint_covariance_m2])[: len(state)]
            extra = np.where(np.isfinite(stated), _extra(stated, things.population, row), extra)
        covariance = tracks.covariance[row, :, :3, :3] + extra
        fresh = ObjectTrack(
            track_id, one.state.labels[things.population.label[row]], state[0], 0, np.full(one.cameras, -1),
            covariance[0],
        )  # fmt: skip
        keypoints, doubt = fresh.keypoints_m.copy(), fresh.keypoint_covariance_m2.copy()
        keypoints[: len(state) - 1] = np.where(told[row, 1:, None], state[1:], np.nan)
        doubt[: len(state) - 1] = np.where(told[row, 1:, None, None], covariance[1:], np.nan)
        seen[track_id] = replace(
            fresh,
            views=before.views if before else 0,
            members=before.members if before else fresh.members,
            keypoints_m=keypoints,
            size_m=before.size_m if before else fresh.size_m,
            keypoint_covariance_m2=doubt,
        )
    return tuple(seen[track_id] for track_id in sorted(seen))


def _certain(tracks: _Tracks, options: FollowOptions, alike_m2: Floats | float = 0.0) -> Bools:
    """(T, J) which points are told; ``alike_m2`` is the variance (T, J) by which they err alike at every instant."""
    variance = np.trace(tracks.covariance[..., :3, :3], axis1=-2, axis2=-1) / 3 + alike_m2
    named = (tracks.track_id > 0)[:, None]
    return np.asarray(named & tracks.known & tracks.told & (variance <= options.max_sigma_m**2))


def _extra(covariance_m2: Floats, filtered: Population, row: int) -> Floats:
    """(J, 3, 3) what the scene's covariances have beside the filter's: the rig's share, which no smoothing reduces."""
    own = filtered.motion.covariance.reshape(*filtered.known.shape, 6, 6)[row, : len(covariance_m2), :3, :3]
    extra = covariance_m2 - own
    return np.where(np.isfinite(extra), extra, 0.0)
