"""The calibration of the paper that this project began from, beside a rig's.

SafeConstruct (Chharia et al.), under "Camera Parameters": four cameras of 1920 x 1080 px, checkerboards, each pair
solved by stereo calibration, camera 0 the origin. It says of its own limit that calibrating pair by pair "has a
compounding effect on RMSE values"; the columns beside it show that effect and what the joint solve leaves of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest

from rigcal.report.numbers import ABSENT
from rigcal.rigdocument import CameraEntry, RigDocument

INTRINSIC_PX = (0.2567, 0.1823, 0.2092, 0.1623)
"""RMSE of cameras 0-3 of the paper, each alone."""
EXTRINSIC_PX = (None, 0.8098, 0.5806, 1.1369)
"""RMSE of cameras 1-3 of the paper relative to camera 0."""


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One camera of the paper and the rig's camera at the same place; either may be missing."""

    name: str
    """The paper's name of its camera; ``-`` beyond its four."""
    intrinsic_px: float | None
    extrinsic_px: float | None
    camera: CameraEntry | None


def beside_paper(document: RigDocument) -> tuple[PaperRow, ...]:
    """The paper's cameras beside the rig's, in order."""
    names = [f"Camera {number}" for number in range(len(INTRINSIC_PX))]
    return tuple(
        PaperRow(name or ABSENT, intrinsic_px, extrinsic_px, camera)
        for name, intrinsic_px, extrinsic_px, camera in zip_longest(names, INTRINSIC_PX, EXTRINSIC_PX, document.cameras)
    )
