"""The sidecar of a rig file: what the calibration rests on, so that a rig can be judged again years later.

Every detected corner with its residual, where each board stood, and pictures of the views that fit worst. A report is
drawn from the rig file and this file alone; the capture may be gone by then.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.errors import BrokenFileError
from rigcal.geometry import Bools, Floats, Ints, freeze

SUFFIX = ".residuals.npz"


@dataclass(frozen=True, slots=True)
class ViewPicture:
    """The part of one image that shows the board."""

    camera_idx: int
    """Index into :attr:`Evidence.camera_ids`."""
    frame_idx: int
    """Index into that camera's :attr:`Evidence.frames`."""
    box_px: tuple[int, int, int, int]
    """Left, top, width and height of the part in the camera's pixels; the JPEG may be smaller, never turned."""
    jpeg: bytes
    """As a JPEG file."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Corners of every camera after the joint solve: one row per detected corner.

    The fields with a default are empty in sidecars of rigcal before it wrote them.
    """

    camera_ids: tuple[str, ...]
    frames: tuple[tuple[str, ...], ...]
    """Per camera the names of its frames."""
    camera_idx: Ints
    """(N,) which camera."""
    frame_idx: Ints
    """(N,) which frame of that camera."""
    corner_ids: Ints
    """(N,) which corner of the board."""
    used: Bools
    """(N,) whether the joint solve used it."""
    pixels: Floats
    """(N, 2) where it was detected."""
    residuals_px: Floats
    """(N, 2) detected minus projected."""
    board_centres_m: Floats
    """(B, 3) centre of each board position in the rig frame."""
    board_idx: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(N,) which board position the corner's view was used for, a row of ``rig_from_board``; -1: not used."""
    rig_from_board: Floats = field(default_factory=lambda: np.zeros((0, 3, 4)))
    """(B, 3, 4) rotation and translation in metres, ``[R | t]``, of each board position."""
    pictures: tuple[ViewPicture, ...] = ()
    """Of the views that fit worst."""

    def __post_init__(self) -> None:
        count = len(self.camera_idx)
        freeze(self, np.int64, camera_idx=(count,), frame_idx=(count,), corner_ids=(count,))
        freeze(self, np.int64, board_idx=(count if len(self.board_idx) else 0,))
        freeze(self, np.bool_, used=(count,))
        freeze(self, np.float64, pixels=(count, 2), residuals_px=(count, 2), board_centres_m=(None, 3))
        freeze(self, np.float64, rig_from_board=(None, 3, 4))

    def rows_of(self, camera_idx: int, frame_idx: int) -> Ints:
        """Rows of one view's corners."""
        return np.flatnonzero((self.camera_idx == camera_idx) & (self.frame_idx == frame_idx))


def beside(rig_path: Path, suffix: str) -> Path:
    """The file that belongs to a rig file: ``hall.rig.json`` and ``.report.html`` give ``hall.report.html``."""
    return rig_path.with_name(rig_path.name.removesuffix(".json").removesuffix(".rig") + suffix)


def write_evidence(evidence: Evidence, path: Path) -> None:
    """Write the sidecar, to a temporary file that is then renamed."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as file:
        np.savez_compressed(
            file,
            camera_ids=np.array(evidence.camera_ids),
            frame_counts=np.array([len(names) for names in evidence.frames]),
            frames=np.array([name for names in evidence.frames for name in names]),
            camera_idx=evidence.camera_idx,
            frame_idx=evidence.frame_idx,
            corner_ids=evidence.corner_ids,
            used=evidence.used,
            pixels=evidence.pixels,
            residuals_px=evidence.residuals_px,
            board_centres_m=evidence.board_centres_m,
            board_idx=evidence.board_idx,
            rig_from_board=evidence.rig_from_board,
            **_picture_arrays(evidence.pictures),
        )
    part.replace(path)


def _picture_arrays(pictures: Sequence[ViewPicture]) -> dict[str, Any]:
    """The files one behind the other, since arrays of unequal length cannot be stored together."""
    return {
        "picture_views": np.array([(p.camera_idx, p.frame_idx) for p in pictures], dtype=np.int64).reshape(-1, 2),
        "picture_boxes_px": np.array([p.box_px for p in pictures], dtype=np.int64).reshape(-1, 4),
        "picture_sizes": np.array([len(p.jpeg) for p in pictures], dtype=np.int64),
        "picture_jpegs": np.frombuffer(b"".join(p.jpeg for p in pictures), dtype=np.uint8),
    }


def read_evidence(path: Path) -> Evidence | None:
    """The sidecar at ``path``; None where there is none.

    Raises:
        BrokenFileError: where the file is not such a sidecar.
    """
    if not path.exists():
        return None
    try:
        with np.load(path) as data:
            ends = np.cumsum(data["frame_counts"])
            names = data["frames"].tolist()
            return Evidence(
                tuple(data["camera_ids"].tolist()),
                tuple(tuple(names[end - n : end]) for n, end in zip(data["frame_counts"], ends, strict=True)),
                data["camera_idx"],
                data["frame_idx"],
                data["corner_ids"],
                data["used"],
                data["pixels"],
                data["residuals_px"],
                data["board_centres_m"],
                **_later_fields(data),
            )
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
        raise BrokenFileError(path, expected="residuals that rigcal calibrate wrote", got=str(error)) from error


def _later_fields(data: Mapping[str, Any]) -> dict[str, Any]:
    """What sidecars hold only since rigcal writes it."""
    if "picture_jpegs" not in data:
        return {}
    jpegs, ends = data["picture_jpegs"].tobytes(), np.cumsum(data["picture_sizes"]).tolist()
    return {
        "board_idx": data["board_idx"],
        "rig_from_board": data["rig_from_board"],
        "pictures": tuple(
            ViewPicture(camera, frame, (left, top, width, height), jpegs[end - size : end])
            for (camera, frame), (left, top, width, height), size, end in zip(
                data["picture_views"].tolist(),
                data["picture_boxes_px"].tolist(),
                data["picture_sizes"].tolist(),
                ends,
                strict=True,
            )
        ),
    }
