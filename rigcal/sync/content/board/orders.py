"""One numbering of a board's corners in all cameras, whatever end the finder began at.

Boards that look alike when turned are found in one of several orders. Within a camera, corners do not leap from one
frame to the next. Between cameras, epipolar errors of the right order are alike over the board, also where the clocks
are some tenths of a second apart, and those of a wrong order are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.board import Board
from rigcal.detect import FoundBoard
from rigcal.geometry import Floats, Ints
from rigcal.rig import RigCamera
from rigcal.sync.content.points.epipolar import fundamental, projection, sampson_px

_NEAR_S = 0.25
"""Frames further apart say nothing of each other's order."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraBoards:
    """The boards of one camera, in the frames that were looked at."""

    member: RigCamera
    t_s: Floats
    """(F,) stamps, ascending."""
    corners_px: Floats
    """(F, P, 2) pixels, NaN where not found."""

    @property
    def seen(self) -> Ints:
        """Frames with a board."""
        return np.flatnonzero(np.isfinite(self.corners_px).any(axis=(1, 2)))


def corner_rows(board: Board, found: Sequence[FoundBoard | None]) -> Floats:
    """(F, P, 2) pixels of the corners of each frame, NaN where not found."""
    rows = np.full((len(found), len(board.corners_in_board), 2), np.nan)
    for row, seen in zip(rows, found, strict=True):
        if seen is not None:
            row[seen.corner_ids] = seen.corners_px
    return rows


def middles(board: Board, corners_px: Floats) -> Floats:
    """(F, 1, 2) where the middle of the board is seen, by the homography of its corners: the same in every order."""
    plane = board.corners_in_board[:, :2]
    centred = (plane - plane.mean(axis=0)) / np.ptp(plane, axis=0).max()
    return np.stack([_middle(centred, row) for row in corners_px])[:, None] if len(corners_px) else corners_px[:, :1]


def _middle(plane: Floats, corners_px: Floats) -> Floats:
    """(2,) image of the plane's origin (direct linear transform); NaN for fewer than four corners."""
    known = np.isfinite(corners_px).all(axis=1)
    if known.sum() < 4:
        return np.full(2, np.nan)
    pixels, points = corners_px[known], np.c_[plane[known], np.ones(known.sum())]
    centre, zero = pixels.mean(axis=0), np.zeros((known.sum(), 3))
    size = np.ptp(pixels, axis=0).max()
    u, v = ((pixels - centre) / size).T
    rows = np.concatenate([np.c_[points, zero, -u[:, None] * points], np.c_[zero, points, -v[:, None] * points]])
    H = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    return np.asarray(centre + size * H[:2, 2] / H[2, 2])


def in_one_order(cameras: Sequence[CameraBoards], offset_s: Floats, orders: Sequence[Ints]) -> list[CameraBoards]:
    """The same boards with the corners numbered alike.

    Args:
        cameras: M cameras.
        offset_s: (M,) to add to their stamps, to a few tenths of a second.
        orders: From :func:`rigcal.order.corner_orders`.
    """
    result = list(cameras)
    if len(orders) == 1:
        return result
    settled: list[int] = []
    for camera in sorted(range(len(cameras)), key=lambda c: -len(cameras[c].seen)):
        anchors = [(result[a], offset_s[a] - offset_s[camera]) for a in settled]
        result[camera] = _settled(cameras[camera], anchors, orders)
        settled.append(camera)
    return result


def _settled(
    boards: CameraBoards, anchors: Sequence[tuple[CameraBoards, float]], orders: Sequence[Ints]
) -> CameraBoards:
    """One camera's boards, numbered as in cameras that are settled, else as in its frame before."""
    corners = boards.corners_px.copy()
    before: int | None = None
    lines = [fundamental(projection(boards.member), projection(anchor.member)) for anchor, _ in anchors]
    for frame in boards.seen.tolist():
        turned = np.stack([_turned(corners[frame], order) for order in orders])
        cost = np.zeros(len(orders))
        for (anchor, later_s), matrix in zip(anchors, lines, strict=True):
            cost += _unlikeness(boards.member, turned, anchor, boards.t_s[frame] - later_s, matrix)
        if not cost.any() and before is not None and boards.t_s[frame] - boards.t_s[before] < _NEAR_S:
            cost = np.nan_to_num(np.nanmean(np.abs(turned - corners[before]), axis=(1, 2)))
        corners[frame] = turned[int(np.argmin(cost))]
        before = frame
    return replace(boards, corners_px=corners)


def _turned(corners_px: Floats, order: Ints) -> Floats:
    turned = np.empty_like(corners_px)
    turned[order] = corners_px
    return turned


def _unlikeness(member: RigCamera, turned: Floats, anchor: CameraBoards, at_s: float, matrix: Floats) -> Floats:
    """(O,) how far epipolar errors scatter over the board in each order; zeros where the anchor saw none then."""
    seen = anchor.seen
    if not len(seen):
        return np.zeros(len(turned))
    nearest = seen[np.argmin(np.abs(anchor.t_s[seen] - at_s))]
    there = anchor.member.camera.undistorted_px(anchor.corners_px[nearest])
    error = sampson_px(member.camera.undistorted_px(turned), there, matrix)
    if abs(anchor.t_s[nearest] - at_s) > _NEAR_S or (np.isfinite(error).sum(axis=1) < 4).any():
        return np.zeros(len(turned))
    return np.asarray(np.nanmedian(np.abs(error - np.nanmedian(error, axis=1, keepdims=True)), axis=1))
