"""Whether a site is monitored: what is said beside every result, so that silence never passes for safety.

Somebody is placed by two cameras or more. With every wanted camera an instant is MONITORED, with fewer it is DEGRADED,
with fewer than two it is NOT MONITORED: nothing can be told of it. A camera whose clock cannot be trusted counts as
absent, because what it saw a moment earlier or later would place people where they are not.

Decision: a stepped clock is believed again only when its stamps are back where they were before the step. That the new
time is the better one cannot be seen from here: the model in the rig file was measured before.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np

from recognition.observations import FrameSet, Scene, Status
from rigcal.pace import judge_pace
from rigcal.rig import ClockModel, Rig

LEAST_CAMERAS = 2
"""That can place anything."""
STEP_S = 0.010
"""A step of a clock from which on it counts: the error that the gate ``clock_error_m`` allows, 20 mm at 2 m/s."""
AHEAD_S = 0.1
"""Frames that come this much sooner after their stamps than any before show a clock that was set forward; the fastest
way from a camera hardly gets faster."""
_WINDOW, _EVERY = 90, 30
"""Stamps that steps are looked for in, and after how many new ones: three seconds and one, at 30 fps."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """How well an instant is monitored."""

    status: Status
    reason: str
    """In words; empty where every wanted camera took part."""
    cameras: int
    """How many took part."""


def judged(
    camera_ids: Sequence[str], use: Sequence[bool], frame_set: FrameSet, faults: Mapping[int, str] | None = None
) -> Verdict:
    """How well an instant is monitored.

    Args:
        camera_ids: (V,) of the rig.
        use: (V,) which cameras are wanted.
        frame_set: The instant.
        faults: What is known to be wrong with cameras, by their index.
    """
    wanted = [view for view, is_wanted in enumerate(use) if is_wanted]
    absent = [view for view in wanted if frame_set.times_ns[view] is None]
    cameras = len(wanted) - len(absent)
    if not absent and cameras >= LEAST_CAMERAS:
        return Verdict("MONITORED", "", cameras)
    why = "; ".join(f"{camera_ids[view]}: {(faults or {}).get(view, 'no frame')}" for view in absent)
    reason = f"{cameras} of {len(wanted)} cameras" + (f" ({why})" if why else "")
    return Verdict("DEGRADED" if cameras >= LEAST_CAMERAS else "NOT MONITORED", reason, cameras)


class Coverage:
    """How well a site was monitored over the time of a run: for how long, and when that began and ended."""

    def __init__(self) -> None:
        self.seconds: dict[Status, float] = {}
        """For how long each status lasted, in rig time: a scene's lasts up to the next scene."""
        self._last: Scene | None = None
        self._since_ns: int | None = None
        """Since when nothing is monitored; None while something is."""

    def see(self, scene: Scene) -> str | None:
        """Count the next scene; says in words where monitoring ends or begins with it, and None elsewhere."""
        last, self._last = self._last, scene
        if last is not None:
            lasted_s = (scene.t_ns - last.t_ns) * 1e-9
            self.seconds[last.status] = self.seconds.get(last.status, 0.0) + lasted_s
        is_monitored, since_ns = scene.status != "NOT MONITORED", self._since_ns
        if is_monitored is (since_ns is None):
            return None
        if since_ns is None:
            self._since_ns = scene.t_ns
            return f"NOT MONITORED: {scene.reason}"
        self._since_ns = None
        how = "" if scene.status == "MONITORED" else f": {scene.status}, {scene.reason}"
        return f"monitored from here on, after {(scene.t_ns - since_ns) * 1e-9:.1f} s{how}"


def clock_faults(
    rig: Rig, use: Sequence[bool], now_s: float, *, max_age_s: float, period_s: float
) -> Iterator[tuple[int, str]]:
    """Cameras of a live rig whose clocks cannot be trusted now, and why.

    A clock must have been measured, not too long ago, and be known to half a frame. The reference camera needs none
    where the others were measured against its video.

    Args:
        rig: The rig with its clock models.
        use: (V,) which cameras are wanted.
        now_s: Rig time, seconds since the epoch.
        max_age_s: The site's limit, :attr:`rigcal.site.Site.clock_age_s`.
        period_s: Of the frames.
    """
    methods = {camera.clock.method for camera in rig.cameras if camera.clock}
    for view, camera in enumerate(rig.cameras):
        is_zero = camera.id == rig.reference and methods == {"video"}
        if use[view] and not (camera.clock is None and is_zero):
            fault = _clock_fault(camera.clock, now_s, max_age_s, period_s)
            if fault:
                yield view, fault


