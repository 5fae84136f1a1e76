"""What video says of the cameras' clocks: the result of every method that compares content."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rigcal.geometry import Floats, freeze

Method: TypeAlias = Literal["board", "people", "light", "motion energy"]


@dataclass(frozen=True, slots=True, eq=False)
class CameraLag:
    """One camera's clock beside the reference camera's: ``t_reference = t_camera + offset + drift (t_camera - at)``.

    The offset is of a rig file's sign: what to add to the camera's stamps. A camera whose stamps say 10:00:00.012 for
    what the reference stamps 10:00:00.000 has an offset of -0.012 s.
    """

    camera_id: str
    confident: bool
    """Whether the content decides; where not, the other figures are the best guess and must not be used."""
    reason: str
    """Why not, in words for the user; empty where confident."""
    offset_s: float
    at_s: float
    """Camera time of the offset: the middle of what was compared, in seconds after the tracks' epoch."""
    bound_s: float
    """Half-width of the interval that holds the true offset at ``at_s`` (three sigma, or a hard bound)."""
    drift_ppm: float
    drift_bound_ppm: float
    """Half-width of the interval that holds the true drift; where the recording is too short to tell the drift, the
    drift is 0 and this is what clocks of cameras may drift."""
    readout_s: float | None = None
    """Time from the first row's exposure to the last one's, given or estimated; None where not known."""
    readout_sigma_s: float | None = None
    """One standard deviation of an estimated readout."""
    searched_s: Floats | None = None
    """(K,) offsets that the coarse search tried, ascending."""
    cost: Floats | None = None
    """(K,) what each of them costs; the least is the best."""

    def __post_init__(self) -> None:
        for name in ("searched_s", "cost"):
            if getattr(self, name) is not None:
                freeze(self, np.float64, **{name: (None,)})


@dataclass(frozen=True, slots=True)
class ContentLags:
    """The clocks of a capture's cameras beside the reference camera's, as its content says."""

    method: Method
    reference: str
    """The camera that the others are compared with."""
    cameras: tuple[CameraLag, ...]
    """Every camera that was compared, the reference too (offset 0, bound 0), in rig order."""
    residual_s: float
    """How far the pairs of cameras disagree with one clock per camera: root-mean-square over pairs, in seconds."""

    def camera(self, camera_id: str) -> CameraLag | None:
        """What is known of a camera; None where it was not compared."""
        return next((camera for camera in self.cameras if camera.camera_id == camera_id), None)
