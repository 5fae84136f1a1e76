"""What the clocks of a recording mean in words: the verdict, each camera's state, times and spans."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime

from rigcal.report.numbers import beside_limit, scaled, significant
from rigcal.report.words import counted, listed
from rigcal.sync.check.findings import Colour
from rigcal.sync.history.judged import colour_of
from rigcal.sync.history.minutes import Minute
from rigcal.sync.history.series import CameraHistory, Method, SyncHistory

SOURCES: Mapping[Method, str] = {"probe": "probes of its host", "video": "a comparison of pictures"}
_UNITS = ((3600.0, "hour"), (60.0, "minute"), (1.0, "second"))


def sentence(history: SyncHistory) -> str:
    """The page's verdict in a sentence or two."""
    limit_mm, speed = 1e3 * history.clock_error_m, f"{history.fastest_motion_m_per_s:g} m/s"
    known = [(error, c.camera_id) for c in history.cameras if (error := history.error_m(c)) is not None]
    unknown = [c.camera_id for c in history.cameras if history.error_m(c) is None]
    parts = []
    if known:
        worst_m, camera_id = max(known)
        far = f"{beside_limit(1e3 * worst_m, limit_mm)} mm ({camera_id})"
        verb = "beyond" if worst_m > history.clock_error_m else "within"
        parts.append(
            f"Clocks misplace what moves at {speed} by {far} at most, {verb} the limit of {significant(limit_mm)} mm."
        )
    if unknown:
        whose = "No camera's clock is known" if not known else f"The clock of {listed(unknown)} is not known"
        parts.append(f"{whose}.")
    gaps = sum(len(camera.missing_t_s) for camera in history.cameras)
    if gaps:
        parts.append(f"{counted(gaps, 'frame')} {'is' if gaps == 1 else 'are'} missing.")
    stepped = [camera.camera_id for camera in history.cameras if len(camera.steps_t_s)]
    if stepped:
        parts.append(f"The clock of {listed(stepped)} was stepped.")
    return " ".join(parts)


def verdict(history: SyncHistory, camera: CameraHistory) -> str:
    """A camera's state in two or three words."""
    error_m = history.error_m(camera)
    if error_m is not None and error_m > history.clock_error_m:
        return "beyond the limit"
    if len(camera.steps_t_s):
        return "clock was stepped"
    if not len(camera.frame_t_s):
        return "no frames"
    if error_m is None:
        return "clock not known"
    if colour_of(history, camera) is Colour.GREEN:
        return "within the limit"
    if len(camera.missing_t_s):
        return "frames are missing"
    if len(camera.repeated_t_s):
        return "stamps repeat"
    if camera.arrival_stamps:
        return "stamped on arrival"
    return "latency not known" if camera.latency_unknown else "frame rate is off"


def evidence(camera: CameraHistory) -> str:
    """What the figure of a camera's offset rests on."""
    if camera.measured:
        return f"Measured by {listed([SOURCES[series.method] for series in camera.measured])}."
    return "Nothing was measured during this recording: the band is what the rig file's clock claims."


def facts(history: SyncHistory) -> list[tuple[str, str, str]]:
    """The few figures that sum the recording up: what, figure, whose."""
    found = []
    errors = [(error, c.camera_id) for c in history.cameras if (error := history.error_m(c)) is not None]
    if errors:
        worst_m, camera_id = max(errors)
        found.append(("greatest error", f"{significant(1e3 * worst_m)} mm", f"{camera_id}, bound included"))
        found.append(("as time", f"{scaled(worst_m / history.fastest_motion_m_per_s, 1e3, 2)} ms", camera_id))
    missing = [(len(c.missing_t_s), c.camera_id) for c in history.cameras]
    total, frames = sum(count for count, _ in missing), sum(len(c.frame_t_s) for c in history.cameras)
    share = 100 * total / max(total + frames, 1)
    most, camera_id = max(missing, key=lambda entry: entry[0])
    whose = f"{significant(share, 2)} % of all, most of {camera_id} ({most})" if total else "of any camera"
    found.append(("frames missing", str(total), whose))
    steps = [c.camera_id for c in history.cameras if len(c.steps_t_s)]
    if steps:
        found.append(("clock steps", str(sum(len(c.steps_t_s) for c in history.cameras)), listed(steps)))
    return found


def span(history: SyncHistory) -> str:
    """From when to when."""
    start_s, end_s = history.span_s
    if not history.epoch:
        return f"{length(end_s - start_s)}; times count from the first frame"
    start, end = (datetime.fromtimestamp(t, UTC) for t in (start_s, end_s))
    last = f"{end:%H:%M:%S}" if start.date() == end.date() else f"{end:%Y-%m-%d %H:%M:%S}"
    return f"{start:%Y-%m-%d %H:%M:%S} to {last} UTC, {length(end_s - start_s)}"


def length(seconds: float) -> str:
    """A duration: ``12.5 s``, ``4 min 10 s``, ``2 h 05 min``."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def width(seconds: float) -> str:
    """A round stretch of time, to follow ``every``: ``minute``, ``5 minutes``, ``hour``."""
    unit_s, unit = next((entry for entry in _UNITS if seconds >= entry[0]), _UNITS[-1])
    return unit if seconds == unit_s else f"{seconds / unit_s:g} {unit}s"


def told(minute: Minute) -> str:
    """What one is told when one points at a stretch of a figure."""
    parts = []
    if minute.misplaced_s is not None and minute.bound_s is not None:
        parts.append(f"off by {1e3 * minute.misplaced_s:+.2f} ms, known to {1e3 * minute.bound_s:.2f} ms")
    if minute.error_m is not None:
        parts.append(f"at most {significant(1e3 * minute.error_m)} mm")
    parts.append(counted(minute.frames, "frame"))
    if minute.delivered_fps is not None:
        parts.append(f"{minute.delivered_fps:.2f} fps")
    for count, what in ((minute.missing, "missing"), (minute.repeated, "repeated")):
        if count:
            parts.append(f"{count} {what}")
    if minute.steps:
        parts.append(f"clock stepped {counted(minute.steps, 'time')}")
    return "; ".join(parts)
