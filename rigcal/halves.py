"""Two halves of the views solved apart: what agrees with itself may still be wrong, what does not is.

Boards are divided in two ways, within each set of cameras that saw boards together, so that both halves join the same
cameras. Every second board to the other half says how far chance decides the result. The earlier boards to one half
and the later to the other also shows a camera that was moved during the capture, or a board that bent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rigcal.bundle import POSE, Solution, SolveOptions, solve
from rigcal.geometry import Bools, Floats, Pose
from rigcal.refine import JointResult
from rigcal.uncertainty import cross_matrix

MIN_BOARDS = 3
"""Boards that each camera needs in either half."""


@dataclass(frozen=True, slots=True)
class Movement:
    """A camera that stood elsewhere in the earlier half of the capture than in the later one."""

    camera: int
    deg: float
    """Change of its orientation."""
    m: float
    """Change of its place."""


@dataclass(frozen=True, slots=True)
class SplitHalf:
    """How two halves of a capture, solved apart, differ."""

    gap: float
    """Difference of the camera poses over its own sigma (Mahalanobis distance per root degree of freedom), the greater
    of the two ways to divide."""
    distance_percent: float
    """Greatest difference of a distance between two cameras, every second board in the other half."""
    farthest: tuple[int, int]
    """The two cameras whose distance differs most."""
    movement: Movement | None
    """The one camera that explains why earlier and later boards disagree; None where they agree or none explains it."""


def split_half(joint: JointResult, limit: float) -> SplitHalf | None:
    """Compare halves; None for a single camera, and where no division leaves two halves that can be solved apart.

    Args:
        joint: The solved rig.
        limit: Difference over its sigma above which two cameras do not agree.
    """
    if len(joint.cameras) == 1:
        return None
    every_second, by_time = (_solved_apart(joint, rows) for rows in _divisions(joint))
    told = [halves for halves in (every_second, by_time) if halves]
    if not told:
        return None
    shifts = _distances_percent(*told[0])
    farthest = max(shifts, key=lambda pair: shifts[pair])
    movement = _movement(*by_time, limit) if by_time else None
    return SplitHalf(max(_gap(*halves) for halves in told), shifts[farthest], farthest, movement)


def _solved_apart(joint: JointResult, rows: Bools) -> tuple[Solution, Solution] | None:
    if not (solvable(joint, rows) and solvable(joint, ~rows)):
        return None
    options = SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01))
    first, second = (
        solve(joint.observations.subset(half), joint.solution.state, joint.freedom, options) for half in (rows, ~rows)
    )
    return first, second


def solvable(joint: JointResult, rows: Bools) -> bool:
    """Whether these rows still join every camera to the first, with :data:`MIN_BOARDS` boards or more in each."""
    obs, count = joint.observations, len(joint.cameras)
    boards_of = [set(obs.board_idx[rows & (obs.camera_idx == camera)].tolist()) for camera in range(count)]
    if min(len(boards) for boards in boards_of) < MIN_BOARDS:
        return False
    reached, frontier = {0}, [0]
    while frontier:
        near = frontier.pop()
        joined = {c for c in range(count) if c not in reached and boards_of[near] & boards_of[c]}
        reached |= joined
        frontier += joined
    return len(reached) == count


def _divisions(joint: JointResult) -> tuple[Bools, Bools]:
    """(N,) rows of one half: every second board of each set of cameras, and the earlier boards of each."""
    obs = joint.observations
    groups: dict[tuple[int, ...], list[int]] = {}
    for board in np.unique(obs.board_idx).tolist():
        seen_by = tuple(np.unique(obs.camera_idx[obs.board_idx == board]).tolist())
        groups.setdefault(seen_by, []).append(board)
    second: list[int] = []
    earlier: list[int] = []
    odd = 0  # of two groups with odd counts, the other half gets the odd board
    for boards in groups.values():
        second += boards[odd::2]
        earlier += [board for board in boards if 2 * board < boards[0] + boards[-1] + odd]
        odd ^= len(boards) % 2
    return np.isin(obs.board_idx, second), np.isin(obs.board_idx, earlier)


def _gap(first: Solution, second: Solution) -> float:
    count = len(first.state.cameras)
    wanted = [(camera, unknown) for camera in range(1, count) for unknown in range(POSE)]
    covariance = first.joint_covariance(wanted) + second.joint_covariance(wanted)
    gap = pose_gap(first.state.cam_from_rig[1:], second.state.cam_from_rig[1:])
    return _over_sigma(gap, covariance)


def _over_sigma(gap: Floats, covariance: Floats) -> float:
    return float(np.sqrt(max(float(gap @ np.linalg.pinv(covariance, hermitian=True) @ gap) / len(gap), 0.0)))


def pose_gap(first: Sequence[Pose], second: Sequence[Pose]) -> Floats:
    """(6n,) perturbations that take the second poses to the first."""
    rows = []
    for one, two in zip(first, second, strict=True):
        turn = Pose(one.rotation @ two.rotation.T, np.zeros(3)).rvec_rad
        rows.append(np.concatenate([turn, one.translation_m - two.translation_m]))
    return np.concatenate(rows)


def _pair_gap(first: Solution, second: Solution, one: int, two: int) -> float:
    """Difference of one camera's pose relative to another, over its own sigma."""
    gap = pose_gap([_relative(first, one, two)], [_relative(second, one, two)])
    return _over_sigma(gap, _relative_covariance(first, one, two) + _relative_covariance(second, one, two))


