"""From what a recording's light leaves open to the clock of one camera, or to why it has none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats
from rigcal.sync.content.lags import CameraLag
from rigcal.sync.content.light.intervals import Consistent, interval
from rigcal.sync.content.light.matching import Matching

_MOST_CONTRADICTED = 1 / 8
"""Share of a camera's changes that may contradict the others before its clock is refused."""
_OPEN_PERIODS = 1.5
"""Frame periods of both cameras together: a wider interval than any single change leaves is no clock."""
_DRIFT_KNOWN = 0.25  # a drift is told where its interval is narrower than this part of what clocks may drift
_READOUT_KNOWN = 0.1  # a readout, where its standard deviation is below this part of a frame period


@dataclass(frozen=True, slots=True, eq=False)
class SolvedLight:
    """What the changes of the light say together."""

    consistent: Consistent
    centre: Floats
    """The likeliest unknowns of the polytope."""
    camera_ids: tuple[str, ...]
    """The cameras of the polytope, in its order."""
    reference: str
    drift_limit_ppm: float


def reference_lag(camera_id: str, at_s: float, solved: SolvedLight | None) -> CameraLag:
    """The reference's own clock: no offset; its readout where it was estimated."""
    readout_s = sigma_s = None
    if solved is not None:
        readout_s, sigma_s = _readout(solved, solved.camera_ids.index(camera_id))
    return CameraLag(camera_id, True, "", 0.0, at_s, 0.0, 0.0, 0.0, readout_s, sigma_s)


def refused_lag(camera_id: str, reason: str, at_s: float, matching: Matching, drift_limit_ppm: float) -> CameraLag:
    """A camera whose clock the light does not tell."""
    return CameraLag(
        camera_id,
        False,
        reason,
        matching.offset_s,
        at_s,
        np.inf,
        0.0,
        drift_limit_ppm,
        searched_s=matching.searched_s,
        cost=matching.unpaired,
    )


def solved_lag(camera_id: str, matching: Matching, solved: SolvedLight) -> CameraLag:
    """The clock of a camera of the polytope: the likeliest offset, and the interval's farther end as its bound."""
    index, polytope = solved.camera_ids.index(camera_id), solved.consistent.polytope
    offset_s = polytope.in_units(index, "offset_s", float(solved.centre[polytope.column(index, "offset_s")]))
    least_s, greatest_s = interval(polytope, index, "offset_s")
    drift_ppm, drift_bound_ppm = _drift(*interval(polytope, index, "drift_ppm"), solved.drift_limit_ppm)
    readout_s, sigma_s = _readout(solved, index)
    bound_s = max(greatest_s - offset_s, offset_s - least_s)
    reason = _contradiction(camera_id, solved) or _open(bound_s, index, solved)
    return CameraLag(
        camera_id,
        not reason,
        reason,
        offset_s,
        polytope.cameras[index].at_s,
        bound_s,
        drift_ppm,
        drift_bound_ppm,
        readout_s,
        sigma_s,
        matching.searched_s,
        matching.unpaired,
    )


def _contradiction(camera_id: str, solved: SolvedLight) -> str:
    """Why a camera's changes do not give one clock; empty where they do."""
    index, found = solved.camera_ids.index(camera_id), solved.consistent
    both = {index, solved.camera_ids.index(solved.reference)}
    paired = {one.change for one in (*found.kept, *found.rejected) if one.camera == index}
    contradicted = len(paired & {one.change for one in found.rejected if one.camera in both})
    if contradicted <= _MOST_CONTRADICTED * len(paired):
        return ""
    return (
        f"{contradicted} of {len(paired)} changes of the light contradict one clock: the stamps jump, or the cameras "
        f"saw different lamps; switch one lamp that all of them see"
    )


def _open(bound_s: float, index: int, solved: SolvedLight) -> str:
    """Why an interval is too wide to be of use; empty where it is not."""
    cameras = solved.consistent.polytope.cameras
    periods_s = cameras[index].period_s + cameras[solved.camera_ids.index(solved.reference)].period_s
    if bound_s <= _OPEN_PERIODS * periods_s:
        return ""
    return (
        f"the changes of the light leave the offset open to {bound_s:.2f} s either way; switch a lamp on or off "
        f"several times, a second or more apart"
    )


def _drift(least_ppm: float, greatest_ppm: float, limit_ppm: float) -> tuple[float, float]:
    """Drift and its bound; 0 where the recording is too short to tell it from none."""
    half_ppm = (greatest_ppm - least_ppm) / 2
    if half_ppm <= _DRIFT_KNOWN * limit_ppm or least_ppm > 0 or greatest_ppm < 0:
        return (least_ppm + greatest_ppm) / 2, half_ppm
    return 0.0, max(-least_ppm, greatest_ppm)


def _readout(solved: SolvedLight, index: int) -> tuple[float | None, float | None]:
    """Readout and its standard deviation, of an even spread over its interval; None where that is wide."""
    polytope = solved.consistent.polytope
    least_s, greatest_s = interval(polytope, index, "readout_s")
    sigma_s = (greatest_s - least_s) / np.sqrt(12)
    if sigma_s > _READOUT_KNOWN * polytope.cameras[index].period_s:
        return None, None
    return (least_s + greatest_s) / 2, float(sigma_s)
