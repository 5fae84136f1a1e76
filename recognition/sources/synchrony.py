"""How well the cameras of a capture kept time together: what ``recognition run`` tells and records of it.

A capture is judged by its own time: a clock model by its bound when the frames were taken, however long ago that is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from recognition.sources.timing import STAMPED, CaptureClocks, Timing
from rigcal.captures import CaptureCamera
from rigcal.geometry import Floats
from rigcal.pace import Pace, judge_pace
from rigcal.rig import ClockModel, Rig

NOTABLE_SPREAD_S = 0.005
"""Median spread from which interpolation is advised: it takes 9 % off the error of walkers' joints at 30 fps with 1 px
noise; at half of this spread 4 %, at 13 ms 27 %."""


@dataclass(frozen=True, slots=True)
class ClockState:
    """A clock model at the time of a capture."""

    method: str
    """``probe``, ``video`` or ``declared``."""
    bound_s: float
    """Half-width of the interval that holds the true offset, the widest during the capture."""
    age_s: float
    """From the measurement to the frame that is furthest from it; negative where the capture came before it."""


@dataclass(frozen=True, slots=True)
class CameraSync:
    """What one camera's frames say of its timekeeping."""

    camera_id: str
    """As the rig names it."""
    frames: int
    missing: int | None
    """Frames that its stamps show to be missing; None where it has no stamps."""
    repeated: int | None
    """Frames whose stamp came before; None where it has no stamps."""
    alone: int
    """Frames that found no partner within half a frame: recorded, but not in 3D."""
    clock: ClockState | None
    """None where no clock model was applied."""


@dataclass(frozen=True, slots=True)
class SyncReport:
    """What the cameras of a capture say of their timekeeping."""

    rule: str
    """How instants were found."""
    instants: int
    """Of any number of cameras."""
    alone: int
    """Instants of a single camera."""
    spread_median_s: float
    """Time between the first and the last frame within an instant; 0 where the rule knows no times."""
    spread_worst_s: float
    cameras: tuple[CameraSync, ...]
    """Those in use, in rig order."""
    warnings: tuple[str, ...]
    """What may spoil the result, and what to do."""

    @property
    def document(self) -> dict[str, Any]:
        """As ``--json`` prints it and the recording's metadata hold it."""
        return asdict(self)

    def lines(self) -> Iterator[str]:
        """For people; without the warnings."""
        yield (
            f"instants by {self.rule}: {self.instants}, {self.alone} of a single camera; frames within an instant are "
            f"{1e3 * self.spread_median_s:.1f} ms apart in the median, {1e3 * self.spread_worst_s:.1f} ms at worst"
        )
        for camera in self.cameras:
            yield f"  {camera.camera_id}: {_counts(camera)}; {_clock(camera.clock)}"


def judge_synchrony(
    timing: Timing, clocks: CaptureClocks, columns: Sequence[int], cameras: Sequence[CaptureCamera], rig: Rig
) -> SyncReport:
    """Judge how the cameras of a capture kept time.

    Args:
        timing: The instants.
        clocks: The stamps, and the clock models that were applied to them.
        columns: (V,) which of the capture's cameras each of the rig's is; -1 for one that is left out.
        cameras: The capture's.
        rig: The rig.
    """
    seen, spread_s = timing.seen, timing.spread_s
    single = seen.sum(axis=1) == 1
    judged: list[CameraSync] = []
    warnings: list[str] = []
    for v, column in enumerate(columns):
        if column < 0:
            continue
        camera = cameras[column]
        t_s = None if clocks.stamps is None else clocks.stamps.times_s[column]
        pace = None if t_s is None else judge_pace(t_s, declared_fps=camera.fps)
        clock = clocks.used.get(camera.id)
        judged.append(
            CameraSync(
                camera_id=rig.camera_ids[v],
                frames=len(camera.frames),
                missing=None if pace is None else pace.missing_frames,
                repeated=None if pace is None else len(pace.repeated),
                alone=int((single & seen[:, v]).sum()),
                clock=None if clock is None or t_s is None else _state(clock, t_s),
            )
        )
        warnings += _camera_warnings(judged[-1], pace, timing.rule)
        if camera.id in clocks.elsewhere:
            warnings.append(_elsewhere(rig.camera_ids[v]))
    return SyncReport(
        rule=timing.rule,
        instants=len(timing.number),
        alone=int(single.sum()),
        spread_median_s=float(np.median(spread_s)) if len(spread_s) else 0.0,
        spread_worst_s=float(spread_s.max(initial=0.0)),
        cameras=tuple(judged),
        warnings=(*_common_warnings(timing.rule, judged, rig.reference), *warnings),
    )