def _relative(solution: Solution, one: int, two: int) -> Pose:
    poses = solution.state.cam_from_rig
    return poses[two] @ poses[one].inverse()


def _relative_covariance(solution: Solution, one: int, two: int) -> Floats:
    """(6, 6) of ``two_from_one``.

    With ``R``, ``t`` that pose, ``t_1`` the first camera's and ``(w, v)`` perturbations of ``cam_from_rig``:
    ``w = w_2 - R w_1`` and ``v = v_2 - R v_1 + [R t_1]x w``.
    """
    R = _relative(solution, one, two).rotation
    turned = cross_matrix(R @ solution.state.cam_from_rig[one].translation_m)
    by_second = np.block([[np.eye(3), np.zeros((3, 3))], [turned, np.eye(3)]])
    by_first = -by_second @ np.block([[R, np.zeros((3, 3))], [np.zeros((3, 3)), R]])
    change = np.hstack([by_first, by_second])
    wanted = [(camera, unknown) for camera in (one, two) for unknown in range(POSE)]
    return np.asarray(change @ solution.joint_covariance(wanted) @ change.T)


def _distances_percent(first: Solution, second: Solution) -> dict[tuple[int, int], float]:
    """Difference of every distance between two cameras, in percent of it."""
    found = {}
    for pair in combinations(range(len(first.state.cameras)), 2):
        lengths = [float(np.linalg.norm(_relative(half, *pair).translation_m)) for half in (first, second)]
        found[pair] = 100 * abs(lengths[0] - lengths[1]) / max(float(np.mean(lengths)), 1e-12)
    return found


def _movement(first: Solution, second: Solution, limit: float) -> Movement | None:
    """The one camera whose pairs hold every disagreement, and how far it moved in the frame of the nearest other."""
    count = len(first.state.cameras)
    gaps = {pair: _pair_gap(first, second, *pair) for pair in combinations(range(count), 2)}
    worst = max(gaps.values())
    if count < 3 or worst <= limit:
        return None
    rest = {c: max(gap for pair, gap in gaps.items() if c not in pair) for c in range(count)}
    explains = [c for c in range(count) if rest[c] <= max(limit, worst / 4)]
    if len(explains) != 1:
        return None
    camera = explains[0]
    other = min(
        (c for c in range(count) if c != camera),
        key=lambda c: float(np.linalg.norm(_relative(first, c, camera).translation_m)),
    )
    poses = [_relative(half, other, camera) for half in (first, second)]
    gap = poses[0] @ poses[1].inverse()
    shift = poses[0].inverse().translation_m - poses[1].inverse().translation_m
    return Movement(camera, float(np.rad2deg(gap.angle_rad)), float(np.linalg.norm(shift)))
