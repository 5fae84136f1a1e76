"""Mistakes in a truth that would not stop an evaluation, but make its figures meaningless: found by what bodies are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recognition.errors import DatasetError
from recognition.metrics import PARTS
from recognition.observations import JOINTS
from rigcal.geometry import Floats, Ints

SHORTEST_M, LONGEST_M = 0.1, 0.75
"""Between them is the median length of every upper and lower arm and leg: those of an adult of 1.70 m have 0.25 to 0.42
(Drillis and Contini), which leaves room for toddlers, giants and where somebody else puts a joint."""
_USUAL_M = 0.33
_LIMBS = tuple((start[0], end[0]) for name, start, end in PARTS if name.startswith(("upper", "lower")))
_UNITS = {"millimetres": 1e-3, "centimetres": 1e-2}


def check_bodies(path: Path, joints_m: Floats) -> None:
    """Refuse limbs of other than human length.

    Args:
        path: Where the truth is, for the message.
        joints_m: (..., 17, 3) metres; NaN where not known.

    Raises:
        DatasetError: which says so where another unit would make them human.
    """
    joints_m = joints_m.reshape(-1, 17, 3)
    lengths_m = _median_lengths_m(joints_m)
    if _is_human(lengths_m):
        return
    unit = next((name for name, metres in _UNITS.items() if _is_human(lengths_m * metres)), None)
    worst = int(np.nanargmax(np.abs(np.log(np.maximum(lengths_m, 1e-9) / _USUAL_M))))
    start, end = (JOINTS[joint] for joint in _LIMBS[worst])
    raise DatasetError(
        "limbs of the truth have no human length",
        where=path,
        expected=f"metres, and every limb {SHORTEST_M:g} to {LONGEST_M:g} m long (median)",
        got=f"{lengths_m[worst]:.3g} from {start} to {end}" + (f", as in {unit}" if unit else ""),
        do_next=f"write it in metres: divide by {1 / _UNITS[unit]:g}"
        if unit
        else "name the joints in the order of the truth, as gt_joints in dataset.json, and give metres",
    )


def check_once(path: Path, frame: Ints, person: Ints) -> None:
    """Refuse a worker who is in a frame twice.

    Raises:
        DatasetError: with the first such row.
    """
    order = np.lexsort((person, frame))
    again = np.flatnonzero((np.diff(frame[order]) == 0) & (np.diff(person[order]) == 0))
    if len(again):
        row = int(order[again[0] + 1])
        raise DatasetError(
            "the truth has a worker twice in one frame",
            where=path,
            expected="one row for each worker and frame",
            got=f"worker {person[row]} in frame {frame[row]} again in row {row}",
            do_next="give every worker a number of its own in gt_person",
        )


def _median_lengths_m(joints_m: Floats) -> Floats:
    """(8,) of the limbs that are known, NaN for the others."""
    first, second = np.array(_LIMBS).T
    lengths_m = np.linalg.norm(joints_m[:, first] - joints_m[:, second], axis=2)
    known = [column[np.isfinite(column)] for column in lengths_m.T]
    return np.array([np.median(column) if len(column) else np.nan for column in known])


def _is_human(lengths_m: Floats) -> bool:
    known = lengths_m[np.isfinite(lengths_m)]
    return bool(((known >= SHORTEST_M) & (known <= LONGEST_M)).all())