def _state(clock: ClockModel, t_s: Floats) -> ClockState:
    ends_s = (float(t_s.min()), float(t_s.max()))
    return ClockState(
        method=clock.method,
        bound_s=max(clock.bound_at_s(t) for t in ends_s),
        age_s=max((t - clock.at_s for t in ends_s), key=abs),
    )


def _common_warnings(rule: str, cameras: Sequence[CameraSync], reference: str) -> Iterator[str]:
    if len(cameras) < 2:
        return
    if rule == "none":
        yield (
            "nothing says which frames belong together, so that nothing is known in 3D: add timestamps.csv, or end the "
            "images' names with equal numbers"
        )
    methods = {camera.clock.method for camera in cameras if camera.clock}
    beside_reference = methods == {"video"}  # which is what video measures clocks by
    without = [c.camera_id for c in cameras if not c.clock and not (beside_reference and c.camera_id == reference)]
    if methods and without:
        yield (
            f"the stamps of {', '.join(without)} are taken as rig time, while other cameras have a clock model: "
            "measure every camera's clock (rigcal sync probe, or rigcal sync video)"
        )
    for camera in cameras:
        if rule in STAMPED and camera.alone == camera.frames:
            yield (
                f"{camera.camera_id}: none of its {camera.frames} frames is within half a frame of another camera's: "
                "check its stamps, and measure its clock (rigcal sync probe, or rigcal sync video)"
            )


def _camera_warnings(camera: CameraSync, pace: Pace | None, rule: str) -> Iterator[str]:
    name = camera.camera_id
    if camera.clock and pace and pace.period_s and camera.clock.bound_s > pace.period_s / 2:
        yield (
            f"{name}: its frames may be grouped with the wrong ones, because at the time of this capture its clock is "
            f"known to {1e3 * camera.clock.bound_s:.3g} ms only and half a frame is {500 * pace.period_s:.3g} ms. It "
            f"was measured {_age(camera.clock.age_s)} the capture: measure it from the capture (rigcal sync video)"
        )
    if pace and pace.steps:
        first = pace.steps[0]
        yield (
            f"{name}: its stamps jump by {1e3 * first.jump_s:.3g} ms at frame {first.at}, as they do where a clock is "
            "stepped or a camera restarts: one clock model cannot serve both sides, so split the capture there"
        )
    if pace and pace.missing and rule == "frame numbers":
        yield (
            f"{name}: {camera.missing} frames are missing after frame {pace.missing[0].after}, and instants count "
            "frames: from there on its frames are grouped with the wrong ones. Give their times in timestamps.csv"
        )


def _elsewhere(name: str) -> str:
    return (
        f"{name}: its clock model was not applied, because its stamps count from another epoch than the clock: stamp "
        "frames with seconds since 1970 (UTC)"
    )


def _counts(camera: CameraSync) -> str:
    known = "no stamps" if camera.missing is None else f"{camera.missing} missing, {camera.repeated} repeated"
    return f"{camera.frames} frames, {known}, {camera.alone} without a partner"


def _clock(clock: ClockState | None) -> str:
    if clock is None:
        return "no clock model applied"
    return f"clock by {clock.method}, within {1e3 * clock.bound_s:.3g} ms, measured {_age(clock.age_s)} the capture"


def _age(age_s: float) -> str:
    """``3 min before`` of a time from the measurement to the capture."""
    length = abs(age_s)
    number, unit = next(
        ((length / span, unit) for span, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")) if length >= span),
        (length, "s"),
    )
    return f"{number:.3g} {unit} {'before' if age_s >= 0 else 'after'}"
