"""The offsets that all inequalities of a recording's light leave open: linear programs over all cameras at once.

Unknown, in milliseconds: of each camera its offset, drift, readout time and exposure (one while the light is on, one
while it is off, since automatic exposure tells them apart), and the times of each change of the light. The least and
the greatest offset that any of them allow are a hard interval (HiGHS). Changes that contradict the others, because a
camera saw something else, are found by the least sum of violations and taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import linprog

from rigcal.geometry import Floats, Ints, freeze
from rigcal.sync.content.light.exposures import END, START, Exposures

Unknown: TypeAlias = Literal["offset_s", "drift_ppm", "readout_s"]

_MOST_EXPOSURE = 1.3
"""Of a frame period: exposure ends with the frame, and a lamp's own rise of some milliseconds looks like more of it."""
_PER_CAMERA = 5  # offset, drift, readout, exposure in the dark, exposure in the light
_OFFSET, _DRIFT, _READOUT, _DARK, _LIT = range(_PER_CAMERA)
_PER_CHANGE = 2  # START, END
_AROUND_MS = 5e3  # a change is within this of where the reference saw it: no limit in practice
_GROSS_MS = 1.0  # a change that contradicts the others by more was another one, or of another lamp
_EASED = 3.0  # where limits contradict each other by less: how many times that they are eased, all alike


@dataclass(frozen=True, slots=True)
class LightCamera:
    """What is known of a camera beforehand."""

    offset_s: float
    """Coarse offset; the unknown one is within ``within_s`` of it. The reference's is 0."""
    within_s: float
    """0 for the reference, whose clock all others are measured in."""
    at_s: float
    """Camera time at which the offset is asked for."""
    period_s: float
    greatest_drift_ppm: float
    """0 for the reference."""
    slack_s: float
    """How far its stamps may be from the times that its rows were exposed at: jitter, and blocks of an encoder."""
    least_readout_s: float
    greatest_readout_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One change as one camera saw it."""

    camera: int
    change: int
    in_the_dark: bool
    """Whether the light was off before it."""
    exposures: Exposures


@dataclass(frozen=True, slots=True, eq=False)
class Polytope:
    """All that a recording's light says: ``matrix @ x <= limit``, ``least <= x <= greatest``."""

    cameras: tuple[LightCamera, ...]
    matrix: Floats
    limit: Floats
    least: Floats
    greatest: Floats
    seen: Ints
    """(m,) index of the ``Seen`` that each row comes from."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, limit=(None,), least=(None,), greatest=(len(self.least),))
        freeze(self, np.float64, matrix=(len(self.limit), len(self.least)))
        freeze(self, np.int64, seen=(len(self.limit),))

    def column(self, camera: int, unknown: Unknown) -> int:
        """Where an unknown of a camera stands in ``x``."""
        return camera * _PER_CAMERA + {"offset_s": _OFFSET, "drift_ppm": _DRIFT, "readout_s": _READOUT}[unknown]

    def in_units(self, camera: int, unknown: Unknown, value: float) -> float:
        """A value of ``x`` in the unit that the unknown is named with; offsets from 0."""
        if unknown == "drift_ppm":
            return value
        return value / 1e3 + (self.cameras[camera].offset_s if unknown == "offset_s" else 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Consistent:
    """What is left once changes that contradict the others are taken out."""

    polytope: Polytope
    kept: tuple[Seen, ...]
    rejected: tuple[Seen, ...]
    violation_s: Floats
    """(n,) by how much each of all changes as seen contradicted the others at first; mostly 0."""


def consistent(cameras: Sequence[LightCamera], change_t_s: Floats, seen: Sequence[Seen]) -> Consistent:
    """The inequalities that hold together.

    Args:
        cameras: the cameras.
        change_t_s: (n,) about when each change was, by the reference's clock.
        seen: the changes as the cameras saw them.
    """
    kept, at_first = list(seen), np.zeros(len(seen))
    rejected: list[Seen] = []
    while True:
        polytope = _polytope(cameras, change_t_s, kept)
        violation_ms = _least_violation_ms(polytope, len(kept))
        if not rejected:
            at_first = violation_ms / 1e3
        if violation_ms.max(initial=0.0) <= _GROSS_MS:
            return Consistent(_widened(polytope), tuple(kept), tuple(rejected), at_first)
        rejected.append(kept.pop(int(np.argmax(violation_ms))))


def _widened(polytope: Polytope) -> Polytope:
    """The polytope with all limits eased by a multiple of the least that makes them hold together."""
    eased = (polytope.seen >= 0)[:, None] * -1.0
    cost = np.append(np.zeros(len(polytope.least)), 1.0)
    least_ms = float(_solved(cost, np.hstack((polytope.matrix, eased)), polytope)[-1])
    return replace(polytope, limit=polytope.limit - eased[:, 0] * _EASED * least_ms)


def corner(polytope: Polytope, cost: Floats) -> Floats:
    """(u,) the unknowns of a polytope that cost least."""
    return _solved(cost, polytope.matrix, polytope)


def interval(polytope: Polytope, camera: int, unknown: Unknown) -> tuple[float, float]:
    """The least and the greatest value of a camera's unknown that the inequalities allow: hard bounds."""
    column = polytope.column(camera, unknown)
    cost = np.eye(1, len(polytope.least), column)[0]
    ends = [float(corner(polytope, sign * cost)[column]) for sign in (1.0, -1.0)]
    return polytope.in_units(camera, unknown, ends[0]), polytope.in_units(camera, unknown, ends[1])


