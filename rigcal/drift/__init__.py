"""Which camera moved since the calibration, told from new views of the board, and that camera placed again."""

from rigcal.drift.lens import LensChange
from rigcal.drift.movement import Movement, Placement, place_cameras
from rigcal.drift.resolve import Resolved, resolve_drift
from rigcal.drift.verdict import CameraDrift, Drift, DriftOptions, GroupDrift, find_drift

__all__ = [
    "CameraDrift",
    "Drift",
    "DriftOptions",
    "GroupDrift",
    "LensChange",
    "Movement",
    "Placement",
    "Resolved",
    "find_drift",
    "place_cameras",
    "resolve_drift",
]
