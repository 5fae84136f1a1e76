"""The sidecar of a rig file: every detected corner with its residual, so that a rig can be judged again years later."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigcal.errors import BrokenFileError
from rigcal.geometry import Bools, Floats, Ints, freeze

SUFFIX = ".residuals.npz"


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Corners of every camera after the joint solve: one row per detected corner."""

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

    def __post_init__(self) -> None:
        count = len(self.camera_idx)
        freeze(self, np.int64, camera_idx=(count,), frame_idx=(count,), corner_ids=(count,))
        freeze(self, np.bool_, used=(count,))
        freeze(self, np.float64, pixels=(count, 2), residuals_px=(count, 2), board_centres_m=(None, 3))


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
        )
    part.replace(path)


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
            )
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
        raise BrokenFileError(path, expected="residuals that rigcal calibrate wrote", got=str(error)) from error
