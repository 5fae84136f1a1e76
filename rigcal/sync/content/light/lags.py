"""Clocks from a light that all cameras see switched on or off, or from flashes; the rig's geometry is not needed.

Every frame says whether its rows were exposed before, after or across each switching. All of that is linear in the
clocks, so that linear programs give the interval of each camera's offset that contradicts nothing: a hard bound, for
any tone curve, exposure and readout (``light_exposures``, ``light_intervals``). How narrow it is, is up to chance and
shutter: one switching tells a camera of short exposure and global shutter its offset to a frame, a rolling shutter or
a long exposure to a small part of one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from rigcal.errors import ComparisonError
from rigcal.geometry import Floats
from rigcal.sync.content.lags import CameraLag, ContentLags, check_clock_options
from rigcal.sync.content.light.brightness import BrightnessSeries
from rigcal.sync.content.light.centre import find_centre
from rigcal.sync.content.light.changes import LEAST_FRAMES, LightChange, find_changes
from rigcal.sync.content.light.exposures import Exposures, exposures
from rigcal.sync.content.light.intervals import LightCamera, Seen, consistent
from rigcal.sync.content.light.matching import Matching, Watched, match_changes, unmatched
from rigcal.sync.content.light.verdict import SolvedLight, reference_lag, refused_lag, solved_lag

_READ_FRAMES = 0.6  # frames between which the light changed are half a frame from the change, and a little by readout
_JITTER_SIGMAS = 3.0
_SMEARED_PX = 8  # half a block of H.264 and its kin: by so many rows an encoder may move the edge of the light
_UNTOLD = "the light's changes follow each other too fast; leave half a second or more between them"


@dataclass(frozen=True, slots=True)
class LightOptions:
    """How a light's changes are compared.

    Raises:
        OptionError: for a value out of its range.
    """

    search_s: float = 60.0
    """The most that the stamps of two cameras may be apart."""
    readout_s: Mapping[str, float] = field(default_factory=dict)
    """Readout time of rolling shutters where known, first row to last; estimated for cameras not named."""
    drift_limit_ppm: float = 100.0
    """What clocks of cameras may drift against one another; known before anything is measured."""

    def __post_init__(self) -> None:
        check_clock_options(self.search_s, self.drift_limit_ppm, self.readout_s)


@dataclass(frozen=True, slots=True, eq=False)
class _Camera:
    """One camera's changes of the light, and which of them are the reference's."""

    series: BrightnessSeries
    matching: Matching
    seen: Mapping[int, tuple[LightChange, Exposures]]
    """By the reference's change: the camera's own, and what it says; empty where the pattern does not decide."""


def light_lags(
    series: Sequence[BrightnessSeries], *, reference: str, options: LightOptions = LightOptions()
) -> ContentLags:
    """Offset, drift and readout of every camera against the reference, from changes of the light that both saw.

    A flash alone cannot tell whether a camera reads its rows from the top; cameras that saw one are taken to. Lamps
    that take longer than three frames to light up are not used.

    Args:
        series: the brightness of each camera, in rig order.
        reference: the camera that the others are compared with.
        options: options.

    Returns:
        The likeliest offsets within hard intervals; ``bound_s`` reaches to the interval's farther end. One change of
        the light makes a camera confident where it is the only one: the bound says how little that may be.

    Raises:
        ComparisonError: for fewer than two cameras, or a reference that is none of them.
    """
    check_cameras([one.camera_id for one in series], reference)
    base = next(one for one in series if one.camera_id == reference)
    base_changes = find_changes(base)
    told = {r for r, found in enumerate(exposures(base, base_changes)) if found is not None}
    cameras = [_compared(one, base, base_changes, told, options) for one in series]
    solved = _solved(cameras, base, base_changes, options)
    lags = [_lag(camera, reference, solved, options) for camera in cameras]
    residual_s = 0.0 if solved is None else float(np.sqrt((solved.consistent.violation_s**2).mean()))
    return ContentLags("light", reference, tuple(lags), residual_s)


def check_cameras(camera_ids: Sequence[str], reference: str) -> None:
    """Refuse what cannot be compared.

    Raises:
        ComparisonError: for fewer than two cameras, or a reference that is none of them.
    """
    if len(camera_ids) < 2:
        raise ComparisonError(
            "clocks are compared between cameras",
            expected="two cameras or more",
            got=", ".join(camera_ids) or "none",
            do_next="give a capture of all cameras, recorded at the same time",
        )
    if reference not in camera_ids:
        raise ComparisonError(
            "the reference camera is not in the capture",
            expected=f"one of {', '.join(camera_ids)}",
            got=reference,
            do_next="name one of the capture's cameras, or record the reference camera too",
        )


def _compared(
    one: BrightnessSeries,
    base: BrightnessSeries,
    base_changes: Sequence[LightChange],
    told: Set[int],
    options: LightOptions,
) -> _Camera:
    """A camera beside the reference, of which only the changes ``told`` say anything."""
    for series, name in ((one, "this camera"), (base, "the reference camera")):
        if len(series.t_s) < LEAST_FRAMES:
            return _Camera(one, unmatched(f"{name} has {len(series.t_s)} frames; {LEAST_FRAMES} are needed"), {})
    changes = find_changes(one)
    search_s = 0.0 if one is base else options.search_s
    ours, theirs = _watched(base, base_changes), _watched(one, changes)
    matching = match_changes(ours, theirs, within_s=_within_s(one, base, options), search_s=search_s)
    says = exposures(one, changes)
    pairs = () if matching.reason else matching.pairs
    seen = {r: (changes[c], found) for r, c in pairs if r in told and (found := says[c]) is not None}
    return _Camera(one, matching, seen)


def _watched(series: BrightnessSeries, changes: Sequence[LightChange]) -> Watched:
    return Watched(tuple(changes), float(series.t_s[0]), float(series.t_s[-1]))


def _within_s(one: BrightnessSeries, base: BrightnessSeries, options: LightOptions) -> float:
    """How far from the offset the times of one change may be read in two cameras: frames of each, and their drift."""
    span_s = max(float(np.ptp(one.t_s)), float(np.ptp(base.t_s)))
    return _READ_FRAMES * (one.period_s + base.period_s) + options.drift_limit_ppm * 1e-6 * span_s


def _known(camera: _Camera, base: BrightnessSeries, options: LightOptions) -> LightCamera:
    """What is known of a camera before its inequalities are solved."""
    series, changes = camera.series, [change for change, _ in camera.seen.values()]
    flashed = any(change.kind in {"flash", "dip"} for change in changes)
    least_s, greatest_s = (0.0 if flashed else -series.period_s), series.period_s
    if series.camera_id in options.readout_s:
        least_s = greatest_s = options.readout_s[series.camera_id]
    smeared = _SMEARED_PX / series.height_px if series.coded else 0.0
    return LightCamera(
        offset_s=camera.matching.offset_s,
        within_s=0.0 if series is base else 4 * _within_s(series, base, options),
        at_s=(changes[0].t_s + changes[-1].t_s) / 2,
        period_s=series.period_s,
        greatest_drift_ppm=0.0 if series is base else options.drift_limit_ppm,
        slack_s=stamp_jitter_s(series.t_s) + smeared * max(-least_s, greatest_s),
        least_readout_s=least_s,
        greatest_readout_s=greatest_s,
    )


def stamp_jitter_s(t_s: Floats) -> float:
    """How far stamps stray from even spacing, three robust sigmas but no more than any does; gaps left out."""
    steps = np.diff(t_s)
    even = (steps[1:] < 1.5 * np.median(steps)) & (steps[:-1] < 1.5 * np.median(steps))
    stray = np.abs(np.diff(steps))[even] / 2
    if not len(stray):
        return 0.0
    sigma_s = 1.4826 * float(np.median(stray)) / np.sqrt(1.5)  # a stamp against the mean of its neighbours
    return float(min(_JITTER_SIGMAS * sigma_s, stray.max()))


def _solved(
    cameras: Sequence[_Camera], base: BrightnessSeries, base_changes: Sequence[LightChange], options: LightOptions
) -> SolvedLight | None:
    """All that the cameras saw, solved together; None where no camera saw a change that the reference saw."""
    used = [camera for camera in cameras if camera.seen]
    if len(used) < 2:
        return None
    seen = [
        Seen(index, r, change.kind in {"on", "flash"}, found)
        for index, camera in enumerate(used)
        for r, (change, found) in camera.seen.items()
    ]
    known = [_known(camera, base, options) for camera in used]
    found = consistent(known, np.array([change.t_s for change in base_changes]), seen)
    ids = tuple(camera.series.camera_id for camera in used)
    return SolvedLight(found, find_centre(found.polytope), ids, base.camera_id, options.drift_limit_ppm)


def _lag(camera: _Camera, reference: str, solved: SolvedLight | None, options: LightOptions) -> CameraLag:
    camera_id, t_s = camera.series.camera_id, camera.series.t_s
    middle_s = float(t_s[0] + t_s[-1]) / 2 if len(t_s) else 0.0
    if camera_id == reference:
        return reference_lag(camera_id, middle_s, solved)
    if solved is None or not camera.seen:
        reason = camera.matching.reason or _UNTOLD
        return refused_lag(camera_id, reason, middle_s, camera.matching, options.drift_limit_ppm)
    return solved_lag(camera_id, camera.matching, solved)
