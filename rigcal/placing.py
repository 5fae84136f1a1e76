"""Which views belong to one board position, and where each board is at the start of the joint solve.

An instant's board starts at whichever single-camera pose all its cameras together agree with best (both planar
solutions of each are tried), which settles the planar ambiguity and is not led astray by one bad view. The same
comparison says whose corners are numbered from another end of the board: the fewer against the more, and where there
are as many, the view that contradicts its own neighbours in time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.agreement import Names
from rigcal.board import Board
from rigcal.boardpose import board_poses
from rigcal.camera import Camera
from rigcal.detections import BoardView, Finding, Instants
from rigcal.geometry import Floats, Ints, Pose
from rigcal.intrinsics import IntrinsicsResult
from rigcal.motion import MOST_MOTION_PX, corner_speeds_px_s
from rigcal.order import corner_orders, quarter_turns, reordered, turned_finding


@dataclass(frozen=True, slots=True)
class Groups:
    """Views that show one board position each."""

    views: tuple[Mapping[int, BoardView], ...]
    """Per group the view of each camera that has one, in order of time."""
    moved_px: tuple[Mapping[int, float], ...]
    """Per group, for cameras where it is known: how far the board moved between their exposure and the group's mean."""
    findings: tuple[tuple[int, Finding], ...]
    """(camera index, views that moved too far to belong to their instant)."""


def groups_of_views(lenses: Sequence[IntrinsicsResult], instants: Instants, names: Names) -> Groups:
    """Views by instant; a view whose board moved too far between the exposures is a group of its own."""
    by_frame = [{view.frame_idx: view for view in lens.views} for lens in lenses]
    moved = _moved_px(lenses, instants)
    groups: list[dict[int, BoardView]] = []
    moved_px: list[dict[int, float]] = []
    findings = []
    for row in instants.frame_idx:
        group = {c: by_frame[c][int(f)] for c, f in enumerate(row) if int(f) in by_frame[c]}
        off = {c: moved[c, view.frame_idx] for c, view in group.items() if (c, view.frame_idx) in moved}
        alone = [c for c in group if len(group) > 1 and off.get(c, 0.0) > MOST_MOTION_PX]
        for c in alone:
            reason = f"the board moved {off[c]:.1f} px between the exposures of the instant: used for its own lens only"
            findings.append((c, Finding(names.frames[c][group[c].frame_idx], "dropped", reason)))
        together = {c: view for c, view in group.items() if c not in alone}
        for part in (together, *({c: group[c]} for c in alone)):
            if part:
                groups.append(part)
                moved_px.append({c: off[c] for c in part if c in off and len(part) > 1})
    return Groups(tuple(groups), tuple(moved_px), tuple(findings))


def _moved_px(lenses: Sequence[IntrinsicsResult], instants: Instants) -> dict[tuple[int, int], float]:
    """By (camera, frame): the motion of the board between the camera's exposure and the mean of those that saw it."""
    if not instants.offset_s.any():
        return {}
    seen = np.zeros(instants.frame_idx.shape, dtype=bool)
    speed_px_s = np.zeros(instants.frame_idx.shape)
    for c, lens in enumerate(lenses):
        row_of = {int(f): i for i, f in enumerate(instants.frame_idx[:, c]) if f >= 0}
        rows = np.array([row_of[view.frame_idx] for view in lens.views], dtype=np.int64)
        t_s = instants.t_s[rows] + instants.offset_s[rows, c]
        order = np.argsort(t_s, kind="stable")
        seen[rows, c] = True
        speed_px_s[rows[order], c] = corner_speeds_px_s([lens.views[i] for i in order], t_s[order])
    mean_s = (instants.offset_s * seen).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    moved = speed_px_s * np.abs(instants.offset_s - mean_s[:, None])
    return {(int(c), int(instants.frame_idx[i, c])): float(moved[i, c]) for i, c in np.argwhere(seen)}


@dataclass(frozen=True, slots=True)
class PlacedBoards:
    """Boards where the views of each group agree best."""

    entries: tuple[tuple[int, int, BoardView], ...]
    """(camera, board, view), corners numbered alike."""
    rig_from_board: tuple[Pose, ...]
    """Per board where it starts."""
    group_of: tuple[int, ...]
    """Per board the group that it is of; groups without a usable view have none."""
    order_of: Mapping[tuple[int, int], int]
    """Corner order of each (camera, frame) that was numbered anew."""
    findings: tuple[tuple[int, Finding], ...]
    """(camera index, views whose corners were numbered anew)."""


