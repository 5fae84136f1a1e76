"""What is known of the clocks of a recording's cameras, as offsets over its time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.errors import NoExchangesError
from rigcal.geometry import Floats
from rigcal.rig import ClockModel
from rigcal.rigdocument import RigDocument
from rigcal.site import GateLimits, Site
from rigcal.stamps import match_camera_id
from rigcal.sync.content.lags import ContentLags
from rigcal.sync.estimator.track import ClockTrack, track_clock
from rigcal.sync.exchanges import Exchanges
from rigcal.sync.history.series import Method, OffsetSeries
from rigcal.sync.record import ClockLimits, Latency, clock_limits, clocks_of_content, latency_of, model_of, utc_of

NEAR_S = 600.0
"""Probes that all lie farther from a recording say nothing of it: as long as a clock is taken to keep its rate."""


@dataclass(frozen=True, slots=True)
class KnownClocks:
    """What a rig file, a site file, probes and pictures say of the clocks, for frames on a history's axis."""

    document: RigDocument | None
    site: Site | None
    log: Mapping[str, Exchanges] | None
    content: ContentLags | None
    epoch: bool
    """Whether stamps count from the Unix epoch; otherwise neither the rig file's clocks nor probes apply to them."""
    placed: bool
    """Whether the stamps are in rig time already."""
    zero_s: float
    """Time that the history counts from, in the stamps' own seconds."""

    @property
    def limits(self) -> ClockLimits:
        """What clock errors are judged by: as the site file says, else the rig file, else the defaults."""
        if self.document is not None:
            return clock_limits(self.document, self.site)
        if self.site is not None:
            return ClockLimits(self.site.fastest_motion_m_per_s, self.site.gates.clock_error_m)
        return ClockLimits(Site.model_fields["fastest_motion_m_per_s"].default, GateLimits().clock_error_m)

    def clock(self, camera_id: str) -> ClockModel | None:
        """The rig file's clock of a camera of the capture."""
        if self.document is None or not self.epoch:
            return None
        name = match_camera_id(camera_id, self.document.camera_ids)
        return model_of(self.document, name) if name else None

    def track(self, camera_id: str, start_s: float, end_s: float) -> ClockTrack | None:
        """The clock of a camera's host by the probes; None where there are none that can be, near these times."""
        name = match_camera_id(camera_id, list(self.log)) if self.log and self.epoch else None
        if self.log is None or name is None:
            return None
        try:
            track = track_clock(self.log[name])
        except NoExchangesError:
            return None
        probed_s = track.exchange_t_s
        near = ((probed_s > start_s - NEAR_S) & (probed_s < end_s + NEAR_S)).any()
        return track if near else None

    def latency(self, camera_id: str) -> Latency | None:
        """How late a camera stamps its frames."""
        if self.document is not None:
            return latency_of(self.document, self.site, camera_id)
        declared = self.site.camera(camera_id) if self.site else None
        if declared is None or declared.capture_latency_s is None:
            return None
        return Latency(declared.capture_latency_s, declared.capture_latency_bound_s or 0.0, "site file")

    def latency_unknown(self, camera_id: str, series: Sequence[OffsetSeries]) -> bool:
        """Whether what is known of a camera's clock is only that of its host."""
        methods, clock = {one.method for one in series}, self.clock(camera_id)
        by_probe = "probe" in methods or (clock is not None and clock.method == "probe")
        return by_probe and "video" not in methods and self.latency(camera_id) is None

    def declares(self, camera_id: str) -> bool:
        """Whether rig time is taken to be a camera's own: the one that pictures were compared with, without a clock."""
        return self.content is not None and camera_id == self.content.reference and self.clock(camera_id) is None

    def video_clock(self, camera_id: str) -> ClockModel | None:
        """What pictures say of a camera's clock, where they decide it."""
        lag = self.content.camera(camera_id) if self.content else None
        if self.content is None or lag is None or not lag.confident:
            return None
        if camera_id == self.content.reference and not self.declares(camera_id):
            return None
        if self.document is not None and self.epoch and camera_id != self.content.reference:
            found = clocks_of_content(self.content, self.document)
            return next(clock.model for clock in found if clock.camera_id == camera_id)
        at_utc = utc_of(lag.at_s)
        return ClockModel(lag.offset_s, lag.drift_ppm, at_utc, lag.bound_s, lag.drift_bound_ppm, "video")

    def series(self, camera_id: str, track: ClockTrack | None, times_s: Floats) -> tuple[OffsetSeries, ...]:
        """What is known of a camera's clock at times of the history."""
        found = []
        if track is not None:
            found.append(_of_frames(track.offset_series(times_s), self.latency(camera_id)))
        models: dict[Method, ClockModel | None] = {
            "video": self.video_clock(camera_id),
            "rig file": self.clock(camera_id),
        }
        found += [_model_series(method, model, times_s, self.zero_s) for method, model in models.items() if model]
        return tuple(found)


def _of_frames(host: OffsetSeries, latency: Latency | None) -> OffsetSeries:
    """The offset of a camera's stamps, from that of the host that makes them."""
    if latency is None:
        return host
    return replace(host, offset_s=host.offset_s - latency.latency_s, bound_s=host.bound_s + latency.bound_s)


def _model_series(method: Method, clock: ClockModel, times_s: Floats, zero_s: float) -> OffsetSeries:
    """A clock model at times of the history; as a function of rig time, without the digits that a difference loses."""
    rate, since_s = clock.drift_ppm * 1e-6, times_s + zero_s - clock.at_s - clock.offset_s
    offset_s = clock.offset_s + rate * since_s / (1 + rate)
    return OffsetSeries(method, times_s, offset_s, clock.bound_s + clock.drift_bound_ppm * 1e-6 * np.abs(since_s))
