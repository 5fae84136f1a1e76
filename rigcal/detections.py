"""What was found of the board in the images of a capture: the input of every calibration stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rigcal.board import Board
from rigcal.geometry import Floats, Ints, freeze


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that was done to one frame's board, to be told to the user."""

    frame: str
    """Name of the frame: an image's stem, or a video's frame number with six digits."""
    action: str
    """``dropped``, ``unflipped`` or ``downweighted``."""
    reason: str
    """Why, with figures."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """The board as one camera saw it in one frame."""

    frame_idx: int
    """Index of the frame within its camera's frames."""
    corner_ids: Ints
    """(n,) indices into ``board.corners_in_board``, ascending."""
    corners_px: Floats
    """(n, 2) pixels, distorted, origin at the centre of the top-left pixel."""
    blur_px: float = 0.0
    """Sigma of the board's edges in pixels; 0: not measured."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, corner_ids=(None,))
        freeze(self, np.float64, corners_px=(len(self.corner_ids), 2))


@dataclass(frozen=True, slots=True)
class BoardDetections:
    """Every board view of one camera."""

    camera_id: str
    size_wh: tuple[int, int]
    """Image width and height in pixels."""
    frames: tuple[str, ...]
    """Name of every frame that was looked at."""
    views: tuple[BoardView, ...]
    """Frames in which the board was found, by ``frame_idx``, each at most once."""
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Instants:
    """Which frames of different cameras belong to one instant."""

    rule: str
    """How they were found: ``timestamps.csv``, ``file times``, ``frame numbers`` or ``none``."""
    frame_idx: Ints
    """(I, C) index of each camera's frame at each instant, -1 where it has none; cameras in capture order."""
    t_s: Floats
    """(I,) time of each instant in seconds where the rule knows times, else the frame number."""
    offset_s: Floats
    """(I, C) time of each camera's frame minus ``t_s`` in seconds; zero where it has no frame or the rule no times."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, frame_idx=(None, None))
        count = len(self.frame_idx)
        freeze(self, np.float64, t_s=(count,), offset_s=self.frame_idx.shape)

    @property
    def spread_s(self) -> Floats:
        """(I,) greatest time difference within each instant in seconds; zeros where the rule knows no times."""
        seen = self.frame_idx >= 0
        latest = np.where(seen, self.offset_s, -np.inf).max(axis=1, initial=-np.inf)
        earliest = np.where(seen, self.offset_s, np.inf).min(axis=1, initial=np.inf)
        return np.asarray(np.maximum(latest - earliest, 0.0))


@dataclass(frozen=True, slots=True)
class SiteDetections:
    """Every board view of every camera of a capture, and which belong together."""

    board: Board
    cameras: tuple[BoardDetections, ...]
    """In rig order; the first is the reference."""
    instants: Instants
    digest: str = field(default="")
    """SHA-256 over the contents of the images and videos, hexadecimal."""

    @property
    def camera_ids(self) -> tuple[str, ...]:
        """Identifiers in rig order."""
        return tuple(camera.camera_id for camera in self.cameras)


def join_findings(*groups: Sequence[Finding]) -> tuple[Finding, ...]:
    """All findings, by frame."""
    return tuple(sorted((f for group in groups for f in group), key=lambda f: (f.frame, f.action)))
