"""Clocks of cameras from labelled points that several of them followed, in a rig that is known.

Search, then solve: offsets to half a frame from epipolar errors (:mod:`rigcal.sync.content.points.search`), then
Gauss-Newton steps on all clocks together (:mod:`rigcal.sync.content.points.refine`). Sigmas come from a jackknife over
blocks of time: the residuals of one board, one gesture or one calibration error are not independent of one another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigcal.errors import TracksError
from rigcal.geometry import Floats
from rigcal.rig import Rig
from rigcal.sync.content.lags import CameraLag, ContentLags, Method, check_clock_options
from rigcal.sync.content.points.clocks import DRIFT, OFFSET, READOUT, Clocks
from rigcal.sync.content.points.pairs import pair_residual_s
from rigcal.sync.content.points.refine import Refined, compare, refine
from rigcal.sync.content.points.search import Found, search_offsets
from rigcal.sync.content.points.seen import SeenPoints, prepare
from rigcal.sync.content.points.verdict import bound_factor, search_problem, solution_problem
from rigcal.sync.content.tracks import PointTracks

_INTERPOLATION_S = 2e-6  # noise-free tracks at 30 fps come out within 1.3 us: what cubics leave of a hand's motion
_READOUT_SIGMA_S = 0.03  # readouts of rolling shutters: 5 to 33 ms


@dataclass(frozen=True, slots=True)
class LagOptions:
    """How clocks are sought in content.

    Raises:
        OptionError: for a value out of its range.
    """

    search_s: float = 3.0
    """The most that the stamps of two cameras may be apart from where the search starts."""
    readout_s: Mapping[str, float] = field(default_factory=dict)
    """Time from the first row's exposure to the last one's, where known; 0: global shutter."""
    estimate_readout: bool = True
    """Whether to estimate the readout of cameras that are not named; otherwise their shutters are taken for global.
    Estimating costs a fifth of the accuracy; a rolling shutter taken for a global one, milliseconds."""
    drift_limit_ppm: float = 100.0
    """What clocks of cameras may drift against one another; known before anything is measured."""

    def __post_init__(self) -> None:
        check_clock_options(self.search_s, self.drift_limit_ppm, self.readout_s)


def estimate_lags(
    rig: Rig,
    tracks: Sequence[PointTracks],
    *,
    method: Method,
    options: LagOptions = LagOptions(),
    start_s: Mapping[str, float] | None = None,
) -> ContentLags:
    """Offset, drift and readout of every camera against the reference, from points that several cameras followed.

    Args:
        rig: The rig; its clocks are not used.
        tracks: One per camera; a point has the same index in all of them.
        method: What the points are.
        options: Options.
        start_s: Offset per camera around which to search; 0 where not named.

    Returns:
        The reference is ``rig.reference`` where it has tracks, else the first camera of the rig that has. Cameras for
        which the content does not decide say so, and why.

    Raises:
        TracksError: for fewer than two cameras, cameras that the rig does not have, or unlike numbers of points.
    """
    _check(rig, tracks)
    order = {camera_id: index for index, camera_id in enumerate(rig.camera_ids)}
    order[rig.reference] = -1
    ordered = sorted(tracks, key=lambda track: order[track.camera_id])
    epoch_s = min((float(track.t_s[0]) for track in ordered if len(track.t_s)), default=0.0)
    cameras = [prepare(rig.camera(track.camera_id), track, epoch_s) for track in ordered]
    start = np.array([(start_s or {}).get(seen.camera_id, 0.0) for seen in cameras])
    found = search_offsets(cameras, start - start[0], search_s=options.search_s)
    lags, residual_s = _solved(cameras, found, options)
    shifted = [replace(lag, at_s=lag.at_s + epoch_s) for lag in lags]
    in_order = sorted(shifted, key=lambda lag: rig.camera_ids.index(lag.camera_id))
    return ContentLags(method, cameras[0].camera_id, tuple(in_order), residual_s)


def _check(rig: Rig, tracks: Sequence[PointTracks]) -> None:
    ids = [track.camera_id for track in tracks]
    if len(ids) < 2 or len(set(ids)) < len(ids):
        raise TracksError("clocks are compared between cameras", expected="two cameras or more, each once", got=ids)
    unknown = [camera_id for camera_id in ids if camera_id not in rig.camera_ids]
    if unknown:
        raise TracksError(
            f"camera {unknown[0]} is not in the rig", expected=f"one of {', '.join(rig.camera_ids)}", got=unknown[0]
        )
    counts = {track.camera_id: track.points_px.shape[1] for track in tracks}
    if len(set(counts.values())) > 1:
        raise TracksError("cameras have unlike numbers of points", expected="the same points in each", got=counts)
    unordered = [track.camera_id for track in tracks if (np.diff(track.t_s) <= 0).any()]
    if unordered:
        raise TracksError(
            f"the stamps of {unordered[0]} do not ascend", expected="each later than the one before", got="repeats"
        )


def _solved(
    cameras: Sequence[SeenPoints], found: Sequence[Found | None], options: LagOptions
) -> tuple[list[CameraLag], float]:
    """Lags after the common epoch, and how far pairs disagree."""
    lags: list[CameraLag] = []
    clear: list[tuple[int, Found]] = []
    for seen, searched in zip(cameras, found, strict=True):
        problem = search_problem(searched, seen, options.search_s) if lags else ""
        lags.append(_guess(seen, searched, problem, options))
        if searched is not None and not problem:
            clear.append((len(lags) - 1, searched))
    if len(clear) < 2:
        reference = replace(lags[0], confident=False, reason="no other camera's clock can be told against it")
        return [reference, *lags[1:]], 0.0
    chosen = [cameras[c] for c, _ in clear]
    clocks, sigma = _start(chosen, [searched.offset_s for _, searched in clear], options)
    comparison = compare(chosen, clocks)
    refined = refine(comparison, clocks, sigma)
    lags[0] = _reference(cameras[0], refined, options)
    for index, (c, searched) in enumerate(clear[1:], start=1):
        lags[c] = _lag(cameras[c], searched, refined, index, options)
    return lags, pair_residual_s(comparison, refined)


def _start(cameras: Sequence[SeenPoints], offset_s: Sequence[float], options: LagOptions) -> tuple[Clocks, Floats]:
    """Clocks as the search leaves them, and (M, 3) how well each parameter is known; 0: held."""
    values, sigma = np.zeros((len(cameras), 3)), np.zeros((len(cameras), 3))
    values[:, OFFSET] = offset_s
    values[:, READOUT] = [options.readout_s.get(seen.camera_id, 0.0) for seen in cameras]
    sigma[1:, OFFSET] = [seen.spacing_s for seen in cameras[1:]]
    sigma[1:, DRIFT] = options.drift_limit_ppm * 1e-6 / 3
    sigma[:, READOUT] = [_READOUT_SIGMA_S if _estimated(seen, options) else 0.0 for seen in cameras]
    middle = [seen.t_s[np.isfinite(seen.px).any(axis=(1, 2))].mean() for seen in cameras]
    return Clocks(values, np.array(middle)), sigma


def _estimated(seen: SeenPoints, options: LagOptions) -> bool:
    return options.estimate_readout and seen.camera_id not in options.readout_s


def _lag(seen: SeenPoints, found: Found, refined: Refined, index: int, options: LagOptions) -> CameraLag:
    """What the solution says of one camera."""
    offset_s, drift, readout_s = refined.clocks.values[index]
    sigma = refined.sigma[index]
    factor = bound_factor(refined.blocks[index] - 1)  # the offset uses up one block, the drift another
    bound_s = factor * sigma[OFFSET] + _INTERPOLATION_S
    drift_bound_ppm = factor * sigma[DRIFT] * 1e6
    told = drift_bound_ppm < options.drift_limit_ppm / 2
    known = options.estimate_readout or seen.camera_id in options.readout_s
    problem = solution_problem(bound_s, refined.blocks[index], refined.block_s, seen.spacing_s, settled=refined.settled)
    return CameraLag(
        seen.camera_id,
        not problem,
        problem,
        float(offset_s),
        float(refined.clocks.at_s[index]),
        float(bound_s),
        float(drift * 1e6) if told else 0.0,
        float(drift_bound_ppm) if told else options.drift_limit_ppm,
        readout_s=float(readout_s) if known else None,
        readout_sigma_s=float(sigma[READOUT]) if _estimated(seen, options) else None,
        searched_s=found.offsets_s,
        cost=found.cost,
    )


def _reference(seen: SeenPoints, refined: Refined, options: LagOptions) -> CameraLag:
    """The camera that the others are compared with."""
    known = options.estimate_readout or seen.camera_id in options.readout_s
    return CameraLag(
        seen.camera_id,
        True,
        "",
        0.0,
        float(refined.clocks.at_s[0]),
        0.0,
        0.0,
        0.0,
        readout_s=float(refined.clocks.values[0, READOUT]) if known else None,
        readout_sigma_s=float(refined.sigma[0, READOUT]) if _estimated(seen, options) else None,
    )


def _guess(seen: SeenPoints, found: Found | None, problem: str, options: LagOptions) -> CameraLag:
    """The best guess of a camera whose clock the search does not decide."""
    middle_s = float(seen.t_s.mean()) if len(seen.t_s) else 0.0
    offset_s, searched_s, cost = (0.0, None, None) if found is None else (found.offset_s, found.offsets_s, found.cost)
    bound_s, limit_ppm = options.search_s, options.drift_limit_ppm
    return CameraLag(
        seen.camera_id, False, problem, offset_s, middle_s, bound_s, 0.0, limit_ppm, searched_s=searched_s, cost=cost
    )
