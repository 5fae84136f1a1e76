"""Tracks made ready for comparison: undistorted pixels, rows, and where the camera stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Bools, Floats
from rigcal.rig import RigCamera
from rigcal.sync.content.points.epipolar import projection
from rigcal.sync.content.tracks import PointTracks

_WIDEST = 4.0  # tangent of the angle from the axis beyond which an undistorted pixel says nothing (76 degrees)
_SHORTEST, _LONGEST = 0.3, 1.7  # of the usual spacing: between them, frames follow one another without a gap

_THIRD_DIFFERENCE = 20.0  # variance of x0 - 3 x1 + 3 x2 - x3 over that of each x


@dataclass(frozen=True, slots=True, eq=False)
class SeenPoints:
    """One camera's tracks as the solver wants them."""

    camera_id: str
    t_s: Floats
    """(F,) stamps in seconds after the comparison's own epoch, so that no digits are lost."""
    px: Floats
    """(F, P, 2) pixels that a lens without distortion would give; NaN where not seen."""
    row: Floats
    """(F, P) where in the frame's readout the point was read: -1/2 in the first row, 1/2 in the last."""
    px_from_rig: Floats
    """(3, 4) projection from metres in the rig frame to undistorted pixels."""
    spacing_s: float
    """The usual time from one frame to the next."""
    follows: Bools
    """(F,) whether frames i - 1 to i + 2 are there and without gaps: what a cubic between i and i + 1 needs."""
    size_px: float
    """Half the image's width: the scale of positions in the image."""


def prepare(member: RigCamera, tracks: PointTracks, epoch_s: float) -> SeenPoints:
    """A camera's tracks with its lens undone."""
    camera = member.camera
    tangent = camera.undistort(tracks.points_px)
    tangent[np.hypot(tangent[..., 0], tangent[..., 1]) > _WIDEST] = np.nan
    t_s = tracks.t_s - epoch_s
    spacing_s, follows = _spacing(t_s)
    return SeenPoints(
        member.id,
        t_s,
        tangent * camera.params[:2] + camera.params[2:4],
        tracks.points_px[..., 1] / (camera.size_wh[1] - 1) - 0.5,
        projection(member),
        spacing_s,
        follows,
        camera.size_wh[0] / 2,
    )


def noise_px(seen: SeenPoints) -> float:
    """Random noise of a camera's points per axis, from what a smooth motion cannot be: third differences."""
    first = np.flatnonzero(seen.follows) - 1
    if not len(first):
        return 0.0
    third = seen.px[first] - 3 * seen.px[first + 1] + 3 * seen.px[first + 2] - seen.px[first + 3]
    known = third[np.isfinite(third)]
    return float(np.median(np.abs(known)) / 0.6745 / np.sqrt(_THIRD_DIFFERENCE)) if len(known) else 0.0


def _spacing(t_s: Floats) -> tuple[float, Bools]:
    """The usual spacing of frames, and which frames have a neighbour before and two after without a gap."""
    follows = np.zeros(len(t_s), dtype=bool)
    if len(t_s) < 4:
        return 1.0, follows
    steps = np.diff(t_s)
    spacing_s = float(np.median(steps))
    whole = (steps > _SHORTEST * spacing_s) & (steps < _LONGEST * spacing_s)
    follows[1:-2] = whole[:-2] & whole[1:-1] & whole[2:]
    return spacing_s, follows