def _polytope(cameras: Sequence[LightCamera], change_t_s: Floats, seen: Sequence[Seen]) -> Polytope:
    least, greatest = _ranges(cameras, len(change_t_s))
    blocks, limits = [_flashes_last(len(cameras), len(change_t_s))], [np.zeros(len(change_t_s))]
    for one in seen:
        matrix, limit = _rows(one, cameras[one.camera], float(change_t_s[one.change]), len(cameras), len(least))
        blocks.append(matrix)
        limits.append(limit)
    owner = np.repeat(np.arange(-1, len(seen)), [len(limit) for limit in limits])
    return Polytope(tuple(cameras), np.concatenate(blocks), np.concatenate(limits), least, greatest, owner)


def _ranges(cameras: Sequence[LightCamera], changes: int) -> tuple[Floats, Floats]:
    """Least and greatest of each unknown: milliseconds, and ppm of drift."""
    greatest = [
        [
            1e3 * camera.within_s,
            camera.greatest_drift_ppm,
            1e3 * camera.greatest_readout_s,
            *(1e3 * _MOST_EXPOSURE * camera.period_s,) * 2,
        ]
        for camera in cameras
    ]
    least = [
        [-row[_OFFSET], -row[_DRIFT], 1e3 * camera.least_readout_s, 0.0, 0.0]
        for camera, row in zip(cameras, greatest, strict=True)
    ]
    around = np.full(changes * _PER_CHANGE, _AROUND_MS)
    return np.append(np.ravel(least), -around), np.append(np.ravel(greatest), around)


def _flashes_last(cameras: int, changes: int) -> Floats:
    """Rows that say that a change ends after it started."""
    rows = np.zeros((changes, cameras * _PER_CAMERA + changes * _PER_CHANGE))
    first = cameras * _PER_CAMERA + np.arange(changes) * _PER_CHANGE
    rows[np.arange(changes), first + START], rows[np.arange(changes), first + END] = 1.0, -1.0
    return rows


def _rows(one: Seen, camera: LightCamera, change_t_s: float, cameras: int, width: int) -> tuple[Floats, Floats]:
    """(m, width) matrix and (m,) limit of one change as one camera saw it."""
    exposures, first = one.exposures, one.camera * _PER_CAMERA
    rows = np.zeros((len(exposures.sign), width))
    rows[:, first + _OFFSET] = 1.0
    rows[:, first + _DRIFT] = (exposures.t_s - camera.at_s) * 1e-3  # ms per ppm
    rows[:, first + _READOUT] = exposures.row
    rows[:, first + (_DARK if one.in_the_dark else _LIT)] = exposures.exposure
    rows[np.arange(len(rows)), cameras * _PER_CAMERA + one.change * _PER_CHANGE + exposures.end] = -1.0
    late_ms = 1e3 * (exposures.t_s + camera.offset_s - change_t_s)
    return rows * exposures.sign[:, None], 1e3 * camera.slack_s - exposures.sign * late_ms


def _least_violation_ms(polytope: Polytope, seen: int) -> Floats:
    """(n,) how far each change as seen must be violated for the sum of violations to be least."""
    if not seen:
        return np.zeros(0)
    owned = np.flatnonzero(polytope.seen >= 0)
    relaxed = np.zeros((len(polytope.seen), seen))
    relaxed[owned, polytope.seen[owned]] = -1.0
    cost = np.concatenate((np.zeros(len(polytope.least)), np.ones(seen)))
    return _solved(cost, np.hstack((polytope.matrix, relaxed)), polytope)[len(polytope.least) :]


def _solved(cost: Floats, matrix: Floats, polytope: Polytope) -> Floats:
    """The unknowns that cost least; unknowns beyond the polytope's are at least 0."""
    more = len(cost) - len(polytope.least)
    bounds = [*zip(polytope.least.tolist(), polytope.greatest.tolist(), strict=True), *[(0.0, np.inf)] * more]
    solution = linprog(cost, A_ub=matrix, b_ub=polytope.limit, bounds=bounds, method="highs")
    if solution.x is None:
        raise ArithmeticError(f"linear program of {matrix.shape} rows and unknowns: {solution.message}")
    return np.asarray(solution.x, dtype=np.float64)
