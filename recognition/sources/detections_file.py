"""Detections made elsewhere: the ``--detections`` file, a NumPy archive (``.npz``) of flat arrays.

``det_frame (N,)``, ``det_view (N,)`` and ``det_kpts (N, 17, 3)`` (x px, y px, score; score 0: not detected); where
there are objects ``obj_frame, obj_view, obj_class, obj_xyxy (K, 4), obj_score``; optionally ``frame_time_s``, the rig
times of frames 0 to F - 1: ``(F,)``, or ``(F, V)`` where each camera has its own (NaN: it has no frame). Pixels are
distorted, at the rig's image sizes; a view counts the rig's cameras.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.observations import ViewDetections
from recognition.sources.detections_form import check_taken_part, checked_objects, checked_people, checked_times, loaded
from rigcal.geometry import Bools, Floats, Ints
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Arrays whose rows belong to a view of a frame."""

    key: Ints
    """(N,) frame * cameras + view, ascending; rows of one key in the order of the file."""
    columns: tuple[NDArray[Any], ...]

    @classmethod
    def by_view(cls, frame: NDArray[Any], view: NDArray[Any], cameras: int, *columns: NDArray[Any]) -> _Rows:
        key = frame.astype(np.int64) * cameras + view.astype(np.int64)
        order = np.argsort(key, kind="stable")
        return cls(key[order], tuple(column[order] for column in columns))

    def of(self, key: int) -> tuple[NDArray[Any], ...]:
        first, end = np.searchsorted(self.key, (key, key + 1))
        return tuple(column[first:end] for column in self.columns)


@dataclass(frozen=True, slots=True, eq=False)
class DetectionsFile:
    """The detections of a whole capture; :meth:`views` gives those of one frame."""

    frames: range
    """Frame numbers: 0 to F - 1 where the file has times, else from the first detection's to the last one's."""
    time_s: Floats | None
    """(F, V) seconds of each frame by camera, NaN where a camera has none; None where the file has no times."""
    cameras: int
    """V, the number of the rig's cameras."""
    _people: _Rows
    _objects: _Rows

    def views(self, frame: int) -> tuple[ViewDetections, ...]:
        """(V,) detections of a frame number, in rig order; empty where the file has none."""
        return tuple(self._view(frame * self.cameras + view) for view in range(self.cameras))

    def times_ns(self, frame: int, *, use: Sequence[bool], fps: float) -> tuple[int | None, ...]:
        """(V,) rig time of each camera's view of a frame, by ``fps`` where the file has no times.

        None for a camera that has no frame, or that ``use`` leaves out.
        """
        times_s = [frame / fps] * self.cameras if self.time_s is None else self.time_s[frame].tolist()
        return tuple(
            round(t * 1e9) if used and math.isfinite(t) else None for t, used in zip(times_s, use, strict=True)
        )

    @property
    def has_own_times(self) -> bool:
        """Whether the cameras saw a frame at times of their own."""
        return self.time_s is not None and bool((np.nanmin(self.time_s, axis=1) < np.nanmax(self.time_s, axis=1)).any())

    def outside(self, number: Ints, seen: Bools) -> int:
        """How many people and objects belong to no frame of the instants ``number`` (I,), in which the cameras took
        part that ``seen`` (I, V) says; those of cameras that took part nowhere are not counted."""
        there = (number[:, None] * self.cameras + np.arange(self.cameras))[seen]
        keys = np.concatenate([self._people.key, self._objects.key])
        part: Bools = np.asarray(seen.any(axis=0))
        return int((~np.isin(keys, there) & part[keys % self.cameras]).sum())

    def _view(self, key: int) -> ViewDetections:
        (keypoints,) = self._people.of(key)
        classes, xyxy, score = self._objects.of(key)
        seen = keypoints[..., 2:] > 0
        return ViewDetections(
            people_px=np.where(seen, keypoints[..., :2], np.nan),
            people_score=np.minimum(keypoints[..., 2], 1.0),
            object_class=tuple(classes.tolist()),
            object_xyxy=xyxy,
            object_score=np.minimum(score, 1.0),
        )


def read_detections(path: Path, rig: Rig) -> DetectionsFile:
    """Read and check a detections file.

    Args:
        path: of the ``.npz`` file.
        rig: whose cameras the views are.

    Raises:
        DetectionsFileError: where the file cannot be read, an array is missing or has another shape, type or length,
            a view is not one of the rig's cameras, a number is not finite or a score not in 0..1, or times do not
            cover every frame or do not ascend.
    """
    arrays = loaded(path)
    cameras = len(rig.cameras)
    people, objects = checked_people(path, arrays, rig), checked_objects(path, arrays, rig)
    numbers = np.concatenate([people["det_frame"], objects["obj_frame"]]).astype(np.int64)
    frames = range(int(numbers.min()), int(numbers.max()) + 1) if len(numbers) else range(0)
    time_s = checked_times(path, arrays, frames, rig)
    check_taken_part(path, people, "det", time_s)
    check_taken_part(path, objects, "obj", time_s)
    return DetectionsFile(
        frames=frames if time_s is None else range(len(time_s)),
        time_s=time_s,
        cameras=cameras,
        _people=_Rows.by_view(people["det_frame"], people["det_view"], cameras, people["det_kpts"]),
        _objects=_Rows.by_view(
            objects["obj_frame"],
            objects["obj_view"],
            cameras,
            objects["obj_class"],
            objects["obj_xyxy"],
            objects["obj_score"],
        ),
    )


def write_detections(
    path: Path,
    frames: Sequence[Sequence[ViewDetections]],
    *,
    time_s: Sequence[float] | Sequence[Sequence[float]] | None = None,
) -> None:
    """Write the file that :func:`read_detections` reads.

    Args:
        path: of the file; it is overwritten.
        frames: (F,) frames from number 0, each with one entry per camera of the rig. Scores and pixels are stored
            as float32; hints are left out, for which the file has no word.
        time_s: (F,) seconds of the frames, or (F, V) by camera; None to write none.
    """
    flat = [(number, view, seen) for number, views in enumerate(frames) for view, seen in enumerate(views)]
    people = [len(seen.counted) for _, _, seen in flat]
    objects = [len(seen.object_class) for _, _, seen in flat]
    number, view = np.array([[n, v] for n, v, _ in flat], dtype=np.int64).reshape(-1, 2).T
    keypoints = np.concatenate(
        [np.zeros((0, 17, 3)), *(np.dstack([seen.people_px, seen.people_score])[seen.counted] for _, _, seen in flat)]
    )
    keypoints[np.isnan(keypoints).any(axis=-1)] = 0.0
    arrays: dict[str, NDArray[Any]] = {
        "det_frame": np.repeat(number, people).astype(np.int32),
        "det_view": np.repeat(view, people).astype(np.int16),
        "det_kpts": keypoints.astype(np.float32),
        "obj_frame": np.repeat(number, objects).astype(np.int32),
        "obj_view": np.repeat(view, objects).astype(np.int16),
        "obj_class": np.array([name for _, _, seen in flat for name in seen.object_class], dtype=np.str_),
        "obj_xyxy": np.concatenate([*(seen.object_xyxy for _, _, seen in flat), np.zeros((0, 4))]).astype(np.float32),
        "obj_score": np.concatenate([*(seen.object_score for _, _, seen in flat), np.zeros(0)]).astype(np.float32),
    }
    if time_s is not None:
        arrays["frame_time_s"] = np.asarray(time_s, dtype=np.float64)
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
