"""UDP sockets whose datagrams the kernel stamps as they arrive, and that hear why a datagram did not.

A stamp of the kernel leaves out how long this program took to wake up. Linux gives it, tells of ICMP errors, and lets
an answer leave from the address that was asked; elsewhere the clock is read when the datagram is, and silence is all
that there is to hear.
"""

from __future__ import annotations

import socket
import struct
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

Address: TypeAlias = tuple[str, int] | tuple[str, int, int, int]
"""As the socket module has it: host and port, and for IPv6 the flow and the scope too."""
ControlMessage: TypeAlias = tuple[int, int, bytes]

FAMILIES = (socket.AF_INET, socket.AF_INET6)

_LINUX = sys.platform == "linux"
_SO_TIMESTAMPNS = 35
_IP_PKTINFO, _IP_RECVERR = 8, 11
_IPV6_RECVPKTINFO, _IPV6_PKTINFO, _IPV6_RECVERR = 49, 50, 25
_MSG_ERRQUEUE = 0x2000
"""Numbers of the Linux kernel's interface, most of which Python's socket module does not name."""
_TIMESPEC = struct.Struct("@ll")
_EXTENDED_ERROR = struct.Struct("@I")
_LONGEST = 1024
"""Bytes of a datagram that are read: an NTP packet with every extension that is in use is shorter."""
_ROOM_FOR_CONTROL = 256


class Datagram(NamedTuple):
    """A datagram that arrived."""

    data: bytes
    sender: Address
    arrived_ns: int
    """By the system's realtime clock, when it reached the kernel."""
    reply_from: tuple[ControlMessage, ...]
    """What makes an answer leave from the address that was asked."""


def open_udp(family: int) -> socket.socket:
    """A socket that does not block, unbound, with stamps."""
    sock = socket.socket(family, socket.SOCK_DGRAM)
    sock.setblocking(False)
    if family == socket.AF_INET6:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
    if _LINUX:
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    return sock


def hear_errors(sock: socket.socket) -> None:
    """Keep what ICMP says of datagrams that this socket sent, for :func:`send_errors`."""
    if _LINUX and sock.family == socket.AF_INET:
        sock.setsockopt(socket.IPPROTO_IP, _IP_RECVERR, 1)
    elif _LINUX:
        sock.setsockopt(socket.IPPROTO_IPV6, _IPV6_RECVERR, 1)


def tell_local_address(sock: socket.socket) -> None:
    """Have every datagram say to which of this machine's addresses it came, so that the answer leaves from there."""
    if _LINUX and sock.family == socket.AF_INET:
        sock.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)
    elif _LINUX:
        sock.setsockopt(socket.IPPROTO_IPV6, _IPV6_RECVPKTINFO, 1)


def receive(sock: socket.socket) -> Datagram:
    """The next datagram.

    Raises:
        OSError: ``BlockingIOError`` where there is none; others tell of a datagram sent earlier.
    """
    if not _LINUX:
        data, sender = sock.recvfrom(_LONGEST)
        return Datagram(data, sender, time.time_ns(), ())
    data, control, _, sender = sock.recvmsg(_LONGEST, _ROOM_FOR_CONTROL)
    arrived_ns = 0
    reply_from: tuple[ControlMessage, ...] = ()
    for level, kind, payload in control:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
            seconds, nanoseconds = _TIMESPEC.unpack(payload)
            arrived_ns = seconds * 1_000_000_000 + nanoseconds
        else:
            reply_from = _reply_from(level, kind, payload)
    return Datagram(data, sender, arrived_ns or time.time_ns(), reply_from)


def _reply_from(level: int, kind: int, payload: bytes) -> tuple[ControlMessage, ...]:
    """The address that was asked as the one to answer from, by whatever interface leads there."""
    if level == socket.IPPROTO_IP and kind == _IP_PKTINFO:
        return ((level, kind, bytes(4) + payload[4:8] + bytes(4)),)
    if level == socket.IPPROTO_IPV6 and kind == _IPV6_PKTINFO:
        return ((level, kind, payload[:16] + bytes(4)),)
    return ()


def reply(sock: socket.socket, data: bytes, datagram: Datagram) -> None:
    """Answer a datagram, from the address that it came to.

    Raises:
        OSError: where the network does not take it.
    """
    if datagram.reply_from:
        sock.sendmsg((data,), datagram.reply_from, 0, datagram.sender)
    else:
        sock.sendto(data, datagram.sender)


def send_errors(sock: socket.socket) -> Iterator[tuple[Address, int]]:
    """Where datagrams did not arrive, and the error number that says why."""
    while _LINUX:
        try:
            _, control, _, destination = sock.recvmsg(_LONGEST, _ROOM_FOR_CONTROL, _MSG_ERRQUEUE)
        except OSError:
            return
        for _, kind, payload in control:
            if kind in {_IP_RECVERR, _IPV6_RECVERR} and destination:
                yield destination, _EXTENDED_ERROR.unpack_from(payload)[0]


def port_of(sock: socket.socket) -> int:
    """The port that a socket is bound to."""
    return int(sock.getsockname()[1])


def written(host: str, port: int) -> str:
    """Host and port as one writes them: IPv6 in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def in_words(error: OSError | UnicodeError) -> str:
    """What the operating system says of an error."""
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return "a name with a part that is empty or longer than 63 characters"
