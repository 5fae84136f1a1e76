"""Is the board as large as it was entered? The rig's scale against lengths measured by hand.

Every length of a rig is as wrong as the size of the board that calibrated it, and no residual shows it. A tape between
two cameras, or calipers on the printed board, do. The rig is never rescaled here: a wrong length of either kind is
for a person to find.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.board import AprilGrid, Board
from rigcal.geometry import Pose
from rigcal.measured import MeasuredDistance, MeasuredLength, require_cameras
from rigcal.uncertainty import RigCovariance, camera_distance

DIFFER_SIGMA = 3.0
"""Difference of one distance from what the others say, over its sigma, above which it is told apart from them."""


@dataclass(frozen=True, slots=True)
class ScaleEvidence:
    """One measured length beside the same length in the rig, or on the board as it was entered."""

    name: str
    """``cam0-cam1``, or ``square`` (``tag`` on an AprilGrid)."""
    measured_m: float
    found_m: float
    """In the rig, or as it was entered."""
    percent: float
    """How much longer what was found is: the board was entered too large by so much."""
    sigma_percent: float
    """One sigma of it, from the rig's covariance and the digits that were written."""


@dataclass(frozen=True, slots=True)
class ScaleCheck:
    """What measured lengths say of the board's size."""

    percent: float
    """How much too large the board was entered; negative: too small."""
    sigma_percent: float
    evidence: tuple[ScaleEvidence, ...]
    advice: str
    """What to enter or to measure again, in words."""


def check_scale(
    board: Board,
    camera_ids: Sequence[str],
    cam_from_rig: Sequence[Pose],
    covariance: RigCovariance,
    *,
    distances: Sequence[MeasuredDistance] = (),
    square: MeasuredLength | None = None,
) -> ScaleCheck | None:
    """Compare the rig and its board with measured lengths; None where none was given.

    Distances are joined by their variances; one that contradicts the others by :data:`DIFFER_SIGMA` speaks for itself,
    since either the tape or the rig is wrong there. The larger of what the distances and the square say is the answer.

    Raises:
        MeasuredLengthError: for a camera that the rig does not have.
    """
    require_cameras(distances, camera_ids)
    found = [_distance_evidence(camera_ids, cam_from_rig, covariance, distance) for distance in distances]
    checks = []
    if found:
        checks.append(_joined(board, found))
    if square is not None:
        checks.append(_square_check(board, square))
    if not checks:
        return None
    worst = max(checks, key=lambda check: abs(check.percent))
    evidence = tuple(item for check in checks for item in check.evidence)
    advice = worst.advice
    if len(checks) == 2 and _differ(*checks):
        told = [f"{abs(check.percent):.1f} % too {_direction(check.percent)}" for check in checks]
        advice = (
            f"measure again, the tape and the {_part(board)} contradict each other: by the distances the board was "
            f"entered {told[0]}, by its {_part(board)} {told[1]}"
        )
    return ScaleCheck(worst.percent, worst.sigma_percent, evidence, advice)


def _differ(one: ScaleCheck, two: ScaleCheck) -> bool:
    return abs(one.percent - two.percent) > DIFFER_SIGMA * float(np.hypot(one.sigma_percent, two.sigma_percent))


def _direction(percent: float) -> str:
    return "large" if percent >= 0 else "small"


def _distance_evidence(
    camera_ids: Sequence[str], cam_from_rig: Sequence[Pose], covariance: RigCovariance, measured: MeasuredDistance
) -> ScaleEvidence:
    first, second = (list(camera_ids).index(camera) for camera in measured.cameras)
    found_m, sigma_m = camera_distance(cam_from_rig, covariance, first, second)
    return _evidence("-".join(measured.cameras), measured.length, found_m, sigma_m)


def _evidence(name: str, measured: MeasuredLength, found_m: float, sigma_m: float) -> ScaleEvidence:
    sigma = float(np.hypot(sigma_m, measured.sigma_m)) / measured.length_m
    return ScaleEvidence(name, measured.length_m, found_m, 100 * (found_m / measured.length_m - 1), 100 * sigma)


def _joined(board: Board, found: Sequence[ScaleEvidence]) -> ScaleCheck:
    percents = np.array([item.percent for item in found])
    information = np.array([1 / max(item.sigma_percent, 1e-9) ** 2 for item in found])
    percent, sigma = float(information @ percents / information.sum()), float(information.sum() ** -0.5)
    odd = max(found, key=lambda item: abs(item.percent - percent) / max(item.sigma_percent, 1e-9))
    said = ", ".join(
        f"{item.name} is {_length(item.found_m)} here and {_length(item.measured_m)} by tape" for item in found
    )
    if len(found) > 1 and abs(odd.percent - percent) > DIFFER_SIGMA * odd.sigma_percent:
        advice = f"the measured distances contradict each other: {said}; measure {odd.name} again, then the others"
        return ScaleCheck(odd.percent, odd.sigma_percent, tuple(found), advice)
    return ScaleCheck(percent, sigma, tuple(found), f"{_too_large(board, percent, sigma)} ({said})")


def _square_check(board: Board, square: MeasuredLength) -> ScaleCheck:
    item = _evidence(_part(board), square, board.square_size_m, 0.0)
    return ScaleCheck(item.percent, item.sigma_percent, (item,), _too_large(board, item.percent, item.sigma_percent))


def _too_large(board: Board, percent: float, sigma: float) -> str:
    size_m = board.square_size_m
    fits = _millimetres(size_m / (1 + percent / 100))
    return (
        f"the board was entered {abs(percent):.1f} % too {_direction(percent)} (one sigma {sigma:.1f} %): enter the "
        f"{_part(board)} as {fits} (you gave {_millimetres(size_m)}), or measure again"
    )


def _part(board: Board) -> str:
    return "tag" if isinstance(board, AprilGrid) else "square"


def _millimetres(metres: float) -> str:
    return f"{metres * 1e3:.4g}mm"


def _length(metres: float) -> str:
    return f"{metres:.3f}m" if metres >= 1 else _millimetres(metres)
