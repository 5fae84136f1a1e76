"""Clocks in the rig file: each camera's model, what it was measured with, and the gate that turns it into metres.

A probe bounds the clock of a *host*. What a camera's stamps say also depends on its capture latency: a frame is stamped
``latency`` seconds after its mid-exposure, so ``t_rig = stamp + offset_of_host - latency``, and the bounds add up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np
from pydantic import JsonValue

from rigcal.amend import amended
from rigcal.rig import ClockModel
from rigcal.rigdocument import ClockEntry, GateEntry, RigDocument
from rigcal.site import GateLimits, Site
from rigcal.sync.content.lags import CameraLag, ContentLags

CLOCK_GATE = "clock_error_m"
EXTENSION = "clocks"
"""Below ``extensions.rigcal``: what each clock was measured with; no part of the geometry's digest."""


@dataclass(frozen=True, slots=True)
class Latency:
    """How long after mid-exposure of its centre row a camera stamps a frame."""

    latency_s: float
    bound_s: float
    """Half-width of the interval that holds the true latency."""
    source: str
    """``site file`` or ``video``."""


@dataclass(frozen=True, slots=True)
class CameraClock:
    """A camera's clock as it goes into the rig file."""

    camera_id: str
    model: ClockModel
    evidence: Mapping[str, JsonValue] = field(default_factory=dict)
    """What it was measured with: host, round trip, latency."""


@dataclass(frozen=True, slots=True)
class ClockLimits:
    """What a clock error is judged by."""

    fastest_motion_m_per_s: float
    clock_error_m: float
    """Fastest motion times clock error, at most."""

    @property
    def error_s(self) -> float:
        """The clock error that uses up the limit."""
        return self.clock_error_m / self.fastest_motion_m_per_s


def clock_limits(document: RigDocument, site: Site | None) -> ClockLimits:
    """The limits of the site file, else those that the rig file remembers of its own, else the defaults."""
    if site is not None:
        return ClockLimits(site.fastest_motion_m_per_s, site.gates.clock_error_m)
    kept = _entry(document, "site")
    default = Site.model_fields["fastest_motion_m_per_s"].default
    return ClockLimits(
        _number(kept.get("fastest_motion_m_per_s"), default),
        _number(kept.get(CLOCK_GATE), GateLimits().clock_error_m),
    )


def latency_of(document: RigDocument, site: Site | None, camera_id: str) -> Latency | None:
    """A camera's capture latency: from the site file, else as video once told it; None where nothing is known."""
    declared = site.camera(camera_id) if site else None
    if declared is not None and declared.capture_latency_s is not None:
        return Latency(declared.capture_latency_s, declared.capture_latency_bound_s or 0.0, "site file")
    kept = evidence_of_clock(document, camera_id).get("latency")
    if not isinstance(kept, dict):
        return None
    return Latency(_number(kept.get("latency_s"), 0.0), _number(kept.get("bound_s"), 0.0), str(kept.get("source")))


def evidence_of_clock(document: RigDocument, camera_id: str) -> dict[str, JsonValue]:
    """What the rig file remembers of the measurement of a camera's clock."""
    known = _entry(document, EXTENSION).get(camera_id)
    return known if isinstance(known, dict) else {}


def model_of(document: RigDocument, camera_id: str) -> ClockModel | None:
    """A camera's clock in the rig file."""
    entry = next((camera.clock for camera in document.cameras if camera.id == camera_id), None)
    return None if entry is None else ClockModel(**entry.model_dump())


def clock_of_host(host: ClockModel, latency: Latency | None) -> ClockModel:
    """The clock of a camera's stamps, from that of the host that makes them."""
    if latency is None:
        return host
    return replace(host, offset_s=host.offset_s - latency.latency_s, bound_s=host.bound_s + latency.bound_s)


def clocks_of_content(lags: ContentLags, document: RigDocument) -> tuple[CameraClock, ...]:
    """Clocks of the cameras that content decided, from lags between stamps that the rig file's clocks mapped already.

    The reference camera keeps its clock; where it has none, rig time is declared to be its own. Where a camera's host
    was probed, the difference between both is its capture latency, which later probes take into account.
    """
    reference = model_of(document, lags.reference)
    own = next(camera for camera in lags.cameras if camera.camera_id == lags.reference)
    if reference is None:
        reference = ClockModel(0.0, 0.0, utc_of(own.at_s), 0.0, 0.0, "declared")
    clocks = [CameraClock(lags.reference, reference, evidence_of_clock(document, lags.reference))]
    for lag in lags.cameras:
        if lag.confident and lag.camera_id != lags.reference:
            clocks.append(_clock_of_lag(lag, reference, lags, document))
    return tuple(clocks)


def _clock_of_lag(lag: CameraLag, reference: ClockModel, lags: ContentLags, document: RigDocument) -> CameraClock:
    model = corrected(model_of(document, lag.camera_id), lag, reference)
    evidence: dict[str, JsonValue] = {"content": lags.method, "relative_to": lags.reference}
    if lag.readout_s is not None:
        evidence["readout_s"] = lag.readout_s
    kept = evidence_of_clock(document, lag.camera_id)
    host = _host_model(kept)
    if host is not None:
        latency_s = host.rig_time_s(model.at_s) - model.rig_time_s(model.at_s)
        bound_s = model.bound_s + host.bound_at_s(model.at_s)
        evidence["latency"] = {"latency_s": latency_s, "bound_s": bound_s, "source": "video"}
    return CameraClock(lag.camera_id, model, kept | evidence)


