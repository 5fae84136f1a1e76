"""Clocks of cameras from people who move about: detections without identity, in a rig that is known.

Per view, detections are linked into tracklets. A coarse search compares the tracklets of every two views at every lag
by how near joints lie to their epipolar lines, and finds one offset per camera that explains all pairs. At those
offsets tracklets of different views join into people, whose joints then give offsets to a small fraction of a frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigcal.errors import OptionError
from rigcal.geometry import Floats
from rigcal.rig import Rig
from rigcal.sync.content.lags import CameraLag, ContentLags, check_clock_options
from rigcal.sync.content.people.coarse import STEP_S, Coarse, search, view_pairs
from rigcal.sync.content.people.fine import JOINT_GROUPS, LEAST_BLOCKS, FineClocks, refine_people
from rigcal.sync.content.people.keypoints import Keypoints
from rigcal.sync.content.people.tracklets import Tracklet, tracklets
from rigcal.sync.content.people.tracks import joined_people, point_tracks
from rigcal.sync.content.people.verdict import solution_problem
from rigcal.sync.content.people.views import people_view
from rigcal.sync.content.points.clocks import OFFSET, READOUT, Clocks
from rigcal.sync.content.points.seen import SeenPoints, prepare
from rigcal.sync.content.points.verdict import bound_factor

UNSETTLED = 3.0
"""Share of what half the time for means changes that is added to the bounds of a recording of seconds. With 1, two of
40 shifts of a detector that mistakes limbs were claimed wrongly."""


@dataclass(frozen=True, slots=True)
class PeopleOptions:
    """How clocks are sought in people.

    Raises:
        OptionError: for a value out of its range.
    """

    search_s: float = 2.0
    """The most that the stamps of two cameras may be apart; less where their recordings overlap less."""
    min_score: float = 0.3
    """Joints with a lower score are not used."""
    readout_s: Mapping[str, float] = field(default_factory=dict)
    """Time from the first row's exposure to the last one's of rolling shutters; cameras not named have global ones."""
    drift_limit_ppm: float = 100.0
    """What clocks of cameras may drift against one another; known before anything is measured."""

    def __post_init__(self) -> None:
        if not 0.3 <= self.search_s <= 60:
            raise OptionError("search_s", expected="seconds in 0.3..60", got=self.search_s)
        if not 0 < self.min_score <= 1:
            raise OptionError("min_score", expected="a score above 0, at most 1", got=self.min_score)
        check_clock_options(self.search_s, self.drift_limit_ppm, self.readout_s)


def people_lags(
    rig: Rig, keypoints: Keypoints, times_s: Floats, *, options: PeopleOptions = PeopleOptions()
) -> ContentLags:
    """Offset and drift of every camera against the reference, from people that several cameras see.

    Args:
        rig: the rig; its clocks are not used.
        keypoints: detections, as :func:`rigcal.sync.content.people.read_keypoints` gives them.
        times_s: (F, V) stamp of each frame by the clock of each camera, in seconds after an epoch that all share; NaN
            where a camera has no such frame. F is at least the number of frames that the detections name.
        options: options.

    Returns:
        Every camera of the rig. The reference is ``rig.reference`` where it sees people together with another camera,
        else the first camera that does. Cameras whose offset the people do not decide say so, and why: people who
        stand still or walk on the spot decide nothing.

    Raises:
        ValueError: where ``times_s`` has another shape.
    """
    cameras = range(len(rig.cameras))
    if times_s.ndim != 2 or times_s.shape[1] != len(cameras) or len(times_s) < keypoints.frames:
        raise ValueError(f"times_s: expected ({keypoints.frames} or more, {len(cameras)}), got {times_s.shape}")
    epoch_s = float(np.nanmin(times_s, initial=np.inf)) if np.isfinite(times_s).any() else 0.0
    since_s = times_s - epoch_s
    seen = [_followed(keypoints, view, since_s[:, view], options.min_score) for view in cameras]
    views = [people_view(mounted, seen[view], STEP_S) for view, mounted in enumerate(rig.cameras)]
    coarse = search(rig, seen, views, options.search_s)
    lags = [_guess(rig, view, coarse, seen[view], options) for view in cameras]
    residual_s = 0.0
    if coarse.clear:
        start_s = {view: coarse.offset_s[view] for view in coarse.clear}
        people = joined_people(views, view_pairs(rig, views), {view: coarse.steps[view] for view in coarse.clear})
        tracks = point_tracks(rig.camera_ids, people, seen, since_s, start_s)
        ready = [prepare(rig.camera(track.camera_id), track, 0.0) for track in tracks]
        fine = refine_people(ready, _start(ready, list(start_s.values()), options), options.drift_limit_ppm * 1e-6 / 3)
        residual_s = fine.residual_s
        for index, view in enumerate(coarse.clear):
            lags[view] = _refined(lags[view], index, fine, ready[index].spacing_s, options)
    lags = _with_reference(lags, coarse)
    cameras_in_epoch = tuple(replace(lag, at_s=lag.at_s + epoch_s) for lag in lags)
    return ContentLags("people", rig.camera_ids[coarse.reference], cameras_in_epoch, residual_s)


def _followed(keypoints: Keypoints, view: int, t_s: Floats, min_score: float) -> tuple[Tracklet, ...]:
    """The tracklets of one view."""
    rows = keypoints.view == view
    kpts = keypoints.kpts[rows]
    points_px = np.where(kpts[..., 2:] >= min_score, kpts[..., :2], np.nan)
    return tracklets(keypoints.frame[rows], points_px, t_s)


def _start(ready: Sequence[SeenPoints], start_s: Sequence[float], options: PeopleOptions) -> Clocks:
    """Clocks as the search leaves them, about the middle of the time in which people were seen."""
    values = np.zeros((len(ready), 3))
    values[:, OFFSET] = start_s
    values[:, READOUT] = [options.readout_s.get(seen.camera_id, 0.0) for seen in ready]
    seen_s = [seen.t_s[np.isfinite(seen.px).any(axis=(1, 2))] for seen in ready]
    middle_s = np.mean([t_s.mean() + offset_s for t_s, offset_s in zip(seen_s, start_s, strict=True)])
    return Clocks(values, middle_s - values[:, OFFSET])


def _guess(rig: Rig, view: int, coarse: Coarse, seen: Sequence[Tracklet], options: PeopleOptions) -> CameraLag:
    """What the search alone says of a camera."""
    offset_s = coarse.offset_s.get(view, 0.0)
    profile = coarse.profiles.get(view)
    judged = np.isfinite(profile.agreement) if profile else None
    return CameraLag(
        rig.camera_ids[view],
        False,
        coarse.problems[view],
        offset_s,
        float(np.mean([t for tracklet in seen for t in tracklet.t_s[[0, -1]]])) if seen else 0.0,
        options.search_s,
        0.0,
        options.drift_limit_ppm,
        readout_s=options.readout_s.get(rig.camera_ids[view]),
        searched_s=np.asarray((coarse.steps[view] + profile.change[judged]) * STEP_S, dtype=np.float64)
        if profile
        else None,
        cost=1 - profile.agreement[judged] if profile else None,
    )


def _refined(guess: CameraLag, index: int, fine: FineClocks, spacing_s: float, options: PeopleOptions) -> CameraLag:
    """What the fine solution says of a camera; the first is the reference."""
    if index == 0:
        return replace(guess, offset_s=0.0, at_s=float(fine.clocks.at_s[0]))
    offset_s, drift, _ = fine.clocks.values[index]
    freedom = JOINT_GROUPS if fine.blocks < LEAST_BLOCKS else min(JOINT_GROUPS, fine.blocks)
    factor = bound_factor(freedom)
    bound_s = factor * fine.sigma[index, 0] + UNSETTLED * fine.unsettled_s
    drift_bound_ppm = factor * fine.sigma[index, 1] * 1e6
    told = drift_bound_ppm < options.drift_limit_ppm / 2
    problem = solution_problem(bound_s, offset_s - guess.offset_s, spacing_s)
    if problem:
        return replace(guess, reason=problem, bound_s=max(float(bound_s), spacing_s / 2))
    return replace(
        guess,
        confident=True,
        reason="",
        offset_s=float(offset_s),
        at_s=float(fine.clocks.at_s[index]),
        bound_s=float(bound_s),
        drift_ppm=float(drift * 1e6) if told else 0.0,
        drift_bound_ppm=float(drift_bound_ppm) if told else options.drift_limit_ppm,
    )


def _with_reference(lags: Sequence[CameraLag], coarse: Coarse) -> list[CameraLag]:
    """The same, with the camera that the others are compared with judged by whether any other's clock is told."""
    answered = list(lags)
    sure = any(lag.confident for lag in lags)
    reason = "" if sure else coarse.problems[coarse.reference] or "no other camera's clock can be told against it"
    held = replace(answered[coarse.reference], confident=sure, reason=reason, offset_s=0.0)
    answered[coarse.reference] = replace(held, bound_s=0.0, drift_bound_ppm=0.0) if sure else held
    return answered
