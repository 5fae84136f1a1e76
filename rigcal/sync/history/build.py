"""From a capture or a recording, and what is known of its clocks, to its history.

Frames are placed with the rig file's clocks, as ``recognition run`` places them. What probes and pictures say of the
same clocks is put beside it on the same axis; where they differ, frames were placed wrong by as much.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.captures import Capture
from rigcal.errors import NoStampsError
from rigcal.geometry import Floats, Ints
from rigcal.pace import Pace, judge_pace
from rigcal.rig import ClockModel
from rigcal.rigdocument import RigDocument
from rigcal.site import Site
from rigcal.stamps import FrameStamps, frame_stamps, in_rig_time
from rigcal.sync.content.lags import ContentLags
from rigcal.sync.estimator.steps import ClockStep
from rigcal.sync.exchanges import Exchanges
from rigcal.sync.history.known import KnownClocks
from rigcal.sync.history.remarks import CameraFacts, camera_remarks
from rigcal.sync.history.series import CameraHistory, SyncHistory
from rigcal.sync.log import ProbeLog
from rigcal.sync.recording import Recording

SAMPLE_S = 1.0
"""Time between the samples of an offset: as dense as probes are."""
SAMPLES = (300, 20_000)
"""How many samples there are at least and at most; 20,000 are one every 1.8 s of ten hours."""
SAME_STEP_S = 2.0
"""Beyond the time between two probes, how far apart the stamps and the probes may place the same step."""
_NOT_UTC = (
    "do not count from 1970 (UTC): neither the rig file's clocks nor probes apply to them; stamp frames with seconds "
    "since 1970, or compare pictures (rigcal sync video)"
)
_YEAR_2000_NS = 946_684_800 * 10**9


@dataclass(frozen=True, slots=True, eq=False)
class _Frames:
    """A camera's frames before anything is known of its clock."""

    camera_id: str
    stamps_s: Floats
    """(F,) in the order in which they came, by the camera's clock or already in rig time."""
    pace: Pace


