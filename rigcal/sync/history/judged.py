"""The light that a camera of a recording gets."""

from __future__ import annotations

from rigcal.sync.check.findings import Colour
from rigcal.sync.history.series import CameraHistory, SyncHistory


def colour_of(history: SyncHistory, camera: CameraHistory) -> Colour:
    """How a camera's clock and frames held through a recording.

    Red: its clock may misplace a point beyond the limit, or was stepped and nothing measured how far. Amber: its
    clock or its latency is not known, its clock was stepped, or frames are missing, repeated, stamped when they
    arrived or not at the declared rate. Green otherwise.
    """
    error_m = history.error_m(camera)
    stepped = len(camera.steps_t_s) > 0
    uneven = len(camera.missing_t_s) > 0 or len(camera.repeated_t_s) > 0 or camera.rate_off_percent is not None
    partly_known = error_m is None or camera.latency_unknown or camera.arrival_stamps
    if (stepped and not camera.measured) or (error_m is not None and error_m > history.clock_error_m):
        return Colour.RED
    return Colour.AMBER if stepped or uneven or partly_known else Colour.GREEN
