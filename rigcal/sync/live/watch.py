"""Live sources, watched for a while: rate, stamps and delays of every camera before a recording starts.

Each source is read on a thread of its own, as packets, so that thirty-two cameras cost little and a dead one holds up
nobody. Where a camera tells when it took its frames (RTCP sender reports, producer reference times), these are its
stamps; where not, the times of arrival are, which are late by a frame and more and scatter by milliseconds.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigcal.errors import OptionError
from rigcal.geometry import Floats, Ints, freeze
from rigcal.sync.live.clock import came_when_sent, producer_stamps
from rigcal.sync.live.read import Received, read_source
from rigcal.sync.live.words import is_live, shown_address

_LOOK_S = 0.1
"""How often the sources are looked after while they are watched."""


@dataclass(frozen=True, slots=True, eq=False)
class SourceWatch:
    """What a camera sent while it was watched."""

    camera_id: str
    address: str
    """Where it was watched, without user and password."""
    size_wh: tuple[int, int] | None
    """Width and height in pixels; None where no stream was found."""
    codec: str
    declared_fps: float | None
    """What the stream says of its frame rate; None where it says nothing."""
    stamp_source: Literal["producer", "arrival", "presentation times"]
    """``producer``: the camera's own clock; ``presentation times``: a file's, which count from its first frame."""
    t_s: Floats
    """(n,) stamps in seconds, since the epoch unless presentation times, in the order in which the frames came."""
    stream_s: Floats
    """(n,) presentation times."""
    arrival_monotonic_ns: Ints
    """(n,) when they came, by a clock that is never stepped."""
    arrival_realtime_ns: Ints
    """(n,) when they came, UTC by this computer's clock."""
    producer_ns: Ints
    """(n,) when the camera says that it took them, UTC, as last reported; ``UNKNOWN`` (-1) where it does not say."""
    trouble: str
    """What is wrong, in words for the user; empty where nothing is."""

    def __post_init__(self) -> None:
        count = len(self.t_s)
        freeze(self, np.float64, t_s=(count,), stream_s=(count,))
        freeze(self, np.int64, arrival_monotonic_ns=(count,), arrival_realtime_ns=(count,), producer_ns=(count,))

    @property
    def arrived_fps(self) -> float | None:
        """Frames per second as they came, missing ones not counted; None below two frames, and for files.

        Frames that were held back while the source was opened, and came in one burst, do not count.
        """
        came_ns = self.arrival_monotonic_ns[came_when_sent(self.stream_s, self.arrival_monotonic_ns)]
        if len(came_ns) < 2 or self.stamp_source == "presentation times":
            return None
        return (len(came_ns) - 1) / (float(np.ptp(came_ns)) * 1e-9)

    @property
    def delay_s(self) -> float | None:
        """Median time from a frame's stamp to its arrival, both clocks' errors included; None for other stamps."""
        if self.stamp_source != "producer" or not len(self.t_s):
            return None
        return float(np.median(self.arrival_realtime_ns * 1e-9 - self.t_s))


def watch_sources(
    sources: Mapping[str, str], *, seconds: float, progress: Callable[[int, int], None] | None = None
) -> tuple[SourceWatch, ...]:
    """Watch all sources at once, for so many seconds in all; files are read to their end.

    Args:
        sources: Camera identifier -> address (``rtsp://``, ``http://`` ...) or path of a video.
        seconds: How long, connecting included; no source makes it longer.
        progress: Called with the seconds passed and the seconds in all.

    Returns:
        One per source, in the order given; one that failed says why in ``trouble``.

    Raises:
        OptionError: where ``seconds`` is not above 0.
    """
    if not seconds > 0:
        raise OptionError("seconds", expected="a time above 0", got=seconds)
    received = {camera_id: Received() for camera_id in sources}
    stop = threading.Event()
    for camera_id, url in sources.items():
        threading.Thread(
            target=read_source, args=(url, received[camera_id], stop), kwargs={"seconds": seconds}, daemon=True
        ).start()
    _wait(received, seconds, progress)
    stop.set()
    return tuple(_watched(camera_id, url, received[camera_id], seconds) for camera_id, url in sources.items())


def _wait(received: Mapping[str, Received], seconds: float, progress: Callable[[int, int], None] | None) -> None:
    """Until time is up, or every source has ended."""
    start_s, total = time.monotonic(), math.ceil(seconds)
    while (passed_s := time.monotonic() - start_s) < seconds:
        if progress is not None:
            progress(int(passed_s), total)
        alive = [one for one in received.values() if not one.ended.is_set()]
        if not alive:
            break
        alive[0].ended.wait(min(_LOOK_S, seconds - passed_s))
    if progress is not None:
        progress(total, total)


def _watched(camera_id: str, url: str, received: Received, seconds: float) -> SourceWatch:
    packets = received.packets[:]  # its thread may still be writing
    trouble = received.trouble
    if not packets and not trouble and not received.ended.is_set():
        trouble = f"it does not answer within {seconds:.3g} s"
    stream_s, decoded_s, producer_ns = (np.array([p[i] for p in packets]) for i in (0, 1, 4))
    monotonic_ns, realtime_ns = (np.array([p[i] for p in packets], dtype=np.int64) for i in (2, 3))
    order = np.arange(len(packets))
    if np.any(stream_s != decoded_s):  # frames that refer to later ones come after them
        order = np.argsort(stream_s, kind="stable")
    source: Literal["producer", "arrival", "presentation times"] = "presentation times"
    t_s = stream_s
    if is_live(url):
        told_s = producer_stamps(stream_s, producer_ns.astype(np.int64), clock_hz=received.clock_hz)
        source, t_s = ("arrival", _unstepped_s(monotonic_ns, realtime_ns)) if told_s is None else ("producer", told_s)
        if told_s is None:
            order = order[came_when_sent(stream_s, monotonic_ns)[order]]
    return SourceWatch(
        camera_id,
        shown_address(url),
        received.size_wh,
        received.codec,
        received.declared_fps,
        source,
        t_s[order],
        stream_s[order],
        monotonic_ns[order],
        realtime_ns[order],
        producer_ns[order],
        trouble,
    )


def _unstepped_s(monotonic_ns: Ints, realtime_ns: Ints) -> Floats:
    """Times of arrival, UTC; a step of this computer's clock on the way is not the camera's."""
    if not len(monotonic_ns):
        return np.zeros(0)
    return np.asarray((monotonic_ns + int(np.median(realtime_ns - monotonic_ns))) * 1e-9)
