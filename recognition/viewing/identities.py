"""The identities that the run gave, for tracks of a replay that begins in the middle of it.

A tracker that begins later counts from 1 again. Where workers and objects stood, and under which numbers, the
recording has in ``/scene``: each track takes the number that stands nearest to it at most instants.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import Any, TypeAlias

import numpy as np

from recognition.observations import Scene
from recognition.recording import iter_messages
from recognition.recording.messages import known_points
from recognition.sources.recording import RecordedRun
from rigcal.geometry import Floats, Pose

NEAR_M = 0.5
"""A track and a number further apart than this are not of the same worker or object."""
_Placed: TypeAlias = tuple[str, int, Floats]
"""``worker`` or the class of an object, number, place (3,) in the frame of the scenes."""


def recorded_identities(scenes: Sequence[Scene], run: RecordedRun) -> tuple[Scene, ...]:
    """The scenes with the numbers that the run gave; tracks that it did not have get numbers that it did not give.

    Args:
        scenes: Of a replay of this part of the recording.
        run: That part.

    Raises:
        RecordingError: where a file of the recording is damaged.
    """
    recorded = {
        message.publish_ns: tuple(_entities(message.message))
        for file in run.files
        for message in iter_messages(file, ["/scene"], start_ns=run.start_ns, end_ns=run.end_ns)
    }
    names = _names(scenes, recorded, run.rig.world_from_rig or Pose.identity())
    return tuple(
        replace(
            scene,
            workers=tuple(replace(worker, track_id=names[worker.track_id]) for worker in scene.workers),
            objects=tuple(replace(thing, track_id=names[thing.track_id]) for thing in scene.objects),
        )
        for scene in scenes
    )


def _names(
    scenes: Sequence[Scene], recorded: Mapping[int, tuple[_Placed, ...]], frame_from_rig: Pose
) -> dict[int, int]:
    """The number that each track takes, by its own."""
    votes: Counter[tuple[int, int]] = Counter()
    for scene in scenes:
        for kind, track_id, place in _tracks(scene, frame_from_rig):
            of_kind = [(float(np.linalg.norm(where - place)), number)
                       for other, number, where in recorded.get(scene.t_ns, ()) if other == kind]  # fmt: skip
            if of_kind and min(of_kind)[0] <= NEAR_M:
                votes[track_id, min(of_kind)[1]] += 1
    names: dict[int, int] = {}
    for (track_id, number), _ in votes.most_common():
        if track_id not in names and number not in names.values():
            names[track_id] = number
    unused = count(1 + max((number for found in recorded.values() for _, number, _ in found), default=0))
    tracks = {worker.track_id for scene in scenes for worker in scene.workers}
    tracks |= {thing.track_id for scene in scenes for thing in scene.objects}
    return names | {track_id: next(unused) for track_id in sorted(tracks - names.keys())}


def _tracks(scene: Scene, frame_from_rig: Pose) -> Iterator[_Placed]:
    for worker in scene.workers:
        known = worker.joints_m[known_points(worker.joints_m)]
        if len(known):
            yield "worker", worker.track_id, frame_from_rig.apply(known).mean(axis=0)
    for thing in scene.objects:
        yield thing.object_class, thing.track_id, frame_from_rig.apply(thing.centre_m)


def _entities(update: Any) -> Iterator[_Placed]:
    """What a recorded SceneUpdate shows: workers by their joints' spheres, objects by their cubes."""
    for entity in update.entities:
        points = [shape.pose.position for shape in (*entity.spheres, *entity.cubes)]
        if points:  # the entity of the status has none
            *_, kind, number = entity.id.split("/")
            yield kind, int(number), np.mean([[point.x, point.y, point.z] for point in points], axis=0)
