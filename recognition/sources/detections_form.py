"""The form of a detections file: what :mod:`recognition.sources.detections_file` checks before it believes one."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from recognition.errors import DetectionsFileError
from rigcal.geometry import Floats
from rigcal.rig import Rig

Arrays: TypeAlias = Mapping[str, NDArray[Any]]
_FORMS: dict[str, tuple[tuple[int | None, ...], str]] = {
    "det_frame": ((None,), "integers"),
    "det_view": ((None,), "integers"),
    "det_kpts": ((None, 17, 3), "numbers"),
    "obj_frame": ((None,), "integers"),
    "obj_view": ((None,), "integers"),
    "obj_class": ((None,), "text"),
    "obj_xyxy": ((None, 4), "numbers"),
    "obj_score": ((None,), "numbers"),
}
"""Shape (None: any length) and kind of each array of detections."""
_KINDS: dict[str, tuple[str, type[np.generic]]] = {
    "integers": ("iu", np.int64),
    "numbers": ("fiu", np.float64),
    "text": ("U", np.str_),
}
"""The kinds of NumPy types that an array may have, and the type of an absent one."""
_TIMES = "frame_time_s"
_PEOPLE = ("det_frame", "det_view", "det_kpts")
_OBJECTS = ("obj_frame", "obj_view", "obj_class", "obj_xyxy", "obj_score")
_MAX_SCORE = 1.001
"""Scores are in 0..1; the excess allows for float32."""


def loaded(path: Path) -> Arrays:
    """The arrays of the file that have a documented name; others are another program's.

    Raises:
        DetectionsFileError: where it cannot be read, is damaged, or holds Python objects.
    """
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if isinstance(archive, np.ndarray):
                raise _error(path, "this file is one array", expected="an archive of arrays (.npz)", got=archive.shape)
            return {name: archive[name] for name in archive.files if name in (*_FORMS, _TIMES)}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise _error(path, "cannot read this file", expected="a .npz file of plain arrays", got=error) from error


def checked_people(path: Path, arrays: Arrays, rig: Rig) -> Arrays:
    """``det_frame``, ``det_view`` and ``det_kpts``; DetectionsFileError where they are not as documented."""
    missing = [name for name in _PEOPLE if name not in arrays]
    if missing:
        got = ", ".join(arrays) or "none of the documented arrays"
        raise _error(path, f"no array {', '.join(missing)}", expected=", ".join(_PEOPLE), got=got)
    people = {name: arrays[name] for name in _PEOPLE}
    _check_forms(path, people)
    _check_places(path, people["det_frame"], people["det_view"], "det", rig)
    score = people["det_kpts"][..., 2]
    _check_scores(path, "det_kpts[..., 2]", score)
    _check_finite(path, "det_kpts", people["det_kpts"][score > 0])
    return people


def checked_objects(path: Path, arrays: Arrays, rig: Rig) -> Arrays:
    """The five arrays of objects, empty where the file has none; DetectionsFileError as above."""
    objects = {name: arrays[name] for name in _OBJECTS if name in arrays}
    if not objects:
        return {name: _nothing(name) for name in _OBJECTS}
    missing = [name for name in _OBJECTS if name not in objects]
    if missing:
        raise _error(
            path,
            f"no array {', '.join(missing)}",
            expected="all five arrays of objects, or none",
            got=", ".join(objects),
        )
    _check_forms(path, objects)
    _check_places(path, objects["obj_frame"], objects["obj_view"], "obj", rig)
    _check_scores(path, "obj_score", objects["obj_score"])
    _check_finite(path, "obj_xyxy", objects["obj_xyxy"])
    turned = (objects["obj_xyxy"][:, 2:] < objects["obj_xyxy"][:, :2]).any(axis=1)
    if turned.any():
        row = int(turned.argmax())
        got = f"{objects['obj_xyxy'][row].tolist()} in row {row}"
        raise _error(
            path, "obj_xyxy has a box that ends before it begins", expected="left, top, right, bottom", got=got
        )
    return objects


def checked_times(path: Path, arrays: Arrays, frames: range, rig: Rig) -> Floats | None:
    """``frame_time_s`` as (F, V), None where the file has none; NaN: the camera has no frame.

    Raises:
        DetectionsFileError: where a frame has no time, it does not cover ``frames``, or the times of the frames or of
            a camera do not ascend.
    """
    if _TIMES not in arrays:
        return None
    given, cameras = arrays[_TIMES], len(rig.cameras)
    if not given.ndim or given.shape[1:] not in ((), (cameras,)):
        expected = f"(N), or (N, {cameras}) with a time for each camera"
        raise _error(path, f"{_TIMES} has another shape", expected=expected, got=given.shape)
    if given.dtype.kind not in _KINDS["numbers"][0]:
        raise _error(path, f"{_TIMES} has another type", expected="numbers", got=given.dtype)
    columns = given.astype(np.float64).reshape(len(given), -1)
    _check_finite(path, _TIMES, columns[np.isnan(columns).all(axis=1) | np.isinf(columns).any(axis=1)])
    if len(given) < frames.stop:
        raise _error(
            path,
            f"{_TIMES} does not cover every frame",
            expected=f"{frames.stop} times or more, one for each frame from 0 to {frames.stop - 1}",
            got=len(given),
        )
    for t_s in (np.nanmean(columns, axis=1), *columns.T):
        _check_ascending(path, t_s)
    time_s = np.tile(columns, (1, cameras // columns.shape[1]))
    time_s.setflags(write=False)
    return time_s


def check_taken_part(path: Path, arrays: Arrays, kind: str, time_s: Floats | None) -> None:
    """Refuse detections, ``det`` or ``obj``, of a camera that has no time in their frame; DetectionsFileError."""
    if time_s is None:
        return
    frame, view = arrays[f"{kind}_frame"], arrays[f"{kind}_view"]
    absent = np.flatnonzero(np.isnan(time_s[frame, view]))
    if len(absent):
        row = int(absent[0])
        got = f"frame {frame[row]}, view {view[row]} in row {row}"
        what = f"{kind}_view names a camera that has no time in its frame"
        raise _error(path, what, expected=f"a time in {_TIMES} for each detection's frame and view", got=got)


def _check_ascending(path: Path, t_s: Floats) -> None:
    frame = np.flatnonzero(np.isfinite(t_s))
    back = np.flatnonzero(np.diff(t_s[frame]) <= 0)
    if len(back):
        last, n = frame[back[0]], frame[back[0] + 1]
        got = f"{t_s[last]:g} s, then {t_s[n]:g} s at frame {n}"
        raise _error(path, f"{_TIMES} does not ascend", expected="each time after the one before", got=got)


def _nothing(name: str) -> NDArray[Any]:
    """The array of that name without rows."""
    shape, kind = _FORMS[name]
    return np.zeros([n or 0 for n in shape], dtype=_KINDS[kind][1])


def _check_forms(path: Path, arrays: Arrays) -> None:
    """Shapes, types and one length for all."""
    for name, array in arrays.items():
        shape, kind = _FORMS[name]
        if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
            wanted = ", ".join("N" if n is None else str(n) for n in shape)
            raise _error(path, f"{name} has another shape", expected=f"({wanted})", got=array.shape)
        if array.dtype.kind not in _KINDS[kind][0]:
            raise _error(path, f"{name} has another type", expected=kind, got=array.dtype)
    if len({len(array) for array in arrays.values()}) > 1:
        got = ", ".join(f"{name} {len(array)}" for name, array in arrays.items())
        raise _error(
            path, "arrays that belong together differ in length", expected="one row for each detection", got=got
        )


def _check_places(path: Path, frame: NDArray[Any], view: NDArray[Any], kind: str, rig: Rig) -> None:
    cameras = len(rig.cameras)
    outside = np.flatnonzero((view < 0) | (view >= cameras))
    if len(outside):
        row = int(outside[0])
        expected = f"0 to {cameras - 1}, the cameras {', '.join(rig.camera_ids)} of the rig"
        raise _error(path, f"{kind}_view has no such camera", expected=expected, got=f"{view[row]} in row {row}")
    if (frame < 0).any():
        row = int((frame < 0).argmax())
        raise _error(path, f"{kind}_frame is negative", expected="0 or more", got=f"{frame[row]} in row {row}")


def _check_scores(path: Path, name: str, score: NDArray[Any]) -> None:
    good = (score >= 0) & (score <= _MAX_SCORE)
    if not good.all():
        raise _error(path, f"{name} has a score out of range", expected="0 to 1", got=f"{score[~good][0]:g}")


def _check_finite(path: Path, name: str, values: NDArray[Any]) -> None:
    if not np.isfinite(values).all():
        got = f"{(~np.isfinite(values)).sum()} that are not finite"
        raise _error(path, f"{name} has numbers that are not finite", expected="finite numbers", got=got)


def _error(path: Path, what: str, *, expected: str, got: object) -> DetectionsFileError:
    return DetectionsFileError(
        f"detections file: {what}",
        where=path,
        expected=expected,
        got=got,
        do_next="write the arrays det_frame, det_view, det_kpts (and obj_frame, obj_view, obj_class, obj_xyxy, "
        "obj_score, frame_time_s where there are any) as recognition/README.md describes them",
    )
