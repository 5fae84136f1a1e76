"""Asking hosts for their time, all at once: one thread, one socket per address family.

Decision: hosts are asked in turn, a few together in slots of 25 ms, because waking up costs a program more than asking
does: 32 hosts at 10 Hz took 7 % of a core one by one and 2.5 % eight by eight, on the loopback network. A handful of
packets passes a switch in microseconds. Who goes first changes from round to round, and every round is shifted by up
to a tenth of its length, because a period that divides a camera's would meet the bursts of its video in the same place
each time. A slow or dead host costs its own requests and nothing else.
"""

from __future__ import annotations

import os
import selectors
import socket
import time
from collections.abc import Callable, Sequence

from rigcal.errors import OptionError
from rigcal.sync.network.clocks import SYSTEM, read_both_ns
from rigcal.sync.network.hostprobe import HostProbe
from rigcal.sync.network.hosts import Target
from rigcal.sync.network.ledger import Ledger
from rigcal.sync.network.outcome import outcome_of
from rigcal.sync.network.packet import NONCE_BYTES, write_request
from rigcal.sync.network.resolving import resolve
from rigcal.sync.network.session import Door, Session, open_session
from rigcal.sync.network.sockets import hear_errors, open_udp, receive, send_errors

SECONDS, RATE_HZ, TIMEOUT_S = 10.0, 10.0, 1.0
_GREATEST_RATE_HZ = 200.0
_SLOT_S = 0.025
_GOLDEN = 0.618_033_988_75
_SHIFT = 0.1
"""Of a round's length, to either side."""
_LAST_WAIT_S = 0.05
"""How often it is looked whether the last answers are in."""


def probe(
    targets: Sequence[Target],
    *,
    seconds: float = SECONDS,
    rate_hz: float = RATE_HZ,
    timeout_s: float = TIMEOUT_S,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[HostProbe, ...]:
    """Ask every host for its time, again and again, and keep the four times of each exchange.

    Blocks for ``seconds`` and at most ``timeout_s`` more, after names were looked up (at most 3 s). It never fails
    because of a host: what went wrong with one is in its :class:`HostProbe`. It is meant for hosts of one's own
    network; a public server must not be asked this often.

    Args:
        targets: the hosts.
        seconds: how long.
        rate_hz: requests per second to each host.
        timeout_s: from when on an answer counts as late, and how long the last answers are waited for.
        progress: called with the rounds of requests that are done, and with all of them.

    Raises:
        OptionError: where a number is out of range.
    """
    _positive("seconds", seconds)
    _positive("timeout_s", timeout_s)
    if not 0 < rate_hz <= _GREATEST_RATE_HZ:
        raise OptionError("rate_hz", expected=f"more than 0 and at most {_GREATEST_RATE_HZ:g} per second", got=rate_hz)
    found = resolve(target.host for target in targets)
    sessions = tuple(open_session(target, found[target.host]) for target in targets)
    if sessions:
        with _Prober(sessions, timeout_s) as prober:
            prober.run(max(1, round(seconds * rate_hz)), 1 / rate_hz, progress)
    return tuple(outcome_of(session) for session in sessions)


def _positive(name: str, value: float) -> None:
    if not 0 < value < float("inf"):
        raise OptionError(name, expected="more than 0 seconds", got=value)


def _shift(number: int) -> float:
    """Of a round's length: an irregular sequence that covers its range evenly, and begins at 0."""
    return _SHIFT * (2 * ((number * _GOLDEN + 0.5) % 1) - 1)


class _Prober:
    """The sockets of a probe."""

    def __init__(self, sessions: tuple[Session, ...], timeout_s: float) -> None:
        self._sessions = sessions
        self._timeout_s = timeout_s
        self._ledger = Ledger(sessions, round(timeout_s * 1e9))
        self._selector = selectors.DefaultSelector()
        self._sockets: dict[int, socket.socket] = {}

    def __enter__(self) -> _Prober:
        for family in {door.family for session in self._sessions for door in session.doors}:
            try:
                sock = open_udp(family)
            except OSError as error:
                self._ledger.unusable(family, error.errno)
                continue
            hear_errors(sock)
            self._sockets[family] = sock
            self._selector.register(sock, selectors.EVENT_READ, sock)
        return self

    def __exit__(self, *_: object) -> None:
        self._selector.close()
        for sock in self._sockets.values():
            sock.close()

    def run(self, rounds: int, round_s: float, progress: Callable[[int, int], None] | None) -> None:
        """Ask every host once a round, and wait for the last answers."""
        start_s = time.monotonic()
        slots = max(1, min(len(self._sessions), int(round_s / _SLOT_S)))
        for number in range(rounds):
            round_start_s = start_s + round_s * (number + _shift(number))
            for slot in range(slots):
                self._listen(round_start_s + slot * round_s / slots)
                for session in self._sessions[slot::slots]:
                    self._ask(session, start_s)
            self._sessions = self._sessions[1:] + self._sessions[:1]
            if progress is not None:
                progress(number + 1, rounds)
        end_s = time.monotonic() + self._timeout_s
        while self._ledger.waiting() and (now_s := time.monotonic()) < end_s:
            self._listen(min(now_s + _LAST_WAIT_S, end_s))

    def _ask(self, session: Session, start_s: float) -> None:
        now_s = time.monotonic()
        for door in session.due(now_s, now_s - start_s):
            sock = self._sockets.get(door.family)
            if sock is not None and not self._send(sock, session, door):
                self._hear(sock)
                self._send(sock, session, door)

    def _send(self, sock: socket.socket, session: Session, door: Door) -> bool:
        """Send one request; False where an error stands in the way, possibly one of an earlier request."""
        nonce = os.urandom(NONCE_BYTES)
        request = write_request(nonce, extended=door.extended)
        sent_ns = time.time_ns()
        try:
            sock.sendto(request, door.address)
        except OSError as error:
            door.error = error.errno
            return False
        self._ledger.note(nonce, session, door, sent_ns)
        return True

    def _listen(self, until_s: float) -> None:
        """Take what arrives until then, and at least what has arrived."""
        while True:
            left_s = until_s - time.monotonic()
            for key, _ in self._selector.select(max(left_s, 0)):
                self._drain(key.data)
            if left_s <= 0:
                return

    def _drain(self, sock: socket.socket) -> None:
        while True:
            try:
                datagram = receive(sock)
            except BlockingIOError:
                return
            except OSError:
                self._hear(sock)
                return
            self._ledger.take(datagram, *read_both_ns(SYSTEM))

    def _hear(self, sock: socket.socket) -> None:
        for destination, code in send_errors(sock):
            self._ledger.unreachable(destination, code)