def history_of_capture(
    capture: Capture,
    *,
    document: RigDocument | None = None,
    site: Site | None = None,
    log: Mapping[str, Exchanges] | None = None,
    content: ContentLags | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SyncHistory:
    """The clocks and frames of a capture.

    Args:
        capture: The capture.
        document: The rig file whose clocks place its frames.
        site: The site file: fastest motion, limit, declared frame rates and capture latencies.
        log: Probes of the camera hosts through the recording, by camera.
        content: What the pictures say of the stamps after the rig file's clocks were applied: 0 where all is well.
        progress: Told how many cameras are done, and of how many.

    Raises:
        NoStampsError: where the capture does not say when its frames were taken.
        TimestampsError: where ``timestamps.csv`` contradicts the capture.
    """
    stamps = frame_stamps(capture)
    if stamps is None:
        raise NoStampsError(capture.path)
    frames = []
    for i, camera in enumerate(capture.cameras):
        declared = site.camera(camera.id) if site else None
        fps = declared.fps if declared and declared.fps else camera.fps
        pace = judge_pace(_since_first_s(stamps, i), declared_fps=fps)
        frames.append(_Frames(camera.id, stamps.times_s[i], pace))
    first_s = min((float(f.stamps_s.min()) for f in frames if len(f.stamps_s)), default=0.0)
    known = KnownClocks(document, site, log, content, stamps.utc, False, 0.0 if stamps.utc else first_s)
    return _history(capture.path.resolve().name, frames, known, _stamp_remarks(stamps, known), progress)


def history_of_recording(
    recording: Recording,
    *,
    site: Site | None = None,
    log: Mapping[str, Exchanges] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SyncHistory:
    """The clocks and frames of a recording; its frames are in rig time, by the clocks of the rig file inside.

    Args:
        recording: What an MCAP file says.
        site: The site file: fastest motion, limit, declared frame rates and capture latencies.
        log: Probes of the camera hosts through the recording, by camera.
        progress: Told how many cameras are done, and of how many.
    """
    seen_ns = [camera.captured_ns for camera in recording.cameras if len(camera.captured_ns)]
    epoch = all(t_ns.min() >= _YEAR_2000_NS for t_ns in seen_ns)
    zero_ns = 0 if epoch else min(int(t_ns.min()) for t_ns in seen_ns)
    frames = []
    for camera in recording.cameras:
        declared = site.camera(camera.camera_id) if site else None
        pace = judge_pace(_relative_s(camera.captured_ns), declared_fps=declared.fps if declared else None)
        frames.append(_Frames(camera.camera_id, camera.captured_ns / 1e9, pace))
    known = KnownClocks(recording.document, site, log, None, epoch, True, zero_ns / 1e9)
    remarks = () if epoch else (f"the recording's times {_NOT_UTC}",)
    remarks = (*remarks, *recording.warnings, *_log_remarks(known))
    return _history(recording.path.name, frames, known, remarks, progress)


def _history(
    title: str,
    frames: Sequence[_Frames],
    known: KnownClocks,
    remarks: tuple[str, ...],
    progress: Callable[[int, int], None] | None,
) -> SyncHistory:
    clocks = [known.clock(camera.camera_id) for camera in frames]
    placed_s = [
        (f.stamps_s if known.placed else in_rig_time(f.stamps_s, clock)) - known.zero_s
        for f, clock in zip(frames, clocks, strict=True)
    ]
    times_s, cameras = _samples_s(placed_s), []
    for camera, t_s, clock in zip(frames, placed_s, clocks, strict=True):
        cameras.append(_camera(camera, t_s, clock, times_s, known))
        if progress is not None:
            progress(len(cameras), len(frames))
    limits = known.limits
    return SyncHistory(title, known.epoch, tuple(cameras), limits.fastest_motion_m_per_s, limits.clock_error_m, remarks)


def _camera(
    frames: _Frames, frame_t_s: Floats, clock: ClockModel | None, times_s: Floats, known: KnownClocks
) -> CameraHistory:
    pace, start_s, end_s = frames.pace, float(times_s[0]), float(times_s[-1])
    track = known.track(frames.camera_id, start_s, end_s)
    series = known.series(frames.camera_id, track, times_s)
    host_steps = () if track is None else tuple(s for s in track.steps if start_s <= s.at_s <= end_s)
    camera = CameraHistory(
        frames.camera_id,
        frame_t_s,
        missing_t_s=_missing_s(frame_t_s, pace),
        repeated_t_s=frame_t_s[np.union1d(pace.repeated, pace.backwards)],
        steps_t_s=_steps_s(frame_t_s[[step.at for step in pace.steps]], host_steps),
        offsets=series,
        remarks=(),
        declared_fps=pace.declared_fps,
        delivered_fps=pace.delivered_fps,
        arrival_stamps=pace.source == "arrival",
        latency_unknown=known.latency_unknown(frames.camera_id, series),
    )
    facts = CameraFacts(
        pace=pace,
        frame_t_s=frame_t_s,
        epoch=known.epoch,
        clock=clock,
        limits=known.limits,
        logged=None if known.log is None else track is not None,
        host_steps=host_steps,
        lag=known.content.camera(frames.camera_id) if known.content else None,
        declared=known.declares(frames.camera_id),
    )
    return replace(camera, remarks=camera_remarks(camera, facts))


def _steps_s(seen_s: Floats, host_steps: Sequence[ClockStep]) -> Floats:
    """Times of steps, ascending; one that both the stamps and the probes show is one."""
    alone = [step.at_s for step in host_steps if not (np.abs(seen_s - step.at_s) <= step.within_s + SAME_STEP_S).any()]
    return np.sort(np.concatenate([seen_s, alone]))


def _samples_s(frame_t_s: Sequence[Floats]) -> Floats:
    """Times from the first to the last frame at which offsets are told."""
    known = [t_s for t_s in frame_t_s if len(t_s)]
    start_s, end_s = min(float(t.min()) for t in known), max(float(t.max()) for t in known)
    return np.linspace(start_s, end_s, int(np.clip((end_s - start_s) / SAMPLE_S, *SAMPLES)) + 1)


def _missing_s(frame_t_s: Floats, pace: Pace) -> Floats:
    """When the missing frames would have come: evenly between their neighbours."""
    gaps = [np.linspace(frame_t_s[gap.after], frame_t_s[gap.after + 1], gap.count + 2)[1:-1] for gap in pace.missing]
    return np.concatenate([np.zeros(0), *gaps])


def _since_first_s(stamps: FrameStamps, camera: int) -> Floats:
    return _relative_s(stamps.times_ns[camera]) if stamps.times_ns else stamps.times_s[camera]


def _relative_s(t_ns: Ints) -> Floats:
    """Seconds after the first: a float holds all digits of those."""
    return np.asarray((t_ns - t_ns[:1]) * 1e-9)


def _stamp_remarks(stamps: FrameStamps, known: KnownClocks) -> tuple[str, ...]:
    if not stamps.shared:
        first = (
            "the videos hold presentation times only, which count from each camera's own first frame: how the cameras "
            "stand to each other is not known from them; record timestamps.csv, or compare pictures (rigcal sync video)"
        )
    elif not stamps.utc:
        first = f"the times of {stamps.rule} {_NOT_UTC}"
    else:
        first = f"frames are timed by {stamps.rule}"
    return (first, *_log_remarks(known))


def _log_remarks(known: KnownClocks) -> tuple[str, ...]:
    if isinstance(known.log, ProbeLog) and known.log.torn:
        return ("the last row of the probe log is unfinished and was left out: its writer was stopped",)
    return ()
