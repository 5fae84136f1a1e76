"""What video says of the cameras' clocks: the result of every method that compares content."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rigcal.errors import OptionError
from rigcal.geometry import Floats, freeze

LONGEST_READOUT_S = 0.2
"""Readouts of rolling shutters are 5 to 33 ms; a greater value is in another unit."""
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


def check_clock_options(search_s: float, drift_limit_ppm: float, readout_s: Mapping[str, float]) -> None:
    """Refuse options that no comparison of clocks can have.

    Raises:
        OptionError: for a search or a drift that is not above 0, or a readout of 0.2 s and more.
    """
    if not 0 < search_s < np.inf:
        raise OptionError("search_s", expected="seconds above 0", got=search_s)
    if not 0 < drift_limit_ppm < np.inf:
        raise OptionError("drift_limit_ppm", expected="parts per million above 0", got=drift_limit_ppm)
    for name, value in readout_s.items():
        if not abs(value) < LONGEST_READOUT_S:
            raise OptionError(f"readout_s of {name}", expected=f"seconds below {LONGEST_READOUT_S:g}", got=value)
