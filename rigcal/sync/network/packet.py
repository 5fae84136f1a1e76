"""The NTP packet (RFC 5905, section 7.3) as a probe and its answer, and the extension field of our own responder.

Decision: the probe speaks NTP rather than a format of its own, so that a host with chronyd or ntpd needs nothing of
ours. What NTP cannot say, the host's monotonic clock, rides in an extension field (RFC 7822), and only to those who
sent one themselves: a plain server never meets it, and no answer is longer than its request.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

from rigcal.sync.exchanges import UNKNOWN

NTP_PORT = 123
"""Where chronyd and ntpd answer; below 1024, so that it takes a privileged process to serve there."""
RIGCAL_PORT = 12123
"""Where ``rigcal sync serve`` answers unless told otherwise."""

NONCE_BYTES = 8
"""What a request carries as its transmit timestamp."""

CLIENT, SERVER = 3, 4
"""Modes of a request and of its answer."""
UNSYNCHRONISED_LEAP = 3
UNSYNCHRONISED_STRATUM = 16
"""Written as 0 on the wire (RFC 5905, figure 11)."""
KISSES = {b"RATE": "RATE", b"DENY": "DENY", b"RSTR": "RSTR"}
"""Kiss codes that ask something of the asker (RFC 5905, section 7.4); they come instead of the time."""

_HEADER = struct.Struct("!BBbbII4sQQ8sQ")
_ANSWER = struct.Struct("!BBbbII4sQ8sQQ")
_EXTENSION = struct.Struct("!HH8sq8x")
_EXTENSION_TYPE = 0xF7C1
"""From the range that is set aside for experiments, 0xF000 to 0xFFFF."""
_EXTENSION_NAME = b"rigcal\x00\x01"
_EPOCH_S = 2_208_988_800
"""From 1900, where NTP's era 0 begins, to 1970."""
_HALF_ERA = 1 << 63
_OUR_PRECISION = -20
"""log2 of the seconds that two readings of the clock differ by: a microsecond, in an interpreted program."""


