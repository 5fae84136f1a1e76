"""Addresses of hosts, looked up side by side: one name server that is silent for seconds delays no other host."""

from __future__ import annotations

import queue
import socket
import threading
import time
from collections.abc import Iterable
from typing import TypeAlias

from rigcal.sync.network.sockets import FAMILIES, Address, in_words

RESOLVE_S = 3.0
"""How long names may take before the probe goes on without them."""

Addresses: TypeAlias = tuple[tuple[int, Address], ...]
"""At most one address of each family, as (family, address with port 0)."""


def resolve(hosts: Iterable[str]) -> dict[str, Addresses | str]:
    """Each host's addresses, or in words why it has none."""
    wanted = tuple(dict.fromkeys(hosts))
    found: queue.SimpleQueue[tuple[str, Addresses | str]] = queue.SimpleQueue()
    for host in wanted:
        threading.Thread(target=lambda host=host: found.put((host, _look_up(host))), daemon=True).start()
    silence = f"the name servers did not answer within {RESOLVE_S:g} s"
    answers: dict[str, Addresses | str] = dict.fromkeys(wanted, silence)
    until_s = time.monotonic() + RESOLVE_S
    for _ in wanted:
        try:
            host, answer = found.get(timeout=max(until_s - time.monotonic(), 0.001))
        except queue.Empty:
            break
        answers[host] = answer
    return answers


def _look_up(host: str) -> Addresses | str:
    try:
        entries = socket.getaddrinfo(host, 0, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        return in_words(error)
    first: dict[int, Address] = {}
    for family, _, _, _, address in entries:
        if family in FAMILIES:
            first.setdefault(int(family), address)  # type: ignore[arg-type]
    return tuple(first.items())
