"""A host while it is being probed: where it is asked, what came back, and which of its ports to go on with."""

from __future__ import annotations

import socket
from dataclasses import dataclass, field
from typing import NamedTuple

from rigcal.sync.exchanges import UNKNOWN
from rigcal.sync.network.hosts import Target
from rigcal.sync.network.packet import NTP_PORT, RIGCAL_PORT, Answer, Claim
from rigcal.sync.network.resolving import Addresses
from rigcal.sync.network.sockets import Address

SETTLE_S = 0.5
"""How long our own responder may take before a plain NTP server of the same host will do: five requests at 10 Hz."""
RATE_KISS_S = 2.0
"""Least time between requests to a host that asked for fewer: ntpd's own least interval, its ``discard minimum``."""
_PORT = 1


@dataclass(slots=True, eq=False)
class Door:
    """One way of asking a host: an address and port, in plain NTP or with our extension."""

    family: int
    address: Address
    extended: bool
    rows: list[tuple[int, ...]] = field(default_factory=list)
    """Answers: the number of the request, and the columns of :class:`Exchanges`."""
    sent: int = 0
    late: int = 0
    claim: Claim | None = None
    error: int | None = None
    """Why requests do not arrive, as an error number; None since the last answer."""

    @property
    def port(self) -> int:
        """The port that is asked."""
        return int(self.address[_PORT])

    @property
    def ours(self) -> bool:
        """Whether our own responder answers here."""
        return bool(self.rows) and self.rows[0][-1] != UNKNOWN


class Asked(NamedTuple):
    """A request that was sent."""

    session: Session
    door: Door
    number: int
    """Counted at its door."""
    sent_ns: int
    """T1, kept here: the request itself carries a nonce."""


@dataclass(slots=True, eq=False)
class Session:
    """One host while it is being probed."""

    target: Target
    doors: tuple[Door, ...]
    unresolved: str | None = None
    """Why the host has no address."""
    chosen: Door | None = None
    interval_s: float = 0.0
    """Least time between requests; 0 until the host asks for fewer."""
    not_before_s: float = 0.0
    """When it may be asked next."""
    denied: bool = False
    duplicates: int = 0
    spoofed: int = 0
    malformed: int = 0
    kisses: set[str] = field(default_factory=set)
    elsewhere: str | None = None
    """An address and port that answered requests which were sent to another."""

    def due(self, now_s: float, since_start_s: float) -> tuple[Door, ...]:
        """Where to ask now; the port is settled on here, once enough has been heard."""
        if self.denied or now_s < self.not_before_s:
            return ()
        self.not_before_s = now_s + self.interval_s
        if self.chosen is None:
            self.settle(since_start_s)
        return self.doors if self.chosen is None else (self.chosen,)

    def settle(self, since_start_s: float) -> None:
        """Choose our own responder as soon as it answers, plain NTP once ours had its time or is known to be absent."""
        self.chosen = next((door for door in self.doors if door.ours), None)
        waiting = since_start_s < SETTLE_S and any(door.extended and door.error is None for door in self.doors)
        if self.chosen is None and not waiting:
            answered = [door for door in self.doors if door.rows]
            self.chosen = min(answered, key=lambda door: door.extended, default=None)

    def accept(self, asked: Asked, answer: Answer, returned_ns: int, monotonic_ns: int) -> None:
        """Keep the answer to a request of this host."""
        door = asked.door
        door.error = None
        if answer.kiss is not None:
            self._obey(answer.kiss)
            return
        door.claim = answer.claim
        host_ns = (answer.received_ns, answer.replied_ns)
        door.rows.append((asked.number, asked.sent_ns, *host_ns, returned_ns, monotonic_ns, answer.monotonic_ns))

    def _obey(self, kiss: str) -> None:
        """Slow down, or stop (RFC 5905, section 7.4)."""
        self.kisses.add(kiss)
        if kiss == "RATE":
            self.interval_s = max(2 * self.interval_s, RATE_KISS_S)
            self.not_before_s += self.interval_s
        else:
            self.denied = True


def open_session(target: Target, addresses: Addresses | str) -> Session:
    """A host that nothing was asked yet."""
    if isinstance(addresses, str):
        return Session(target, (), addresses)
    doors = [_doors(family, address, target.port) for family, address in addresses]
    return Session(target, tuple(door for each in doors for door in each), None if doors else "it has no address")


def _doors(family: int, address: Address, port: int | None) -> tuple[Door, ...]:
    """Where and how to ask: without a port, ours and NTP's; at another port than NTP's, ours or NTP may answer."""
    if port is None:
        ways = [(RIGCAL_PORT, True), (NTP_PORT, False)]
    elif port == NTP_PORT:
        ways = [(NTP_PORT, False)]
    else:
        ways = [(port, True), (port, False)]
    return tuple(Door(family, _at(family, address, number), extended) for number, extended in ways)


def _at(family: int, address: Address, port: int) -> Address:
    if family == socket.AF_INET6 and len(address) == 4:
        return (address[0], port, 0, address[3])
    return (address[0], port)
