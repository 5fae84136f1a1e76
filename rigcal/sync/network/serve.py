"""The responder that runs on a camera's host: it tells the time by that host's clocks to whoever asks in NTP."""

from __future__ import annotations

import errno
import selectors
import socket
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from rigcal.errors import OptionError, ServeTimeError
from rigcal.sync.network.claims import ClaimKeeper
from rigcal.sync.network.clocks import SYSTEM, Clock, SystemClock, read_both_ns
from rigcal.sync.network.packet import RIGCAL_PORT, UNSYNCHRONISED, Claim, read_request, write_answer
from rigcal.sync.network.sockets import (
    FAMILIES,
    Datagram,
    in_words,
    open_udp,
    port_of,
    receive,
    reply,
    tell_local_address,
    written,
)

_LAST_PORT, _FIRST_UNPRIVILEGED_PORT = 65_535, 1024
_STOP_S = 0.2
"""How soon a request to stop is noticed."""
_NO_FAMILY = {errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL, errno.EPROTONOSUPPORT}


@dataclass(frozen=True, slots=True)
class Served:
    """What a responder did until it was stopped."""

    answered: int
    ignored: int
    """Packets that are no request for the time; nothing was sent back."""
    unsent: int
    """Answers that the network did not take."""


def serve(
    address: str | None = None,
    port: int = RIGCAL_PORT,
    *,
    clock: Clock = SYSTEM,
    stop: threading.Event,
    on_ready: Callable[[tuple[str, ...]], None] | None = None,
) -> Served:
    """Answer requests for the time until ``stop`` is set, at most 0.2 s longer.

    An answer is as long as its request and leaves from the address that was asked. How right the clock is, is told as
    chronyd has it where that runs on this machine, and is honestly "not synchronised" elsewhere.

    Args:
        address: an address of this machine, IPv4 or IPv6; None: all of them.
        port: the port; 0 takes any that is free.
        clock: what the time is told by.
        stop: set from another thread or a signal's handler.
        on_ready: called once with the places that are listened at, as ``address:port``.

    Raises:
        OptionError: where the port is none.
        ServeTimeError: where the address is not this machine's, the port is taken, or may not be used.
    """
    if not 0 <= port <= _LAST_PORT:
        raise OptionError("port", expected=f"a number from 0 to {_LAST_PORT}", got=port)
    with ExitStack() as stack:
        sockets = [stack.enter_context(sock) for sock in _bind(address, port)]
        claim = _claim_of(clock, stack)
        selector = stack.enter_context(selectors.DefaultSelector())
        for sock in sockets:
            selector.register(sock, selectors.EVENT_READ, sock)
        if on_ready is not None:
            on_ready(tuple(_place(sock) for sock in sockets))
        responder = _Responder(clock, claim)
        while not stop.is_set():
            for key, _ in selector.select(_STOP_S):
                responder.drain(key.data)
        return Served(responder.answered, responder.ignored, responder.unsent)


def _claim_of(clock: Clock, stack: ExitStack) -> Callable[[], Claim]:
    """What may be said of the clock; chronyd knows the system's and no other."""
    if isinstance(clock, SystemClock):
        return stack.enter_context(ClaimKeeper()).current
    return lambda: UNSYNCHRONISED


class _Responder:
    def __init__(self, clock: Clock, claim: Callable[[], Claim]) -> None:
        self._clock, self._claim = clock, claim
        self.answered = self.ignored = self.unsent = 0

    def drain(self, sock: socket.socket) -> None:
        """Answer what has arrived."""
        while True:
            try:
                datagram = receive(sock)
            except BlockingIOError:
                return
            except OSError:
                self.unsent += 1
                return
            self._answer(sock, datagram)

    def _answer(self, sock: socket.socket, datagram: Datagram) -> None:
        request = read_request(datagram.data)
        if request is None:
            self.ignored += 1
            return
        claim = self._claim()
        received_ns = self._clock.realtime_at_ns(datagram.arrived_ns)
        replied_ns, monotonic_ns = read_both_ns(self._clock)
        try:
            reply(sock, write_answer(request, claim, received_ns, replied_ns, monotonic_ns), datagram)
        except OSError:
            self.unsent += 1
        else:
            self.answered += 1


def _bind(address: str | None, port: int) -> list[socket.socket]:
    """A socket at the address, or one per family at every address."""
    if address is not None:
        return [_bound(address, port)]
    first = _bound("0.0.0.0", port)
    try:
        return [first, _bound("::", port_of(first))]
    except ServeTimeError as error:
        if isinstance(error.__cause__, OSError) and error.__cause__.errno in _NO_FAMILY:
            return [first]
        first.close()
        raise


def _bound(address: str, port: int) -> socket.socket:
    try:
        entries = socket.getaddrinfo(address, port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
        family, _, _, _, place = next(entry for entry in entries if entry[0] in FAMILIES)
        sock = open_udp(family)
    except (OSError, UnicodeError) as error:
        raise _refused(address, port, error) from error
    try:
        tell_local_address(sock)
        sock.bind(place)
    except OSError as error:
        sock.close()
        raise _refused(address, port, error) from error
    return sock


def _refused(address: str, port: int, error: OSError | UnicodeError) -> ServeTimeError:
    place = written(address, port)
    code = error.errno if isinstance(error, OSError) else None
    if code == errno.EADDRINUSE:
        return ServeTimeError(
            f"the port {port} is taken",
            where=place,
            expected="a port that no other program listens at",
            got=in_words(error),
            do_next="stop the other program (`ss -lunp` shows it), or choose another port; a host that runs chronyd or "
            "ntpd can be probed as it is",
        )
    if code in {errno.EACCES, errno.EPERM}:
        return ServeTimeError(
            f"this user may not listen at port {port}",
            where=place,
            expected=f"a port from {_FIRST_UNPRIVILEGED_PORT}, or the right to use lower ones",
            got=in_words(error),
            do_next=f"leave the port at {RIGCAL_PORT}, where the probe looks by itself",
        )
    return ServeTimeError(
        "this machine cannot listen at that address",
        where=place,
        expected="an address of this machine (`ip address` lists them), or none to listen at all of them",
        got=in_words(error),
        do_next="mend the address, or leave it out",
    )


def _place(sock: socket.socket) -> str:
    name = sock.getsockname()
    return written(str(name[0]), int(name[1]))