def _clock_fault(clock: ClockModel | None, now_s: float, max_age_s: float, period_s: float) -> str | None:
    measure = "measure it: rigcal sync probe"
    if clock is None:
        return f"its clock was never measured; {measure}"
    age_s, bound_s = abs(now_s - clock.at_s), clock.bound_at_s(now_s)
    if age_s > max_age_s:
        return f"its clock was measured {age_s / 3600:.1f} h ago, the limit is {max_age_s / 3600:.3g} h; {measure}"
    if bound_s > period_s / 2:
        return f"its clock is known to {1e3 * bound_s:.1f} ms, half a frame is {500 * period_s:.1f} ms; {measure}"
    return None


class ClockWatch:
    """Whether the stamps of one camera still come from the clock that they began with.

    A clock that is set shows in three ways: stamps run back; frames come sooner after their stamps than was ever
    possible; or the grid of the stamps jumps by a part of a period and stays there (:func:`rigcal.pace.judge_pace`).
    """

    def __init__(self) -> None:
        self.fault: str | None = None
        """Why the stamps cannot be trusted; None where they can."""
        self._stamps: deque[tuple[int, int | None]] = deque(maxlen=_WINDOW)
        """Capture time and, for live sources, arrival minus capture."""
        self._unjudged = 0
        self._least_ns: int | None = None
        self._usual_ns: int | None = None
        """The usual time from capture to arrival, before the step."""
        self._jump_ns = 0
        self._back = 0

    def see(self, t_ns: int, receive_ns: int | None) -> None:
        """Judge the next frame: its capture time, and its arrival where it is live; both rig time."""
        lag_ns = None if receive_ns is None else receive_ns - t_ns
        if self.fault is None:
            jump_ns = self._jump(t_ns, lag_ns)
            if abs(jump_ns) >= STEP_S * 1e9:
                self._distrust(jump_ns)
        elif lag_ns is not None and self._usual_ns is not None:
            self._look_for_return(lag_ns, self._usual_ns)
        self._stamps.append((t_ns, lag_ns))

    def interrupted(self, step_s: float = 0.0) -> None:
        """The stream broke off and may go on: a gap is no step.

        Args:
            step_s: By how much the camera is known to have set its clock; its stamps bear that from here on.
        """
        if self.fault is None and abs(step_s) >= STEP_S:
            self._distrust(round(step_s * 1e9))
        self._stamps.clear()
        self._unjudged = 0

    def _jump(self, t_ns: int, lag_ns: int | None) -> int:
        """By how much the clock was set at this frame or shortly before; 0: it was not."""
        if self._stamps and t_ns < self._stamps[-1][0]:
            spacings_ns = [after[0] - before[0] for before, after in pairwise(self._stamps)]
            return t_ns - self._stamps[-1][0] - round(median(spacings_ns or [0]))
        if lag_ns is not None:
            if self._least_ns is not None and lag_ns < self._least_ns - AHEAD_S * 1e9:
                return self._least_ns - lag_ns
            self._least_ns = lag_ns if self._least_ns is None else min(self._least_ns, lag_ns)
        self._unjudged += 1
        if self._unjudged < _EVERY:
            return 0
        self._unjudged = 0
        first_ns = self._stamps[0][0]
        steps = judge_pace(np.array([(t - first_ns) * 1e-9 for t, _ in self._stamps])).steps
        return round(1e9 * max((step.jump_s for step in steps), key=abs, default=0.0))

    def _distrust(self, jump_ns: int) -> None:
        self._jump_ns, self._back = jump_ns, 0
        lags_ns = [lag for _, lag in list(self._stamps)[: _WINDOW - _EVERY] if lag is not None]
        self._usual_ns = round(median(lags_ns)) if lags_ns else None
        self.fault = f"its clock was set by {jump_ns * 1e-9:+.3f} s; measure it: rigcal sync probe"

    def _look_for_return(self, lag_ns: int, usual_ns: int) -> None:
        is_back = abs(lag_ns - usual_ns) < abs(self._jump_ns) / 2
        self._back = self._back + 1 if is_back else 0
        if self._back == _EVERY:
            self.fault = None
            self.interrupted()
