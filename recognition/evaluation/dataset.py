"""Data sets with 3D truth: folders of one of two forms.

**Multi-view data set**: ``dataset.json`` and ``data.npz``. Beside the detections (their form is in
:mod:`recognition.sources.detections_file`) ``data.npz`` holds the truth:

- ``gt_frame (G,)`` integers: number of the frame, counted as ``det_frame``, or the instants of the videos, are;
- ``gt_person (G,)`` integers: which worker;
- ``gt_joints (G, J, 3)``: metres in the world (the rig frame where the rig has no world); NaN: not known.

Where the last two have other names, they are known by their form; any that begins with ``gt_`` will do. The J joints
are those that ``dataset.json`` names under ``gt_joints``, of which those of COCO-17 are used, and the others told;
without names there they are COCO-17. Without detections in ``data.npz``, networks look at the videos of the folder.
Where it has them, ``frames.evaluation`` (``[[first, last], ...]``) says which frames count, and ``gt_actors_scored``
over which workers PCP3D is averaged.

**Sequence** as tools/sicsg writes it: videos and ``timestamps.csv``; ``truth.json`` with ``epoch_s``; and ``truth.npz``
with ``joints_m (F, W, 17, 3)`` in the world and ``t_s (F, V)``, whose first column is their time in seconds after the
epoch.

Either holds its rig file, ``NAME.rig.json``, or is given one.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.errors import DatasetError
from recognition.evaluation.plausible import check_bodies, check_once
from recognition.evaluation.timed import TimedTruth
from recognition.metrics import Truth
from recognition.observations import JOINTS
from rigcal.captures import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from rigcal.geometry import Bools

Arrays = Mapping[str, NDArray[Any]]
_FOOTAGE = IMAGE_SUFFIXES | VIDEO_SUFFIXES
_WRITE = "write the truth in one of the two forms; recognition run places workers without one"
_FORMS = (
    "integers gt_frame (G,) and gt_person (G,), floats gt_joints (G, J, 3) in data.npz, or joints_m, t_s in truth.npz"
)


@dataclass(frozen=True, slots=True)
class Dataset:
    """A folder that can be evaluated."""

    folder: Path
    rig: Path
    detections: Path | None
    """Detections file; None where there is none, and networks must look at the videos."""
    truth: Truth | TimedTruth
    """Of frames that are numbered as the detections are, or of times."""
    scored: tuple[int, ...] | None
    """The workers over whom PCP3D is averaged; None: all."""
    warnings: tuple[str, ...] = ()
    """What of the truth is not scored."""

    @property
    def capture(self) -> Path | None:
        """The videos, where they are needed: to be looked at, or for their times."""
        return None if self.detections and isinstance(self.truth, Truth) else self.folder


def open_dataset(folder: Path, *, rig: Path | None = None, detections: Path | None = None) -> Dataset:
    """Find what a data set holds and read its truth.

    Args:
        folder: Of the data set.
        rig: Rig file; None for the one in the folder.
        detections: Detections file; None for ``data.npz`` in the folder, where that has detections.

    Raises:
        DatasetError: where the folder has no truth, neither detections nor videos, no rig file or several, a file
            that cannot be read or has another form, or a truth that cannot be one: see
            :mod:`recognition.evaluation.plausible`.
    """
    if not folder.is_dir():
        raise _error(folder, "no such data set", expected="a folder", got="a file" if folder.exists() else "nothing")
    known, facts = folder / "data.npz", folder / "dataset.json"
    timed = (folder / "truth.npz").exists()
    if not timed and not known.exists():
        raise _error(folder, "this data set holds no 3D truth", expected=_FORMS, got="neither of the two files")
    about = _json(facts) if facts.exists() else {}
    truth, warnings = _truth_of_sequence(folder) if timed else _truth_of_frames(known, about)
    return Dataset(
        folder=folder,
        rig=rig or _rig_in(folder),
        detections=detections or _detections_in(folder),
        truth=truth,
        scored=_scored(facts, about, truth) if isinstance(truth, Truth) else None,
        warnings=warnings,
    )


def _detections_in(folder: Path) -> Path | None:
    """The detections file; None where there are videos or images in its place."""
    path = folder / "data.npz"
    arrays = _arrays(path) if path.exists() else {}
    if any(name.startswith("det_") for name in arrays):
        return path
    if any(each.is_dir() or each.suffix.lower() in _FOOTAGE for each in folder.iterdir()):
        return None
    raise _error(
        folder,
        "this data set has neither detections nor videos",
        expected="det_frame, det_view and det_kpts in data.npz, or a video of each camera",
        got=", ".join(arrays) or ", ".join(sorted(each.name for each in folder.iterdir())),
        do_next="name the detections with --detections FILE.npz, or put the videos into the folder",
    )


def _rig_in(folder: Path) -> Path:
    found = sorted(folder.glob("*.rig.json"))
    if len(found) == 1:
        return found[0]
    calibration = folder / "dataset.json"
    make = f"rigcal import {calibration} --from multiview-dataset -o NAME.rig.json, and then --rig NAME.rig.json"
    raise DatasetError(
        "which rig saw this data set is not clear" if found else "this data set has no rig file",
        where=folder,
        expected="one NAME.rig.json in the folder, or --rig",
        got=", ".join(path.name for path in found) or "none",
        do_next=make if not found and calibration.exists() else "name the rig file with --rig",
    )


def _truth_of_sequence(folder: Path) -> tuple[TimedTruth, tuple[str, ...]]:
    """The truth, and what of it is not scored."""
    path, facts = folder / "truth.npz", folder / "truth.json"
    arrays, epoch_s = _arrays(path), _json(facts).get("epoch_s")
    if not isinstance(epoch_s, (int, float)):
        raise _error(facts, "when the truth begins is not given", expected="epoch_s, seconds", got=epoch_s)
    if not {"joints_m", "t_s"} <= arrays.keys():
        got = ", ".join(arrays) or "no array"
        raise _error(path, "this data set holds no 3D truth of workers", expected="joints_m and t_s", got=got)
    joints_m, t_s = arrays["joints_m"], arrays["t_s"]
    if not _is_timed(joints_m, t_s):
        expected = "numbers joints_m (F, W, 17, 3) and t_s (F, V), its first column ascending"
        got = f"joints_m {joints_m.shape} {joints_m.dtype}, t_s {t_s.shape} {t_s.dtype}"
        raise _error(path, "the truth has another form", expected=expected, got=got)
    check_bodies(path, joints_m)
    return TimedTruth(round(epoch_s * 1e9) + np.rint(t_s[:, 0] * 1e9).astype(np.int64), joints_m), ()


def _is_timed(joints_m: NDArray[Any], t_s: NDArray[Any]) -> bool:
    if joints_m.dtype.kind != "f" or joints_m.ndim != 4 or joints_m.shape[2:] != (17, 3):
        return False
    if t_s.dtype.kind != "f" or t_s.ndim != 2 or 0 in t_s.shape or len(t_s) != len(joints_m):
        return False
    return bool(np.isfinite(t_s[:, 0]).all() and (np.diff(t_s[:, 0]) > 0).all())


def _truth_of_frames(path: Path, about: Mapping[str, Any]) -> tuple[Truth, tuple[str, ...]]:
    """The truth, and what of it is not scored."""
    facts = path.with_name("dataset.json")
    frame, person, joints = _rows(path, _arrays(path))
    names = _names(facts, about.get("gt_joints") or None, joints.shape[1])
    zero = (joints == 0).all(axis=2)
    joints_m = _coco(np.where(zero[..., None], np.nan, joints), names)
    known = _counts(facts, about, frame) & np.isfinite(joints_m).all(axis=-1).any(axis=1)
    if not known.any():
        raise _error(path, "the truth has no joint in a frame that counts", expected="one or more", got="none")
    check_once(path, frame[known], person[known])
    check_bodies(path, joints_m[known])
    return Truth(frame[known], person[known], joints_m[known]), tuple(_not_scored(names, int(zero[known].sum())))


def _not_scored(names: Sequence[str], zeros: int) -> Iterator[str]:
    """What a reader of the figures should know."""
    others = [name for name in names if name not in JOINTS]
    if others:
        yield (
            f"{len(others)} of the {len(names)} joints of the truth have no name of COCO-17 and are not scored: "
            f"{', '.join(others)}"
        )
    if zeros:
        yield f"{zeros} joints of the truth at exactly 0, 0, 0 were taken as not known, which NaN would say"


def _scored(path: Path, about: Mapping[str, Any], truth: Truth) -> tuple[int, ...] | None:
    named = about.get("gt_actors_scored")
    if not named:
        return None
    there = np.unique(truth.person).tolist()
    if not (isinstance(named, list) and any(name in there for name in named)):
        got = f"{named}, where the truth has {there}"
        raise _error(path, "gt_actors_scored names nobody of the truth", expected="a list of workers", got=got)
    return tuple(named)


def _rows(path: Path, arrays: Arrays) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Frame (G,), worker (G,) and joints (G, J, 3) of the truth."""
    given = {name: array for name, array in arrays.items() if name.startswith("gt_")}
    frame = given.pop("gt_frame", None)
    numbers = [name for name, array in given.items() if array.ndim == 1 and array.dtype.kind in "iu"]
    places = [name for name, array in given.items() if array.shape[2:] == (3,) and array.dtype.kind == "f"]
    numbers = ["gt_person"] if "gt_person" in numbers else numbers
    places = ["gt_joints"] if "gt_joints" in places else places
    got = ", ".join(f"{name} {array.shape} {array.dtype}" for name, array in arrays.items() if name.startswith("gt_"))
    if frame is None or len(numbers) != 1 or len(places) != 1:
        raise _error(path, "this data set holds no 3D truth", expected=_FORMS, got=got or "no array gt_...")
    person, joints = given[numbers[0]], given[places[0]]
    if frame.ndim != 1 or frame.dtype.kind not in "iu" or not len(frame) == len(person) == len(joints):
        raise _error(path, "the arrays of the truth do not fit each other", expected=_FORMS, got=got)
    return frame, person, joints


