"""Which requests are on their way, and what becomes of every packet that arrives.

An answer counts where its origin timestamp is the nonce of a request that waits, and it came from the address and
port that the request went to. A late answer counts too: that no packet arrives before it was sent holds for it as for
any other, its interval of the offset is only wider.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

from rigcal.sync.network.packet import read_answer
from rigcal.sync.network.session import Asked, Door, Session
from rigcal.sync.network.sockets import Address, Datagram, written


class Ledger:
    """The requests of a probe."""

    def __init__(self, sessions: Iterable[Session], timeout_ns: int) -> None:
        self._timeout_ns = timeout_ns
        self._open: dict[bytes, Asked] = {}
        self._answered: dict[bytes, Asked] = {}
        self._sessions: dict[tuple[str, int], Session] = {}
        self._doors: dict[tuple[str, int], list[Door]] = {}
        for session in sessions:
            for door in session.doors:
                self._sessions.setdefault(_peer(door.address), session)
                self._doors.setdefault(_peer(door.address), []).append(door)

    def note(self, nonce: bytes, session: Session, door: Door, sent_ns: int) -> None:
        """A request left."""
        self._open[nonce] = Asked(session, door, door.sent, sent_ns)
        door.sent += 1

    def unreachable(self, destination: Address, code: int) -> None:
        """A request did not arrive: ICMP says so."""
        for door in self._doors.get(_peer(destination), ()):
            door.error = code

    def unusable(self, family: int, code: int | None) -> None:
        """This machine has no sockets of that family."""
        for doors in self._doors.values():
            for door in doors:
                if door.family == family:
                    door.error = code

    def waiting(self) -> bool:
        """Whether a host that has answered still owes an answer that would be in time."""
        since_ns = time.time_ns() - self._timeout_ns
        return any(asked.door.rows and asked.sent_ns > since_ns for asked in self._open.values())

    def take(self, datagram: Datagram, realtime_ns: int, monotonic_ns: int) -> None:
        """A packet arrived; both clocks were read just now, the monotonic one for what it read at the arrival."""
        peer = _peer(datagram.sender)
        answer = read_answer(datagram.data)
        if answer is None:
            if peer in self._sessions:
                self._sessions[peer].malformed += 1
            return
        asked = self._open.get(answer.nonce)
        if asked is None:
            self._unasked(answer.nonce, peer)
        elif _peer(asked.door.address) != peer:
            asked.session.spoofed += 1
            asked.session.elsewhere = written(*peer)
        else:
            self._answered[answer.nonce] = self._open.pop(answer.nonce)
            asked.door.late += datagram.arrived_ns - asked.sent_ns > self._timeout_ns
            arrived_monotonic_ns = monotonic_ns - (realtime_ns - datagram.arrived_ns)
            asked.session.accept(asked, answer, datagram.arrived_ns, arrived_monotonic_ns)

    def _unasked(self, nonce: bytes, peer: tuple[str, int]) -> None:
        """A packet that answers no request which waits: a copy of an answer, or nobody's."""
        earlier = self._answered.get(nonce)
        if earlier is not None and _peer(earlier.door.address) == peer:
            earlier.session.duplicates += 1
        elif peer in self._sessions:
            self._sessions[peer].spoofed += 1


def _peer(address: Address) -> tuple[str, int]:
    """Host and port, without the flow and scope that differ from one direction to the other."""
    return address[0], address[1]
