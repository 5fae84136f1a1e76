"""A board that is carried before a rig whose clocks are known: exact tracks, and noise as a second function.

Motion is smooth and never repeats: a sum of sines of frequencies that have no common period, as a hand has them
(0.1 to 2 Hz). A frame stamped ``t`` by its camera was exposed at rig time ``t + offset + drift (t - at)``; a row above
or below the middle, earlier or later by its share of the readout.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from scipy.interpolate import KroghInterpolator
from scipy.spatial.transform import Rotation

from rigcal.board import Board
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig, RigCamera
from rigcal.sync.content.tracks import PointTracks

Motion: TypeAlias = Callable[[float], Pose]
"""``rig_from_board`` at a rig time in seconds."""
_KNOTS = np.linspace(-0.6, 0.6, 6)  # shares of a readout between which a corner's path is a polynomial
_ROUNDS = 4  # of the time at which a moving point meets the readout; each gains two digits and more
_FREQUENCIES_HZ = (0.13, 0.31, 0.53, 0.87, 1.31)


@dataclass(frozen=True, slots=True)
class CameraClock:
    """The truth about one camera's clock and shutter."""

    offset_s: float = 0.0
    """What to add to the camera's stamps."""
    drift_ppm: float = 0.0
    """How the offset grows with the camera's time after 0."""
    readout_s: float = 0.0
    """From the first row's exposure to the last one's."""
    phase_s: float = 0.0
    """Rig time of the first frame after the recording's start."""

    def rig_s(self, stamp_s: Floats) -> Floats:
        """Rig time of the middle row's exposure."""
        return np.asarray(stamp_s + self.offset_s + self.drift_ppm * 1e-6 * stamp_s)

    def stamp_s(self, rig_s: Floats) -> Floats:
        """The camera's time of a rig time."""
        return np.asarray((rig_s - self.offset_s) / (1 + self.drift_ppm * 1e-6))


def carried_board(rig: Rig, board: Board, *, seed: int, speed: float = 1.0) -> Motion:
    """A board carried about the middle of what the cameras see: up to 0.6 m to all sides, tilted by 30 degrees.

    Args:
        rig: Cameras that look at a common volume.
        board: The board.
        seed: Of the motion.
        speed: 1 is 1 m/s root-mean-square; 0 stands still.
    """
    rng = np.random.default_rng(seed)
    frequencies = np.array(_FREQUENCIES_HZ) * rng.uniform(0.9, 1.1, (6, len(_FREQUENCIES_HZ)))
    phases = rng.uniform(0, 2 * np.pi, frequencies.shape)
    reach = np.array([0.25, 0.25, 0.2, 0.2, 0.2, 0.2])[:, None] / np.sqrt(len(_FREQUENCIES_HZ) * frequencies / 0.5)
    rest = _facing_cameras(rig)
    middle = board.corners_in_board.mean(axis=0)

    def pose(t_s: float) -> Pose:
        moved = (reach * np.sin(2 * np.pi * frequencies * speed * t_s + phases)).sum(axis=1)
        tilted = rest.rotation @ Rotation.from_rotvec(moved[3:]).as_matrix()
        return Pose(tilted, rest.translation_m + rest.rotation @ moved[:3] - tilted @ middle)

    return pose


def _facing_cameras(rig: Rig) -> Pose:
    """A board in the middle of the cameras' views, its front to them."""
    out = [c.cam_from_rig.inverse() for c in rig.cameras]
    origins, axes = np.array([p.translation_m for p in out]), np.array([p.rotation[:, 2] for p in out])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centre = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, origins))
    z = -(origins.mean(axis=0) - centre)
    z /= np.linalg.norm(z)
    x = out[0].rotation[:, 0] - (out[0].rotation[:, 0] @ z) * z
    x /= np.linalg.norm(x)
    return Pose(np.stack([x, np.cross(z, x), z], axis=1), centre)


def stamps_of(clock: CameraClock, *, seconds: float, fps: float) -> Floats:
    """(F,) a camera's stamps of a recording from rig time 0 on."""
    return clock.stamp_s(np.arange(clock.phase_s, seconds, 1 / fps))


def exact_tracks(
    rig: Rig, board: Board, motion: Motion, clocks: Mapping[str, CameraClock], *, seconds: float, fps: float = 30.0
) -> tuple[PointTracks, ...]:
    """What perfect detectors follow of the board's corners, in the cameras that ``clocks`` names; NaN out of view."""
    return tuple(
        _tracks(rig.camera(camera_id), board, motion, clock, stamps_of(clock, seconds=seconds, fps=fps))
        for camera_id, clock in clocks.items()
    )


def _tracks(member: RigCamera, board: Board, motion: Motion, clock: CameraClock, stamps_s: Floats) -> PointTracks:
    rows = np.stack([_corners(member, board, motion, clock, float(t)) for t in clock.rig_s(stamps_s)])
    return PointTracks(member.id, stamps_s, rows)


def _corners(member: RigCamera, board: Board, motion: Motion, clock: CameraClock, middle_s: float) -> Floats:
    """(P, 2) pixels of the corners, each at the time at which its row is read."""
    width, height = member.camera.size_wh
    pixels = _projected(member, board, motion, middle_s)
    if clock.readout_s:
        knots = np.stack([_projected(member, board, motion, middle_s + share * clock.readout_s) for share in _KNOTS])
        path, each = KroghInterpolator(_KNOTS, knots), np.arange(len(pixels))
        for _ in range(_ROUNDS):
            share = np.nan_to_num(pixels[:, 1] / (height - 1) - 0.5)
            pixels = path(np.clip(share, _KNOTS[0], _KNOTS[-1]))[each, each]
    inside = ((pixels >= 0) & (pixels <= np.array([width - 1, height - 1]))).all(axis=1, keepdims=True)
    return np.where(inside, pixels, np.nan)


def _projected(member: RigCamera, board: Board, motion: Motion, at_s: float) -> Floats:
    return member.camera.project((member.cam_from_rig @ motion(at_s)).apply(board.corners_in_board))


def with_noise(tracks: Sequence[PointTracks], sigma_px: float, *, seed: int) -> tuple[PointTracks, ...]:
    """The same tracks with independent Gaussian noise of ``sigma_px`` per axis on every point."""
    rng = np.random.default_rng(seed)
    return tuple(replace(t, points_px=t.points_px + rng.normal(0, sigma_px, t.points_px.shape)) for t in tracks)
