"""Peers that cannot live beside rigcal: each in an environment of its own, called through files.

The environments are made on first use under ``.cache/bench-peers`` at the top of the repository.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from methods import MODEL, Answer
from peers.exchange import Corners, write_corners
from scoring import Estimate

from rigcal.board import Checkerboard
from rigcal.camera import Camera
from rigcal.detections import SiteDetections
from rigcal.geometry import Pose

REQUIREMENTS: Mapping[str, tuple[str, ...]] = {
    "aniposelib": ("aniposelib==0.8.0",),
    "multical": ("multical==0.4.0", "numpy<2"),
}
"""What pip installs for each peer."""

_HOME = Path(__file__).resolve().parents[2] / ".cache" / "bench-peers"
_INSTALL_LIMIT_S, _RUN_LIMIT_S = 900, 1800


class PeerUnavailableError(Exception):
    """A peer cannot be installed here; the message says why."""


class PeerFailedError(Exception):
    """A peer gave no answer; the message is the last line that it printed."""


def python_of(peer: str) -> Path:
    """The python of a peer's environment, which is made if need be.

    Raises:
        PeerUnavailableError: where pip cannot install it.
    """
    folder = _HOME / peer
    python, ready = folder / "bin" / "python", folder / "ready"
    if not ready.exists():
        install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *REQUIREMENTS[peer]]
        for command in ([sys.executable, "-m", "venv", "--clear", str(folder)], install):
            _run(command, _INSTALL_LIMIT_S, PeerUnavailableError)
        ready.touch()
    return python


def ask(peer: str, detections: SiteDetections) -> Answer:
    """Let a peer calibrate these detections of a checkerboard; its times leave its start and the files out.

    Raises:
        PeerUnavailableError: where pip cannot install it.
        PeerFailedError: where it ends with an error or does not end.
    """
    python = python_of(peer)
    runner = Path(__file__).parent / "peers" / f"run_{peer}.py"
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.json"
        write_corners(source, _corners(detections))
        _run([str(python), str(runner), str(source), str(target)], _RUN_LIMIT_S, PeerFailedError)
        found = json.loads(target.read_text())
    cameras = tuple(
        Camera.from_matrix(MODEL if len(d) <= 4 else "opencv5", camera.size_wh, K, d)
        for camera, K, d in zip(detections.cameras, found["matrices"], found["distortions"], strict=True)
    )
    poses = [Pose(np.array(R), np.array(t)) for R, t in zip(found["rotations"], found["translations_m"], strict=True)]
    estimate = Estimate(cameras, tuple(pose @ poses[0].inverse() for pose in poses))
    return Answer(estimate, {key: found[key] for key in ("wall_s", "cpu_s")})


def _corners(detections: SiteDetections) -> Corners:
    board = detections.board
    if not isinstance(board, Checkerboard):
        raise TypeError(f"peers are given checkerboards, not {board.kind}")
    frames = 1 + max(view.frame_idx for camera in detections.cameras for view in camera.views)
    pixels = np.full((len(detections.cameras), frames, len(board.corners_in_board), 2), np.nan)
    for c, camera in enumerate(detections.cameras):
        for view in camera.views:
            pixels[c, view.frame_idx, view.corner_ids] = view.corners_px
    sizes = np.array([camera.size_wh for camera in detections.cameras])
    return Corners(board.columns, board.rows, board.square_size_m, sizes, pixels)


def _run(command: list[str], limit_s: float, error: type[Exception]) -> None:
    try:
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=limit_s)
    except subprocess.CalledProcessError as failed:
        lines = (failed.stderr or failed.stdout).strip().splitlines()
        raise error(lines[-1] if lines else f"{command[0]} ended with {failed.returncode}") from failed
    except subprocess.TimeoutExpired as slow:
        raise error(f"did not end within {limit_s:.0f} s") from slow