def ntp_from_ns(unix_ns: int) -> int:
    """A 64-bit NTP timestamp (32.32 fixed point, the era left out) of nanoseconds since the Unix epoch."""
    return ((((unix_ns << 32) + 500_000_000) // 1_000_000_000) + (_EPOCH_S << 32)) & 0xFFFF_FFFF_FFFF_FFFF


def ns_from_ntp(timestamp: int) -> int:
    """Nanoseconds since the Unix epoch of an NTP timestamp between 1968 and 2104: era 1 begins in February 2036."""
    era = 0 if timestamp & _HALF_ERA else 1 << 64
    return (((timestamp + era - (_EPOCH_S << 32)) * 1_000_000_000) + (1 << 31)) >> 32


@dataclass(frozen=True, slots=True)
class Claim:
    """What a host says of its own clock."""

    leap: int
    """0 to 2: synchronised (1 and 2 announce a leap second); 3: not synchronised."""
    stratum: int
    """Hops from a reference clock, 1 to 15; 16: not synchronised."""
    root_delay_s: float
    root_dispersion_s: float

    @property
    def synchronised(self) -> bool:
        """Whether the host says that something disciplines its clock."""
        return self.leap != UNSYNCHRONISED_LEAP and self.stratum < UNSYNCHRONISED_STRATUM

    @property
    def error_s(self) -> float | None:
        """Its own bound against UTC, half the root delay and the root dispersion; None where it claims none."""
        return self.root_delay_s / 2 + self.root_dispersion_s if self.synchronised else None


UNSYNCHRONISED = Claim(UNSYNCHRONISED_LEAP, UNSYNCHRONISED_STRATUM, 0.0, 0.0)
"""A host that knows nothing of how right its clock is, and says so."""


class Request(NamedTuple):
    """A request, as a responder reads it."""

    version: int
    poll: int
    nonce: bytes
    """Its transmit timestamp; the answer returns it as its origin timestamp."""
    extended: bool
    """Whether it carries our extension field, and so has room for it in the answer."""


class Answer(NamedTuple):
    """An answer, as a probe reads it."""

    leap: int
    stratum: int
    """16 where the packet says 0."""
    root_delay_s: float
    root_dispersion_s: float
    kiss: str | None
    """A kiss code, in place of the time."""
    nonce: bytes
    """Its origin timestamp: the transmit timestamp of the request that it answers."""
    received_ns: int
    """T2, by the host's clock."""
    replied_ns: int
    """T3, by the host's clock."""
    monotonic_ns: int
    """The host's monotonic clock at T3; ``UNKNOWN`` from a plain NTP server."""

    @property
    def claim(self) -> Claim:
        """What the host says of its own clock."""
        return Claim(self.leap, self.stratum, self.root_delay_s, self.root_dispersion_s)


_PLAIN_REQUEST = bytes([(4 << 3) | CLIENT]) + bytes(39)
_REQUEST_EXTENSION = _EXTENSION.pack(_EXTENSION_TYPE, _EXTENSION.size, _EXTENSION_NAME, 0)


def write_request(nonce: bytes, *, extended: bool) -> bytes:
    """A request that tells nothing of the asker.

    Its transmit timestamp is a nonce of 8 bytes and every other field is zero, as the working group's draft on data
    minimisation for NTP clients has it and as chrony does: who cannot read the request cannot forge the answer.
    """
    return _PLAIN_REQUEST + nonce + (_REQUEST_EXTENSION if extended else b"")


def read_request(data: bytes) -> Request | None:
    """A request for the time; None where the packet is none: too short, another mode, an unknown version."""
    if len(data) < _HEADER.size:
        return None
    version, mode = (data[0] >> 3) & 7, data[0] & 7
    if mode != CLIENT or not 1 <= version <= 4:
        return None
    poll = int.from_bytes(data[2:3], "big", signed=True)
    return Request(version, poll, data[40:48], _monotonic(data) is not None)


def write_answer(request: Request, claim: Claim, received_ns: int, replied_ns: int, monotonic_ns: int) -> bytes:
    """The answer to a request: as long as what was asked, T2 and T3 in nanoseconds since the Unix epoch."""
    header = _ANSWER.pack(
        claim.leap << 6 | request.version << 3 | SERVER,
        claim.stratum if claim.synchronised else 0,
        request.poll,
        _OUR_PRECISION,
        _short(claim.root_delay_s),
        _short(claim.root_dispersion_s),
        bytes(4) if claim.synchronised else b"INIT",
        0,
        request.nonce,
        ntp_from_ns(received_ns),
        ntp_from_ns(replied_ns),
    )
    if not request.extended:
        return header
    return header + _EXTENSION.pack(_EXTENSION_TYPE, _EXTENSION.size, _EXTENSION_NAME, monotonic_ns)


def read_answer(data: bytes) -> Answer | None:
    """An answer; None where the packet is none, or tells no time without being a kiss."""
    if len(data) < _ANSWER.size or data[0] & 7 != SERVER:
        return None
    first, stratum, _, _, delay, dispersion, reference, _, nonce, received, replied = _ANSWER.unpack_from(data)
    kiss = KISSES.get(reference) if stratum == 0 else None
    if kiss is None and (received == 0 or replied == 0):
        return None
    monotonic_ns = _monotonic(data)
    return Answer(
        first >> 6,
        stratum or UNSYNCHRONISED_STRATUM,
        delay / 65536,
        dispersion / 65536,
        kiss,
        nonce,
        ns_from_ntp(received),
        ns_from_ntp(replied),
        UNKNOWN if monotonic_ns is None else monotonic_ns,
    )


def _monotonic(data: bytes) -> int | None:
    """What our extension field holds; None where the packet has none."""
    if len(data) < _ANSWER.size + _EXTENSION.size:
        return None
    kind, length, name, monotonic_ns = _EXTENSION.unpack_from(data, _ANSWER.size)
    ours = kind == _EXTENSION_TYPE and length == _EXTENSION.size and name == _EXTENSION_NAME
    return int(monotonic_ns) if ours else None


def _short(seconds: float) -> int:
    """NTP's short format, 16.16 fixed point, rounded up because it is a bound."""
    return min(math.ceil(seconds * 65536), 0xFFFF_FFFF)
