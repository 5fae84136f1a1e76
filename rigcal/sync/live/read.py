"""One live source, read packet by packet on a thread of its own; nothing is decoded."""

from __future__ import annotations

import struct
import threading
import time
from dataclasses import dataclass, field

import av
import av.error

from rigcal.sync.exchanges import UNKNOWN
from rigcal.sync.live.words import failure, is_live

CONNECT_S = 5.0
"""Opening a stream takes a second on loopback; this is five times as much."""
SILENT_S = 2.0
"""A source that sends nothing for so long has stalled: sixty frames at 30 fps."""
_PREFER_TCP = {"rtsp_transport": "tcp", "rtsp_flags": "prefer_tcp"}
_PRODUCER_TIME = struct.Struct("<q")
"""AVProducerReferenceTime starts with microseconds since the epoch."""


@dataclass(slots=True)
class Received:
    """What has come of a source so far; written by its thread, read by the one that waits."""

    size_wh: tuple[int, int] | None = None
    codec: str = ""
    declared_fps: float | None = None
    clock_hz: float = 90_000.0
    packets: list[tuple[float, float, int, int, int]] = field(default_factory=list)
    """Presentation and decoding time in seconds; arrival, monotonic and realtime, and producer time in nanoseconds."""
    trouble: str = ""
    ended: threading.Event = field(default_factory=threading.Event)


def read_source(url: str, received: Received, stop: threading.Event, *, seconds: float) -> None:
    """Read a source until told to stop, until its end, or until it fails; for a thread."""
    connect_s, silent_s = min(CONNECT_S, seconds), min(SILENT_S, seconds)
    try:
        options = _PREFER_TCP if url.startswith("rtsp") else {}
        with av.open(url, options=options, timeout=(connect_s, silent_s)) as container:
            if not container.streams.video:
                received.trouble = "it carries no video"
                return
            _read(container, received, stop, live=is_live(url))
    except av.error.ExitError as error:
        count = len(received.packets)
        stalled = f"it sends nothing for {silent_s:.3g} s after frame {count - 1}"
        received.trouble = stalled if count else failure(error, waited_s=connect_s)
    except av.error.FFmpegError as error:
        received.trouble = failure(error, waited_s=connect_s)
    finally:
        received.ended.set()


def _read(container: av.container.InputContainer, received: Received, stop: threading.Event, *, live: bool) -> None:
    stream = container.streams.video[0]
    declared = (stream.codec_context.framerate if live else None) or stream.average_rate
    received.declared_fps = float(declared) if declared else None
    received.size_wh, received.codec = (stream.width, stream.height), stream.codec_context.name
    received.clock_hz = 1 / float(stream.time_base) if stream.time_base else received.clock_hz
    for packet in container.demux(stream):
        monotonic_ns, realtime_ns = time.monotonic_ns(), time.time_ns()
        if packet.pts is not None and packet.time_base is not None:
            stamp_s = float(packet.pts * packet.time_base)
            decoded_s = stamp_s if packet.dts is None else float(packet.dts * packet.time_base)
            received.packets.append((stamp_s, decoded_s, monotonic_ns, realtime_ns, _producer_ns(packet)))
        if stop.is_set():
            return
    if live:
        received.trouble = f"it ended after {len(received.packets)} frames"


def _producer_ns(packet: av.Packet[av.VideoStream]) -> int:
    if not packet.has_sidedata("prft"):
        return UNKNOWN
    return int(_PRODUCER_TIME.unpack_from(bytes(packet.get_sidedata("prft")))[0]) * 1000
