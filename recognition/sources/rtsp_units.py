"""The access units of an opened RTSP session, put together from its fragments.

Decision: FFmpeg's parser is switched off (``noparse``), and fragments of one RTP time are joined here. With the
parser, the first packet that bears a sender report bears the next frame's time (measured: one frame late), and the
first packet of all bears none; without it every fragment has its own. Both know that a frame is whole when the next
one begins: one frame period of delay, while the time of arrival is that of the frame's own last fragment.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from av.container import InputContainer
from av.error import FFmpegError
from av.packet import Packet
from av.video.stream import VideoStream

from recognition.h264 import IDR, PPS, SPS, nal_types, parameter_sets, with_parameter_sets

_REFERENCE = struct.Struct("=q")
"""AVProducerReferenceTime: microseconds since 1970; then flags."""
_REPORT = struct.Struct("=8xQ")
"""AVRTCPSenderReport: source and padding; the camera's wall clock in NTP's form; then the media clock and counts."""


class AccessUnit(NamedTuple):
    """One frame as it was sent."""

    media_ns: int
    """Time of the session's media clock."""
    receive_ns: int
    """When its last fragment arrived: this machine's clock."""
    wall_ns: int | None
    """The camera's wall clock at the same moment, where a sender report came with the frame."""
    encoded: bytes
    """Annex B; a key frame has its parameter sets, from the session's description where the camera sends none."""
    is_key: bool
    """Whether decoding can begin here."""


class _Fragments:
    """An access unit that is being put together."""

    def __init__(self, ticks: int | None) -> None:
        self.ticks = ticks
        self.pieces: list[bytes] = []
        self.receive_ns = 0
        self.wall_ns: int | None = None

    def add(self, fragment: Packet[VideoStream]) -> None:
        self.pieces.append(bytes(fragment))
        self.receive_ns = time.time_ns()
        if fragment.has_sidedata("rtcp_sr") and fragment.has_sidedata("prft"):
            (ntp,) = _REPORT.unpack_from(bytes(fragment.get_sidedata("rtcp_sr")))
            if ntp:  # 0: a camera without a wall clock
                (wall_us,) = _REFERENCE.unpack_from(bytes(fragment.get_sidedata("prft")))
                self.wall_ns = wall_us * 1000


def access_units(
    container: InputContainer, stream: VideoStream, is_closing: Callable[[], bool]
) -> Iterator[AccessUnit]:
    """The access units of a session, until it ends or ``is_closing`` says so.

    Raises:
        FFmpegError: as PyAV raises it where the session breaks; what had arrived was handed on before.
    """
    base = stream.time_base
    if base is None:
        raise ValueError("an RTP stream without a time base")
    sets = parameter_sets(stream.codec_context.extradata or b"")
    for unit in _joined(container, stream, is_closing):
        encoded = b"".join(unit.pieces)
        types = nal_types(encoded)
        if SPS in types and PPS in types:
            sets = parameter_sets(encoded)
        elif IDR in types:
            encoded = with_parameter_sets(encoded, sets)
        media_ns = (unit.ticks or 0) * base.numerator * 10**9 // base.denominator
        yield AccessUnit(media_ns, unit.receive_ns, unit.wall_ns, encoded, IDR in types and bool(sets))


def _joined(container: InputContainer, stream: VideoStream, is_closing: Callable[[], bool]) -> Iterator[_Fragments]:
    unit: _Fragments | None = None
    try:
        for fragment in container.demux(stream):
            if is_closing():
                return
            if not fragment.size:
                continue
            if unit is None or fragment.pts != unit.ticks:
                if unit:
                    yield unit
                unit = _Fragments(fragment.pts)
            unit.add(fragment)
    except FFmpegError:
        if unit:
            yield unit
        raise
    if unit:
        yield unit
