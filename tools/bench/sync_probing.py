"""Thirty-two hosts probed at once: what it costs this machine, and what comes back.

The hosts are addresses of the loopback network behind one responder in a process of its own, so that the prober's own
processor time is counted and nothing else; a loopback send also pays for the delivery, so that a real network costs
the prober less. The peer is the loop that one would write first: a blocking socket that asks host after host.
"""

from __future__ import annotations

import json
import multiprocessing
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import numpy as np

from rigcal.sync.network import HostProbe, Target, probe, serve

HOSTS, SECONDS, RATE_HZ = 32, 10.0, 10.0
DEAD = 8
"""Hosts of a second run at whose port nothing listens."""


def bench() -> Iterator[dict[str, object]]:
    """One line per run."""
    with responder() as port:
        targets = [Target((f"cam{i}",), f"127.0.0.{i + 1}", port) for i in range(HOSTS)]
        yield _line("probe_32_hosts", *_probed(targets))
        dead = [Target((f"cam{i}",), f"127.0.0.{i + 1}", _closed_port()) for i in range(DEAD)]
        yield _line("probe_32_hosts_8_dead", *_probed([*dead, *targets[DEAD:]]))
        yield _blocking(targets)


def _probed(targets: list[Target]) -> tuple[tuple[HostProbe, ...], float, float]:
    start_s, busy_s = time.monotonic(), time.process_time()
    probes = probe(targets, seconds=SECONDS, rate_hz=RATE_HZ)
    return probes, time.process_time() - busy_s, time.monotonic() - start_s


def _line(name: str, probes: tuple[HostProbe, ...], busy_s: float, wall_s: float) -> dict[str, object]:
    alive = [p for p in probes if p.address is not None]
    trips_us = np.concatenate([p.exchanges.round_trip_s for p in alive]) * 1e6
    asked = sum(p.sent for p in alive)
    return {
        "name": name,
        "hosts": len(probes),
        "hosts_answering": len(alive),
        "rate_hz": RATE_HZ,
        "wall_s": round(wall_s, 3),
        "processor_s": round(busy_s, 3),
        "share_of_a_core_percent": round(100 * busy_s / wall_s, 2),
        "processor_us_per_request": round(1e6 * busy_s / sum(p.sent for p in probes), 1),
        "requests": asked,
        "answered_percent": round(100 * len(trips_us) / asked, 3),
        "round_trip_us_min": round(float(trips_us.min()), 1),
        "round_trip_us_median": round(float(np.median(trips_us)), 1),
        "round_trip_us_p99": round(float(np.percentile(trips_us, 99)), 1),
        "bar_percent": 5.0,
    }


def _blocking(targets: list[Target]) -> dict[str, object]:
    """The peer: the same requests, one after the other, on a socket that waits for each answer."""
    rounds = round(SECONDS * RATE_HZ)
    trips_us = []
    start_s, busy_s = time.monotonic(), time.process_time()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(1.0)
        for number in range(rounds):
            for target in targets:
                sent_ns = time.time_ns()
                sock.sendto(b"\x23" + bytes(47), (target.host, target.port or 0))
                sock.recv(512)
                trips_us.append((time.time_ns() - sent_ns) * 1e-3)
            time.sleep(max(0.0, start_s + (number + 1) / RATE_HZ - time.monotonic()))
    wall_s, busy_s = time.monotonic() - start_s, time.process_time() - busy_s
    return {
        "name": "peer_blocking_loop",
        "hosts": len(targets),
        "share_of_a_core_percent": round(100 * busy_s / wall_s, 2),
        "processor_us_per_request": round(1e6 * busy_s / len(trips_us), 1),
        "round_trip_us_min": round(min(trips_us), 1),
        "round_trip_us_median": round(float(np.median(trips_us)), 1),
        "round_trip_us_p99": round(float(np.percentile(trips_us, 99)), 1),
        "seconds_lost_per_lost_packet": 1.0,
    }


def _closed_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@contextmanager
def responder() -> Iterator[int]:
    """A responder in a process of its own; its port."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there,), daemon=True)
    process.start()
    try:
        yield int(here.recv())
    finally:
        here.send("stop")
        process.join()


def _serve(pipe: Connection) -> None:
    stop = threading.Event()
    threading.Thread(target=lambda: (pipe.recv(), stop.set()), daemon=True).start()
    serve("0.0.0.0", 0, stop=stop, on_ready=lambda places: pipe.send(places[0].rpartition(":")[2]))


if __name__ == "__main__":
    for line in bench():
        print(json.dumps(line))
