"""From which distances and at which tilts a camera saw the board: histograms beside the range that is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.board import Board
from rigcal.evidence import Evidence
from rigcal.geometry import Floats
from rigcal.report.numbers import round_up, significant
from rigcal.rigdocument import CameraEntry

WIDTH, HEIGHT = 300.0, 96.0
"""Of the part of a figure that the bars fill, in its units."""
WANTED_TILT_DEG = (20.0, 45.0)
"""Tilts that tell the focal length from the distance, and at which corners are still found to a fraction of a pixel;
the gates' advice asks for the same."""
TILT_STEP_DEG = 5.0
NEAR_SHARE = 0.25
"""Share of the image that the board fills, seen frontally, at the near end of the wanted distances; the gates' advice
asks for the same."""
FAR_OVER_NEAR = 2.0
"""The far end over the near end: half as large in the image."""
DISTANCE_BARS = 12
"""Bars of the distances, at the most."""
LABELS = 6
"""Labels along an axis, at the most."""


@dataclass(frozen=True, slots=True)
class Bar:
    """Views within one step."""

    x: float
    width: float
    height: float
    count: int


@dataclass(frozen=True, slots=True)
class Histogram:
    """A histogram, ready to be drawn."""

    title: str
    unit: str
    bars: tuple[Bar, ...]
    labels: tuple[tuple[float, str], ...]
    """Place and text along the axis."""
    wanted: tuple[float, float]
    """Places of the wanted range; both at an end of the axis where it lies beyond."""
    wanted_text: str
    within: int
    """Views within the wanted range."""
    views: int


def histograms_of(camera: CameraEntry, board: Board | None, evidence: Evidence) -> tuple[Histogram, ...]:
    """Tilts and distances of one camera's used views; none where the evidence holds no board positions."""
    mine = (evidence.camera_idx == evidence.camera_ids.index(camera.id)) & evidence.used
    if board is None or not len(evidence.board_idx) or not mine.any():
        return ()
    positions = np.unique(evidence.board_idx[mine])
    rig_from_board = evidence.rig_from_board[positions[positions >= 0]]
    cam_from_rig = camera.cam_from_rig.pose
    normals_in_cam = rig_from_board[:, :, 2] @ cam_from_rig.rotation.T
    tilts_deg = np.rad2deg(np.arccos(np.clip(np.abs(normals_in_cam[:, 2]), 0, 1)))
    middle = np.append(board.corners_in_board.mean(axis=0), 1.0)
    distances_m = np.linalg.norm(cam_from_rig.apply(rig_from_board @ middle), axis=1)
    return (
        _histogram("tilt", "°", tilts_deg, TILT_STEP_DEG, 90.0, WANTED_TILT_DEG),
        _distances(distances_m, near_m(camera, board)),
    )


def near_m(camera: CameraEntry, board: Board) -> float:
    """Distance at which the board, seen frontally in the middle, fills :data:`NEAR_SHARE` of the image."""
    width_m, height_m = np.ptp(board.corners_in_board[:, :2], axis=0) + board.square_size_m
    focal_px2 = camera.coefficients["fx"] * camera.coefficients["fy"]
    return float(np.sqrt(focal_px2 * width_m * height_m / (NEAR_SHARE * camera.size_wh[0] * camera.size_wh[1])))


def _distances(distances_m: Floats, near: float) -> Histogram:
    wanted = (near, near * FAR_OVER_NEAR)
    greatest_m = max(float(distances_m.max()), wanted[1]) * 1.02
    step_m = round_up(greatest_m / DISTANCE_BARS)
    return _histogram("distance", " m", distances_m, step_m, np.ceil(greatest_m / step_m) * step_m, wanted)


def _histogram(
    title: str, unit: str, values: Floats, step: float, end: float, wanted: tuple[float, float]
) -> Histogram:
    edges = np.linspace(0, end, round(end / step) + 1)
    counts, _ = np.histogram(values, edges)
    scale, tallest = WIDTH / edges[-1], max(int(counts.max()), 1)
    return Histogram(
        title,
        unit,
        tuple(
            Bar(float(low * scale), float(step * scale), HEIGHT * count / tallest, count)
            for low, count in zip(edges, counts.tolist(), strict=False)
            if count
        ),
        tuple((float(edge * scale), f"{edge:g}") for edge in _labelled(edges)),
        (wanted[0] * scale, wanted[1] * scale),
        f"{significant(wanted[0], 2)} to {significant(wanted[1], 2)}{unit}",
        int(((values >= wanted[0]) & (values <= wanted[1])).sum()),
        len(values),
    )


def _labelled(edges: Floats) -> Sequence[float]:
    every = next(n for n in (1, 2, 3, 4, 5, 6, 10) if len(edges) / n <= LABELS + 1)
    return [float(f"{edge:.6g}") for edge in edges[::every]]
