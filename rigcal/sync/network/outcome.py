"""What came of probing a host, and where nothing did: why, as far as the network tells."""

from __future__ import annotations

import errno
import os

import numpy as np

from rigcal.sync.exchanges import Exchanges
from rigcal.sync.network.hostprobe import HostProbe
from rigcal.sync.network.session import SETTLE_S, Session

_NO_WAY_OUT = {errno.ENETUNREACH, errno.ENETDOWN}
_NOBODY_THERE = {errno.EHOSTUNREACH, errno.EHOSTDOWN}


def outcome_of(session: Session) -> HostProbe:
    """The session as it ended."""
    if session.chosen is None:
        session.settle(SETTLE_S)
    door = session.chosen
    asked = session.doors if door is None else (door,)
    rows = [] if door is None else sorted(door.rows)
    sent = sum(each.sent for each in asked)
    return HostProbe(
        target=session.target,
        address=None if door is None else str(door.address[0]),
        port=None if door is None else door.port,
        ours=door is not None and door.ours,
        exchanges=Exchanges(*np.array(rows, dtype=np.int64).reshape(-1, 7).T[1:]),
        sent=sent,
        lost=sent - len(rows),
        late=sum(each.late for each in asked),
        duplicates=session.duplicates,
        spoofed=session.spoofed,
        malformed=session.malformed,
        kisses=tuple(sorted(session.kisses)),
        claim=None if door is None else door.claim,
        reason=_why_silent(session) if door is None else None,
    )


def _why_silent(session: Session) -> str:
    """What a host said or did in place of telling the time."""
    name = session.target.host
    if session.unresolved is not None:
        return f"the name {name} is not known ({session.unresolved}): check its spelling, or give the address"
    if refusals := sorted(session.kisses - {"RATE"}):
        return f"{name} refuses to tell its time ({', '.join(refusals)}): let its NTP server answer this machine"
    if session.elsewhere is not None:
        elsewhere = session.elsewhere
        return f"the answers come from {elsewhere}, not from where they were asked for: probe {elsewhere}"
    if session.kisses:
        return f"{name} asks for fewer requests (RATE) and told no time: lift its rate limit for this machine"
    if session.malformed:
        return f"what answers on {_ports(session)} of {name} does not speak NTP: check the port"
    return _why_unreachable(name, _ports(session), {door.error for door in session.doors})


def _why_unreachable(name: str, ports: str, errors: set[int | None]) -> str:
    """What the network said of requests to a host that itself said nothing."""
    if errors == {errno.ECONNREFUSED}:
        return f"nothing listens on {ports} of {name} (ICMP): start `rigcal sync serve` there, or an NTP server"
    if errors & _NOBODY_THERE:
        return f"no machine answers at {name} (ICMP: unreachable): check that it is on, its cable and its address"
    if errors & _NO_WAY_OUT:
        return f"this machine has no way to {name} (network unreachable): check its own cable or Wi-Fi"
    other = next((code for code in errors if code not in {None, errno.ECONNREFUSED}), None)
    if other is not None:
        return f"requests to {name} cannot be sent ({os.strerror(other)}): check this machine's network and firewall"
    return (
        f"no answer on {ports} of {name}: check that it is on, runs `rigcal sync serve` or an NTP server, and "
        "that no firewall is between"
    )


def _ports(session: Session) -> str:
    numbers = tuple(dict.fromkeys(str(door.port) for door in session.doors))
    return f"ports {' and '.join(numbers)}" if len(numbers) > 1 else f"port {numbers[0]}"
