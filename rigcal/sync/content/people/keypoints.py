"""People in a detections file: which camera saw which joints in which frame, without identity or order.

The file is the NumPy archive (``.npz``) that ``--detections`` takes: ``det_frame (N,)``, ``det_view (N,)`` and
``det_kpts (N, 17, 3)`` (x px, y px, score; score 0: not detected), and optionally ``frame_time_s (F,)``, the times of
frames 0 to F - 1. Objects, and arrays of other names, are not looked at.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import KeypointsFileError
from rigcal.geometry import Floats, Ints, freeze
from rigcal.rig import Rig

JOINTS = 17
"""Joints of a person, in COCO's order."""
_NEEDED = ("det_frame", "det_view", "det_kpts")
_TIMES = "frame_time_s"
_FORMS: dict[str, tuple[tuple[int | None, ...], str, str]] = {
    "det_frame": ((None,), "iu", "integers"),
    "det_view": ((None,), "iu", "integers"),
    "det_kpts": ((None, JOINTS, 3), "fiu", "numbers"),
    _TIMES: ((None,), "fiu", "numbers"),
}
"""Shape (None: any length), NumPy's kinds of the type, and the kind in words."""
_MAX_SCORE = 1.001
"""Scores are in 0..1; the excess allows for float32."""


@dataclass(frozen=True, slots=True, eq=False)
class Keypoints:
    """N detections of people by the cameras of a rig, in any order."""

    frame: Ints
    """(N,) frame number of each detection, 0 or more."""
    view: Ints
    """(N,) index of its camera in the rig."""
    kpts: Floats
    """(N, 17, 3) x and y in distorted pixels, and the score in 0..1; score 0: not detected."""
    frame_time_s: Floats | None = None
    """(F,) seconds of frames 0 to F - 1, ascending; None where the file has no times."""

    def __post_init__(self) -> None:
        count = len(self.frame)
        freeze(self, np.int64, frame=(count,), view=(count,))
        freeze(self, np.float64, kpts=(count, JOINTS, 3))
        if self.frame_time_s is not None:
            freeze(self, np.float64, frame_time_s=(None,))

    @property
    def frames(self) -> int:
        """F, the number of frames: one more than the last that a detection or a time names."""
        last = int(self.frame.max()) + 1 if len(self.frame) else 0
        return last if self.frame_time_s is None else max(last, len(self.frame_time_s))


def read_keypoints(path: Path, rig: Rig) -> Keypoints:
    """Read and check the people of a detections file.

    Args:
        path: of the ``.npz`` file.
        rig: whose cameras the views are.

    Raises:
        KeypointsFileError: where the file cannot be read, an array is missing or has another shape, type or length,
            a view is not one of the rig's cameras, a number is not finite or a score not in 0..1, or times do not
            cover every frame or do not ascend.
    """
    arrays = _loaded(path)
    missing = [name for name in _NEEDED if name not in arrays]
    if missing:
        got = ", ".join(arrays) or "none of them"
        raise KeypointsFileError(path, f"no array {', '.join(missing)}", expected=", ".join(_NEEDED), got=got)
    for name, array in arrays.items():
        _check_form(path, name, array)
    frame, view, kpts = (arrays[name] for name in _NEEDED)
    _check_rows(path, frame, view, kpts, rig)
    score = kpts[..., 2]
    if not ((score >= 0) & (score <= _MAX_SCORE)).all():
        bad = score[~((score >= 0) & (score <= _MAX_SCORE))][0]
        raise KeypointsFileError(path, "det_kpts has a score out of range", expected="0 to 1", got=f"{bad:g}")
    _check_finite(path, "det_kpts", kpts[score > 0])
    if _TIMES in arrays:
        _check_times(path, arrays[_TIMES], int(frame.max()) + 1 if len(frame) else 0)
    return Keypoints(frame, view, kpts, arrays.get(_TIMES))


def _loaded(path: Path) -> Mapping[str, NDArray[Any]]:
    """The arrays of the file that have a documented name."""
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if isinstance(archive, np.ndarray):
                raise KeypointsFileError(
                    path, "this file is one array", expected="an archive of arrays (.npz)", got=archive.shape
                )
            return {name: archive[name] for name in archive.files if name in _FORMS}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise KeypointsFileError(
            path, "cannot read this file", expected="a .npz file of plain arrays", got=error
        ) from error


def _check_form(path: Path, name: str, array: NDArray[Any]) -> None:
    """The shape and the kind of numbers of one array."""
    shape, kinds, words = _FORMS[name]
    if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        letter = "F" if name == _TIMES else "N"
        wanted = ", ".join(letter if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "")
        raise KeypointsFileError(path, f"{name} has another shape", expected=f"({wanted})", got=array.shape)
    if array.dtype.kind not in kinds:
        raise KeypointsFileError(path, f"{name} has another type", expected=words, got=array.dtype)


def _check_rows(path: Path, frame: NDArray[Any], view: NDArray[Any], kpts: NDArray[Any], rig: Rig) -> None:
    """One length for all, frames from 0, and views that the rig has."""
    if len({len(frame), len(view), len(kpts)}) > 1:
        got = f"det_frame {len(frame)}, det_view {len(view)}, det_kpts {len(kpts)}"
        raise KeypointsFileError(
            path, "arrays that belong together differ in length", expected="one row for each detection", got=got
        )
    outside = np.flatnonzero((view < 0) | (view >= len(rig.cameras)))
    if len(outside):
        expected = f"0 to {len(rig.cameras) - 1}, the cameras {', '.join(rig.camera_ids)} of the rig"
        got = f"{view[outside[0]]} in row {outside[0]}"
        raise KeypointsFileError(path, "det_view has no such camera", expected=expected, got=got)
    negative = np.flatnonzero(frame < 0)
    if len(negative):
        got = f"{frame[negative[0]]} in row {negative[0]}"
        raise KeypointsFileError(path, "det_frame is negative", expected="0 or more", got=got)


def _check_times(path: Path, time_s: NDArray[Any], frames: int) -> None:
    """A finite time for each frame, each after the one before."""
    _check_finite(path, _TIMES, time_s)
    if len(time_s) < frames:
        expected = f"{frames} times or more, one for each frame from 0 to {frames - 1}"
        raise KeypointsFileError(path, f"{_TIMES} does not cover every frame", expected=expected, got=len(time_s))
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        n = int(back[0])
        got = f"{time_s[n]:g} s, then {time_s[n + 1]:g} s at frame {n + 1}"
        raise KeypointsFileError(path, f"{_TIMES} does not ascend", expected="each time after the one before", got=got)


def _check_finite(path: Path, name: str, values: NDArray[Any]) -> None:
    if not np.isfinite(values).all():
        got = f"{(~np.isfinite(values)).sum()} that are not finite"
        raise KeypointsFileError(path, f"{name} has numbers that are not finite", expected="finite numbers", got=got)
