"""What the benchmark and a peer in its own environment hand each other: corners in a .npz, an answer in JSON.

Needs numpy only, since it is read by the python of every environment.
"""

import contextlib
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Corners:
    """Corners of one board as every camera saw them."""

    columns: int
    rows: int
    square_m: float
    size_wh: np.ndarray[Any, Any]
    """(C, 2) image sizes."""
    pixels: np.ndarray[Any, Any]
    """(C, F, columns * rows, 2), NaN in frames where a camera did not see the board."""

    def frames(self, camera: int) -> np.ndarray[Any, Any]:
        """Frames in which a camera saw the board."""
        return np.flatnonzero(np.isfinite(self.pixels[camera]).all(axis=(1, 2)))

    @property
    def points(self) -> np.ndarray[Any, Any]:
        """(K, 3) corners in the board, row by row."""
        grid = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2)
        return np.column_stack([grid, np.zeros(len(grid))]) * self.square_m


@dataclass(frozen=True)
class PeerAnswer:
    """Cameras in OpenCV's terms; the first need not be the frame."""

    matrices: Sequence[Any]
    distortions: Sequence[Any]
    rotations: Sequence[Any]
    """(C, 3, 3) of ``cam_from_rig``."""
    translations: Sequence[Any]


def write_corners(path: Path, corners: Corners) -> None:
    """For :func:`run_peer`."""
    board = np.array([corners.columns, corners.rows])
    np.savez(path, board=board, square_m=corners.square_m, size_wh=corners.size_wh, pixels=corners.pixels)


def run_peer(calibrate: Callable[[Corners], PeerAnswer]) -> None:
    """Main of a runner, ``python RUNNER IN.npz OUT.json``: what the peer prints goes to stderr, its time is taken."""
    source, target = map(Path, sys.argv[1:])
    loaded = np.load(source)
    columns, rows = loaded["board"].tolist()
    corners = Corners(columns, rows, float(loaded["square_m"]), loaded["size_wh"], loaded["pixels"])
    np.random.seed(0)  # noqa: NPY002 - peers draw from the global generator, and differ from run to run without
    wall, cpu = time.perf_counter(), time.process_time()
    with contextlib.redirect_stdout(sys.stderr):
        answer = calibrate(corners)
    target.write_text(
        json.dumps(
            {
                "wall_s": time.perf_counter() - wall,
                "cpu_s": time.process_time() - cpu,
                "matrices": [np.asarray(K).tolist() for K in answer.matrices],
                "distortions": [np.ravel(d).tolist() for d in answer.distortions],
                "rotations": [np.asarray(R).tolist() for R in answer.rotations],
                "translations_m": [np.ravel(t).tolist() for t in answer.translations],
            }
        )
    )