def place_boards(
    board: Board,
    cameras: Sequence[Camera],
    cam_from_rig: Sequence[Pose],
    groups: Sequence[Mapping[int, BoardView]],
    names: Names,
    clip_px: float,
) -> PlacedBoards:
    """Place each group's board; ``clip_px`` is the error at which a view no longer counts."""
    corners, orders = board.corners_in_board, corner_orders(board)
    neighbours = _Neighbours(groups)
    entries: list[tuple[int, int, BoardView]] = []
    boards: list[Pose] = []
    group_of: list[int] = []
    order_of: dict[tuple[int, int], int] = {}
    findings = []
    for index, group in enumerate(groups):
        start = _starting_pose(corners, cameras, cam_from_rig, group, orders, clip_px)
        if start is None:
            continue
        pose, relative = start
        believed = _believed_orders(group, relative, orders, neighbours, index)
        if believed != relative:
            group_in_order = {c: reordered(view, orders[believed[c]]) for c, view in group.items()}
            again = _starting_pose(corners, cameras, cam_from_rig, group_in_order, orders[:1], clip_px)
            pose = again[0] if again else pose
        for camera, view in group.items():
            if believed[camera]:
                order_of[camera, view.frame_idx] = believed[camera]
                partners = [names.camera_ids[c] for c in group if not believed[c]]
                frame = names.frames[camera][view.frame_idx]
                findings.append((camera, turned_finding(frame, believed[camera], partners)))
            entries.append((camera, len(boards), reordered(view, orders[believed[camera]])))
        boards.append(pose)
        group_of.append(index)
    return PlacedBoards(tuple(entries), tuple(boards), tuple(group_of), order_of, tuple(findings))


def _starting_pose(
    corners: Floats,
    cameras: Sequence[Camera],
    cam_from_rig: Sequence[Pose],
    group: Mapping[int, BoardView],
    orders: Sequence[Ints],
    clip_px: float,
) -> tuple[Pose, dict[int, int]] | None:
    """``rig_from_board`` that the group's views agree with best, and the order of each relative to the proposer's."""
    best: tuple[float, Pose, dict[int, int]] | None = None
    for proposer, view in group.items():
        rig_from_cam = cam_from_rig[proposer].inverse()
        for candidate in board_poses(cameras[proposer], corners, view):
            rig_from_board = rig_from_cam @ candidate.cam_from_board
            total, order_of = 0.0, {}
            for camera, seen in group.items():
                pixels = cameras[camera].project((cam_from_rig[camera] @ rig_from_board).apply(corners))
                errors = [_gap_px(pixels, order[seen.corner_ids], seen) for order in orders]
                nearest = int(np.argmin(errors))
                order_of[camera] = nearest if errors[nearest] < clip_px else 0
                total += min(*errors, clip_px)
            if best is None or total < best[0]:
                best = (total, rig_from_board, order_of)
    return best[1:] if best else None


def _gap_px(pixels: Floats, ids: Ints, view: BoardView) -> float:
    gap = pixels[ids] - view.corners_px
    return float(np.sqrt((gap**2).sum(axis=1).mean())) if np.isfinite(gap).all() else float("inf")


def _believed_orders(
    group: Mapping[int, BoardView],
    relative: Mapping[int, int],
    orders: Sequence[Ints],
    neighbours: _Neighbours,
    index: int,
) -> dict[int, int]:
    """Orders counted from the one that most views share; of as many, from one that its neighbours in time confirm."""
    if not any(relative.values()):
        return dict(relative)
    counts = Counter(relative.values())
    most = max(counts.values())
    candidates = [order for order in sorted(counts) if counts[order] == most]
    if len(candidates) > 1:
        support = {
            order: sum(neighbours.confirm(c, index, orders) for c in group if relative[c] == order)
            for order in candidates
        }
        candidates.sort(key=lambda order: -support[order])
    base = candidates[0]
    return {camera: quarter_turns(order, minus=base) for camera, order in relative.items()}


class _Neighbours:
    """Views of one camera one group earlier or later."""

    def __init__(self, groups: Sequence[Mapping[int, BoardView]]) -> None:
        self.groups = groups

    def confirm(self, camera: int, index: int, orders: Sequence[Ints]) -> int:
        """+1: a neighbour's corners lie as this view's do; -1: as this view's in another order do; 0: neither."""
        view = self.groups[index][camera]
        votes = 0
        for at in (index - 1, index + 1):
            if not 0 <= at < len(self.groups) or camera not in self.groups[at]:
                continue
            other = self.groups[at][camera]
            gaps = []
            for order in orders:
                turned = reordered(view, order)
                common, one, two = np.intersect1d(turned.corner_ids, other.corner_ids, return_indices=True)
                moved = turned.corners_px[one] - other.corners_px[two]
                gaps.append(float(np.sqrt((moved**2).sum(axis=1).mean())) if len(common) else np.inf)
            if min(gaps) < 0.5 * max(gaps):
                votes += 1 if int(np.argmin(gaps)) == 0 else -1
        return int(np.sign(votes))
