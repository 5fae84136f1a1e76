"""A board painted into a camera's picture of the room, before the sensor sees it: light in, light out.

Each pixel's ray meets the board's plane; what is printed there is averaged over the pixel. The board reflects the lamps
as a matt surface does, without shadows.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from rigcal.board import Checkerboard
from rigcal.geometry import Floats, Pose
from tools.sicsg.rendering.lens import camera_of
from tools.sicsg.scene import Light, SceneCamera

PAPER, INK, PLATE = 0.78, 0.05, 0.45
"""Albedo of the printed side and of the back."""
_SAMPLES = {True: 4, False: 2}
"""Rays along each axis of a pixel, where the board is still and where it is smeared anyway."""
_BLUR_PX = 0.7
"""Sigma of the lens's own blur."""
_GRID_PX = 16
"""Rays are found on a grid of this pitch and a spline is laid through it."""


def extent_m(board: Checkerboard) -> tuple[Floats, Floats]:
    """Least and greatest x and y of the plate: the pattern with a margin of one square, in the board's frame."""
    step = board.square_size_m
    return np.full(2, -2 * step), np.array([board.columns + 1, board.rows + 1]) * step


def outline_m(board: Checkerboard) -> Floats:
    """(4, 3) the plate's corners in the board's frame."""
    (left, top), (right, bottom) = extent_m(board)
    return np.array([[left, top, 0.0], [right, top, 0.0], [right, bottom, 0.0], [left, bottom, 0.0]])


class BoardPainter:
    """Paints one board for one camera.

    Args:
        camera: the camera.
        board: the board.
        light: the light that falls on it.
    """

    def __init__(self, camera: SceneCamera, board: Checkerboard, light: Light) -> None:
        self._lens, self._board, self._light = camera_of(camera), board, light
        self._cam_from_world = Pose.from_quat_wxyz(camera.quat_wxyz, camera.translation_m)
        width, height = camera.size_wh
        columns = np.arange(-_GRID_PX, width + 2.0 * _GRID_PX, _GRID_PX)
        rows = np.arange(-_GRID_PX, height + 2.0 * _GRID_PX, _GRID_PX)
        rays = self._lens.undistort(np.stack(np.meshgrid(columns, rows), axis=-1))
        dense = [RectBivariateSpline(rows, columns, rays[..., k])(np.arange(height), np.arange(width)) for k in (0, 1)]
        self._rays = np.stack(dense).astype(np.float32)
        """(2, H, W) x/z and y/z of every pixel."""

    def paint(self, radiance: NDArray[np.float32], world_from_board: list[Pose]) -> NDArray[np.float32]:
        """The picture (H, W, 3) with the board before it.

        Args:
            radiance: what the camera sees without the board, distorted as the camera sees it.
            world_from_board: where the board is in equal parts of the exposure; one pose where it is still.
        """
        boxes = [box for pose in world_from_board if (box := self._box(pose)) is not None]
        if not boxes:
            return radiance
        (left, top), (right, bottom) = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
        samples = _SAMPLES[len(world_from_board) == 1]
        parts = [self._patch(pose, (left, top, right, bottom), samples) for pose in world_from_board]
        light, covered = (
            cv2.GaussianBlur(np.mean(part, axis=0), (0, 0), _BLUR_PX) for part in zip(*parts, strict=True)
        )
        picture = radiance.copy()
        picture[top:bottom, left:right] *= 1 - covered[..., None]
        picture[top:bottom, left:right] += light
        return picture

    def _box(self, world_from_board: Pose) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
        """Left and top, right and bottom of the pixels that the board may cover; None: it is out of the picture."""
        low, high = extent_m(self._board)
        edge = np.linspace(0, 1, 9)
        around = np.array([(a, b) for a in edge for b in edge if a in (0, 1) or b in (0, 1)])
        points = np.c_[low + around * (high - low), np.zeros(len(around))]
        pixels = self._lens.project((self._cam_from_world @ world_from_board).apply(points))
        if np.isnan(pixels).any():
            return None
        corner = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 3, 0)
        end = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 4, self._lens.size_wh)
        return (corner, end) if (corner < end).all() else None

    def _patch(
        self, world_from_board: Pose, box: tuple[int, int, int, int], samples: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The board's light (h, w, 3), and the share of each pixel that it covers (h, w)."""
        left, top, right, bottom = box
        rays = self._rays[:, top:bottom, left:right]
        cam_from_board = self._cam_from_world @ world_from_board
        plane = np.column_stack([cam_from_board.rotation[:, :2], cam_from_board.translation_m])
        a, b, w = (row[0] * rays[0] + row[1] * rays[1] + row[2] for row in np.linalg.inv(plane).astype(np.float32))
        middle = np.stack([a / w, b / w])
        down, across = np.gradient(middle, axis=(1, 2))
        low, high = (edge[:, None, None] for edge in extent_m(self._board))
        front = cam_from_board.rotation[:, 2] @ cam_from_board.translation_m > 0
        albedo, covered = np.zeros(middle.shape[1:], np.float32), np.zeros(middle.shape[1:], np.float32)
        within = (np.arange(samples, dtype=np.float32) + 0.5) / samples - 0.5
        for v, u in np.ndindex(samples, samples):
            at = middle + within[v] * down + within[u] * across
            inside = ((at >= low) & (at <= high)).all(axis=0)
            covered += inside
            albedo += inside * (self._printed(*at) if front else np.float32(PLATE))
        lit = self._lit(world_from_board, front)
        return albedo[..., None] * lit / samples**2, covered / samples**2

    def _printed(self, x_m: NDArray[np.float32], y_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """The albedo of the printed side; the cell beyond the first corner is ink, as ``rigcal target`` prints it."""
        board = self._board
        column = np.floor(x_m / board.square_size_m).astype(int) + 1
        row = np.floor(y_m / board.square_size_m).astype(int) + 1
        inside = (column >= 0) & (column <= board.columns) & (row >= 0) & (row <= board.rows)
        return np.where(inside & ((column + row) % 2 == 0), np.float32(INK), np.float32(PAPER))

    def _lit(self, world_from_board: Pose, front: bool) -> NDArray[np.float32]:
        """(3,) radiance of a white board there."""
        normal = world_from_board.rotation[:, 2] * (-1.0 if front else 1.0)
        middle = world_from_board.apply(self._board.corners_in_board.mean(axis=0))
        total = np.array(self._light.ambient)
        for lamp in self._light.lamps:
            way = np.array(lamp.position_m) - middle
            distance = float(np.linalg.norm(way))
            facing = max(float(normal @ way) / distance, 0.0)
            strength = lamp.power * (2.0 / distance) ** 2 * facing * max(float(way[2]) / distance, 0.0)
            total = total + strength * np.array(lamp.colour)
        return total.astype(np.float32)