def corrected(before: ClockModel | None, lag: CameraLag, reference: ClockModel) -> ClockModel:
    """A camera's clock with a lag that remained after the clock that it had.

    The drift that it had stays where the content is too short to know it better. The reference's own bound adds up.
    """
    had = before or ClockModel(0.0, 0.0, utc_of(lag.at_s), 0.0, np.inf, "declared")
    at_s = had.camera_time_s(lag.at_s)
    better = lag.drift_bound_ppm < had.drift_bound_ppm
    return ClockModel(
        offset_s=lag.at_s + lag.offset_s - at_s,
        drift_ppm=had.drift_ppm + (lag.drift_ppm if better else 0.0),
        at_utc=utc_of(at_s),
        bound_s=lag.bound_s + reference.bound_at_s(lag.at_s),
        drift_bound_ppm=min(lag.drift_bound_ppm, had.drift_bound_ppm) + reference.drift_bound_ppm,
        method="video",
    )


def entry_of(model: ClockModel) -> ClockEntry:
    """A clock as the rig file has it."""
    return ClockEntry.model_validate({name: getattr(model, name) for name in ClockEntry.model_fields})


def _host_model(evidence: Mapping[str, JsonValue]) -> ClockModel | None:
    kept = evidence.get("host_clock")
    return ClockModel(**ClockEntry.model_validate(kept).model_dump()) if isinstance(kept, dict) else None


def with_clocks(
    document: RigDocument, clocks: Sequence[CameraClock], limits: ClockLimits, *, command: str, utc: str
) -> RigDocument:
    """The rig file's content with these clocks: gates judged again, one more entry of history.

    Cameras that are not among ``clocks`` keep what they have.
    """
    new = {clock.camera_id: clock for clock in clocks}
    cameras = tuple(
        camera.model_copy(update={"clock": entry_of(new[camera.id].model)}) if camera.id in new else camera
        for camera in document.cameras
    )
    ours = document.extensions.get("rigcal")
    ours = ours if isinstance(ours, dict) else {}
    evidence = _entry(document, EXTENSION) | {name: dict(clock.evidence) for name, clock in new.items()}
    gates = tuple(gate for gate in document.gates if gate.name != CLOCK_GATE)
    changes = {
        "cameras": cameras,
        "gates": (*gates, *clock_gates({c.id: c.clock for c in cameras}, limits)),
        "extensions": document.extensions | {"rigcal": ours | {EXTENSION: evidence}},
    }
    return amended(document, changes, command=command, utc=utc)


def with_clocks_of(document: RigDocument, source: RigDocument, limits: ClockLimits) -> RigDocument:
    """A fresh calibration with the clocks of an older rig file, by which its instants were found."""
    known = ((camera_id, model_of(source, camera_id)) for camera_id in document.camera_ids)
    clocks = [CameraClock(c, model, evidence_of_clock(source, c)) for c, model in known if model is not None]
    carried = with_clocks(document, clocks, limits, command="calibrate", utc=document.created_utc)
    return carried.model_copy(update={"history": document.history})


def clock_gates(clocks: Mapping[str, ClockEntry | None], limits: ClockLimits) -> tuple[GateEntry, ...]:
    """The gate of every camera whose clock was measured: fastest motion times the clock's bound."""
    gates = []
    for camera_id, clock in clocks.items():
        if clock is not None:
            value = float(f"{limits.fastest_motion_m_per_s * clock.bound_s:.6g}")
            gates.append(
                GateEntry(
                    name=CLOCK_GATE,
                    camera=camera_id,
                    value=value,
                    limit=limits.clock_error_m,
                    passed=value <= limits.clock_error_m,
                    advice=_advice(camera_id, clock, limits),
                )
            )
    return tuple(gates)


def _advice(camera_id: str, clock: ClockEntry, limits: ClockLimits) -> str:
    far = f"the clock of {camera_id} is known to {1e3 * clock.bound_s:.1f} ms"
    enough = f"{1e3 * limits.error_s:.1f} ms are needed at {limits.fastest_motion_m_per_s:g} m/s"
    if clock.method == "video":
        return f"{far}, {enough}: record a board that moves faster and for longer, and run sync video again"
    return (
        f"{far}, {enough}: probe again by cable and without other traffic, or for longer; else measure from a moving "
        "board with sync video"
    )


def utc_of(t_s: float) -> str:
    """ISO 8601 UTC of seconds since the epoch, to the microsecond."""
    return datetime.fromtimestamp(t_s, UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def _entry(document: RigDocument, key: str) -> dict[str, JsonValue]:
    ours = document.extensions.get("rigcal")
    entry = ours.get(key) if isinstance(ours, dict) else None
    return entry if isinstance(entry, dict) else {}


def _number(value: JsonValue, otherwise: float) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else otherwise