def _names(path: Path, given: Any, count: int) -> Sequence[str]:
    """Of the joints of the truth, so many; ``given`` is what dataset.json has, None for nothing."""
    names = JOINTS if given is None and count == len(JOINTS) else given
    is_list = isinstance(names, (list, tuple)) and all(isinstance(name, str) for name in names)
    if not is_list or len(names) != count or len(set(names)) != count or not set(names) & set(JOINTS):
        raise _error(
            path,
            "gt_joints does not name the joints of the truth",
            expected=f"a list of {count} different names, COCO-17's among them: {', '.join(JOINTS)}",
            got="no names" if given is None else given,
            do_next=f'add "gt_joints": [{count} names, in the order of the truth] to dataset.json',
        )
    return tuple(names)


def _coco(joints: NDArray[Any], names: Sequence[str]) -> NDArray[Any]:
    """(G, 17, 3) from joints (G, J, 3) with these names; those that COCO-17 does not have are left out."""
    result = np.full((len(joints), len(JOINTS), 3), np.nan)
    for index, name in enumerate(names):
        if name in JOINTS:
            result[:, JOINTS.index(name)] = joints[:, index]
    return result


def _counts(path: Path, about: Mapping[str, Any], frame: NDArray[Any]) -> Bools:
    """(G,) which rows are of frames that count."""
    frames = about.get("frames")
    if not isinstance(frames, dict) or not frames.get("evaluation"):
        return np.ones(len(frame), dtype=np.bool_)
    spans = frames["evaluation"]
    try:
        first, last = np.array(spans, dtype=np.int64).reshape(-1, 2).T
    except (TypeError, ValueError) as error:
        raise _error(path, "frames.evaluation has another form", expected="[[first, last], ...]", got=spans) from error
    end = last + bool(frames.get("inclusive", True))
    return np.asarray(((frame[:, None] >= first) & (frame[:, None] < end)).any(axis=1))


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise _error(path, "cannot read this file", expected="JSON", got=error) from error
    if not isinstance(content, dict):
        raise _error(path, "this file has another form", expected="an object", got=type(content).__name__)
    return content


def _arrays(path: Path) -> Arrays:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, TypeError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        raise _error(path, "cannot read this file", expected="a .npz file of plain arrays", got=error) from error


def _error(path: Path, what: str, *, expected: str, got: object, do_next: str = _WRITE) -> DatasetError:
    return DatasetError(
        what,
        where=path,
        expected=expected,
        got=got,
        do_next=do_next,
    )
