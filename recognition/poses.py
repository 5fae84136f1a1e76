"""Worker poses over time as one file: what ``recognition run --poses`` writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recognition.observations import Scene
from rigcal.geometry import Floats, Ints, Pose, freeze


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Every worker at every instant at which it was seen: M rows by time, then identity."""

    frame: Ints
    """(M,) number of the instant."""
    t_ns: Ints
    """(M,) rig time in nanoseconds."""
    track_id: Ints
    """(M,)"""
    joints_m: Floats
    """(M, 17, 3) in the world frame where the rig has one, else in the rig frame; NaN where not known."""
    views: Ints
    """(M, 17) how many cameras gave the joint."""

    def __post_init__(self) -> None:
        count = len(self.frame)
        freeze(self, np.int64, frame=(count,), t_ns=(count,), track_id=(count,), views=(count, 17))
        freeze(self, np.float64, joints_m=(count, 17, 3))

    @classmethod
    def of(cls, scenes: Sequence[Scene], world_from_rig: Pose | None) -> Poses:
        """From the scenes of a run."""
        rows = [(scene, worker) for scene in scenes for worker in scene.workers]
        joints = np.array([worker.joints_m for _, worker in rows]).reshape(-1, 17, 3)
        return cls(
            np.array([scene.index for scene, _ in rows], dtype=np.int64),
            np.array([scene.t_ns for scene, _ in rows], dtype=np.int64),
            np.array([worker.track_id for _, worker in rows], dtype=np.int64),
            joints if world_from_rig is None else world_from_rig.apply(joints),
            np.array([worker.views for _, worker in rows], dtype=np.int64).reshape(-1, 17),
        )


def write_poses(poses: Poses, path: Path) -> None:
    """Write ``frame t_ns track_id joints_m views`` to an ``.npz``, by way of a temporary file."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as file:
        np.savez_compressed(
            file,
            frame=poses.frame.astype(np.int32),
            t_ns=poses.t_ns,
            track_id=poses.track_id.astype(np.int32),
            joints_m=poses.joints_m.astype(np.float32),
            views=poses.views.astype(np.int16),
        )
    part.replace(path)
