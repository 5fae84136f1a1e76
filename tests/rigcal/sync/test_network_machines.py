"""Probes of other machines: responders in processes of their own, behind networks that delay, lose, copy and favour.

Injected: the responder's offset and skew. True is what :class:`SimulatedClock` says of itself, so that every single
exchange can be held against it: T1 - T2 <= offset <= T4 - T3, at any delay, whatever the network did.
"""

from __future__ import annotations

import heapq
import itertools
import json
import random
import select
import shutil
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np
import pytest

from rigcal.sync.estimator.estimate import estimate_clock
from rigcal.sync.exchanges import Exchanges
from rigcal.sync.network import RIGCAL_PORT, SimulatedClock, Target, probe, serve

ROUNDING_S = 2e-9
"""A nanosecond of the clock and a fraction of one of the packet."""
SERVE = """
import json, sys, threading
from rigcal.sync.network import SimulatedClock, serve
stop = threading.Event()
def run(place, clock):
    tell = lambda places: sys.stdout.write(f"{clock['start_ns']} {places[0]}\\n")
    serve(*place, clock=SimulatedClock(**clock), stop=stop, on_ready=tell)
threads = [threading.Thread(target=run, args=job) for job in json.loads(sys.argv[1])]
for thread in threads:
    thread.start()
sys.stdin.read()
stop.set()
"""
PROBE = """
import json, sys
from rigcal.sync.network import Target, probe
print("ready")
sys.stdin.readline()
hosts, options = json.loads(sys.argv[1])
for found in probe([Target(("cam0",), *host) for host in hosts], **options):
    e = found.exchanges
    columns = (e.sent_ns, e.received_ns, e.replied_ns, e.returned_ns, e.rig_monotonic_ns, e.host_monotonic_ns)
    print(json.dumps({"columns": [c.tolist() for c in columns], "sent": found.sent, "lost": found.lost,
                      "reason": found.reason}))
"""
"""Both flush what they print: they run unbuffered."""


@dataclass(frozen=True)
class Path:
    """One direction of a network."""

    delay_s: float
    jitter_s: float = 0.0
    """Mean of an exponential share of the delay."""
    loss: float = 0.0
    copies: float = 0.0


@contextmanager
def relay(port, there, back, seed, address="127.0.0.1"):
    """A network between the prober and a responder's port: a relay in a thread; its own port."""
    rng, stop = random.Random(seed), threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as front, ExitStack() as stack:
        front.bind((address, 0))
        rear = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        rear.connect((address, port))

        def run():
            due, order, client = [], itertools.count(), None
            while not stop.is_set():
                wait_s = max(0.0, due[0][0] - time.monotonic()) if due else 0.02
                for sock in select.select([front, rear], [], [], min(wait_s, 0.02))[0]:
                    data, sender = sock.recvfrom(1024)
                    client = sender if sock is front else client
                    path = there if sock is front else back
                    for _ in range((rng.random() >= path.loss) * (1 + (rng.random() < path.copies))):
                        at_s = time.monotonic() + path.delay_s + rng.expovariate(1 / max(path.jitter_s, 1e-9))
                        heapq.heappush(due, (at_s, next(order), sock is front, data))
                while due and due[0][0] <= time.monotonic():
                    _, _, outward, data = heapq.heappop(due)
                    rear.send(data) if outward else front.sendto(data, client)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield front.getsockname()[1]
        finally:
            stop.set()
            thread.join()


def python(script, argument, within=()):
    """A Python process, ``within`` a namespace where one is given."""
    command = [*within, sys.executable, "-u", "-c", script, json.dumps(argument)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


@contextmanager
def machine(clocks, address="127.0.0.1", port=0, within=()):
    """A process with one responder per clock; their ports."""
    names = ("offset_s", "skew_ppm", "step_s", "step_after_s", "start_ns")
    jobs = [((address, port), {name: getattr(clock, name) for name in names}) for clock in clocks]
    process = python(SERVE, jobs, within)
    try:
        places = dict(process.stdout.readline().split() for _ in clocks)
        yield [int(places[str(clock.start_ns)].rpartition(":")[2]) for clock in clocks]
    finally:
        process.communicate()


CLOCKS = {
    "ahead and fast": SimulatedClock(offset_s=0.4321, skew_ppm=40.0),
    "behind and slow": SimulatedClock(offset_s=-7.25, skew_ppm=-200.0),
    "on TAI": SimulatedClock(offset_s=37.0),
    "stepped": SimulatedClock(offset_s=0.010, skew_ppm=10.0, step_s=-0.040, step_after_s=0.0),
}
NETWORKS = {
    "LAN": (Path(1e-4, 4e-5), Path(1e-4, 4e-5)),
    "Wi-Fi": (Path(2e-3, 3e-3, 0.1), Path(2e-3, 3e-3, 0.1)),
    "asymmetric": (Path(1e-4), Path(8e-3)),
    "saturated uplink": (Path(3e-4), Path(1e-3, 2e-2, 0.05)),
    "copying and losing": (Path(1e-3, 1e-3, 0.2, 0.3), Path(1e-3, 1e-3, 0.2, 0.3)),
}
ASYMMETRY_S = 8e-3
RIG, HOST, NOBODY = "10.231.7.1", "10.231.7.2", "10.231.7.9"
"""Addresses within the namespaces."""


@pytest.fixture(scope="module")
def machines():
    """The port of one responder per clock, in a process of their own."""
    with machine(CLOCKS.values()) as ports:
        yield dict(zip(CLOCKS, ports, strict=True))


def assert_bounded(exchanges, clock):
    """Every exchange bounds the true offset, and so does what they bound together, corrected for the true skew."""
    lower_s, upper_s = exchanges.least_offset_s, exchanges.greatest_offset_s
    truth_s = np.array([-clock.ahead_s(t) for t in exchanges.sent_ns.tolist()])
    drift_s = clock.skew_ppm * 1e-6 * exchanges.round_trip_s
    assert np.all(lower_s <= truth_s + np.abs(drift_s) + ROUNDING_S)
    assert np.all(upper_s >= truth_s - np.abs(drift_s) - ROUNDING_S)
    return (lower_s - truth_s).max(), (upper_s - truth_s).min()


def assert_found(exchanges, clock):
    """What is written into the rig file holds the truth too."""
    model = estimate_clock(exchanges).model
    true_s = -clock.ahead_s(round((model.at_s + model.offset_s) * 1e9))
    assert abs(model.offset_s - true_s) <= model.bound_s
    assert abs(model.drift_ppm + clock.skew_ppm) <= model.drift_bound_ppm + 1e-6 * clock.skew_ppm**2


@pytest.mark.parametrize("name", CLOCKS)
def test_the_injected_offset_is_within_the_bound_on_every_network(machines, name):
    clock = CLOCKS[name]
    with ExitStack() as stack:
        ports = [
            stack.enter_context(relay(machines[name], *paths, seed=i)) for i, paths in enumerate(NETWORKS.values())
        ]
        targets = [Target((network,), "127.0.0.1", port) for network, port in zip(NETWORKS, ports, strict=True)]
        hosts = probe(targets, seconds=0.7, rate_hz=30.0, timeout_s=0.2)
    for host, (there, back) in zip(hosts, NETWORKS.values(), strict=True):
        assert host.ours
        assert len(host.exchanges) == host.sent - host.lost > 10
        lower_s, upper_s = assert_bounded(host.exchanges, clock)
        assert upper_s - lower_s >= there.delay_s + back.delay_s
        assert_found(host.exchanges, clock)
        if there.loss == back.loss == 0:
            assert host.lost == 0


def test_losses_and_copies_of_a_network_are_counted(machines):
    lossy, copying = (Path(1e-4, 0.0, 0.3), Path(1e-4)), (Path(1e-4), Path(1e-4, 0.0, 0.0, 0.5))
    port = machines["ahead and fast"]
    with relay(port, *lossy, seed=1) as losing, relay(port, *copying, seed=2) as doubling:
        targets = [Target(("cam0",), "127.0.0.1", losing), Target(("cam1",), "127.0.0.1", doubling)]
        lost, copied = probe(targets, seconds=0.7, rate_hz=80.0, timeout_s=0.2)
    assert 0.1 * lost.sent < lost.lost < 0.5 * lost.sent
    assert (copied.lost, copied.spoofed) == (0, 0)
    assert 0.25 * copied.sent < copied.duplicates < 0.75 * copied.sent


def test_a_one_way_delay_moves_the_middle_and_never_the_bound(machines):
    """Nobody can see an asymmetry: the middle of the interval is off by half of it, the interval holds the truth."""
    clock = CLOCKS["ahead and fast"]
    with relay(machines["ahead and fast"], Path(1e-4), Path(1e-4 + ASYMMETRY_S), seed=4) as port:
        (host,) = probe([Target(("cam0",), "127.0.0.1", port)], seconds=0.5, rate_hz=40.0, timeout_s=0.3)
    lower_s, upper_s = assert_bounded(host.exchanges, clock)
    assert (lower_s + upper_s) / 2 == pytest.approx(ASYMMETRY_S / 2, abs=ASYMMETRY_S / 4)


def test_a_step_of_the_hosts_clock_shows_beside_its_monotonic_clock():
    clock, stop, places = SimulatedClock(step_s=0.080, step_after_s=0.5), threading.Event(), []
    thread = threading.Thread(
        target=serve, args=("127.0.0.1", 0), kwargs={"clock": clock, "stop": stop, "on_ready": places.extend}
    )
    thread.start()
    while not places:
        time.sleep(0.001)
    try:
        port = int(places[0].rpartition(":")[2])
        (host,) = probe([Target(("cam0",), "127.0.0.1", port)], seconds=1.0, rate_hz=20.0, timeout_s=0.3)
    finally:
        stop.set()
        thread.join()
    host_s = (host.exchanges.replied_ns - host.exchanges.host_monotonic_ns) * 1e-9
    rig_s = (host.exchanges.returned_ns - host.exchanges.rig_monotonic_ns) * 1e-9
    assert np.diff(host_s).max() == pytest.approx(0.080, abs=1e-3)
    assert np.abs(np.diff(rig_s)).max() < 1e-3
    assert_bounded(host.exchanges, clock)


@pytest.fixture
def namespaces():
    """Two machines on one cable: network namespaces and a pair of virtual interfaces."""
    if shutil.which("ip") is None:
        pytest.skip("iproute2 is not installed")
    mark = f"{time.monotonic_ns() % 0xFFFFFF:x}"
    rig, host = f"rig{mark}", f"cam{mark}"
    setup = [
        f"netns add {rig}",
        f"netns add {host}",
        f"-n {rig} link add eth-rig type veth peer name eth-cam netns {host}",
        f"-n {rig} addr add {RIG}/24 dev eth-rig",
        f"-n {host} addr add {HOST}/24 dev eth-cam",
        f"-n {rig} link set eth-rig up",
        f"-n {host} link set eth-cam up",
        f"-n {rig} link set lo up",
        f"-n {host} link set lo up",
    ]
    try:
        for line in setup:
            done = subprocess.run(["ip", *line.split()], capture_output=True, text=True, check=False)
            if done.returncode:
                pytest.skip(f"network namespaces are not permitted here: {done.stderr.strip()}")
        quick_to_give_up = "echo 100 > /proc/sys/net/ipv4/neigh/eth-rig/retrans_time_ms"
        subprocess.run([*within(rig), "sh", "-c", quick_to_give_up], check=True)
        yield rig, host
    finally:
        for name in (rig, host):
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


def within(namespace):
    return ("ip", "netns", "exec", namespace)


@contextmanager
def prober(namespace, hosts, **options):
    """A process that probes hosts and ports from a namespace; what gives its findings once it may begin."""
    process = python(PROBE, (hosts, options), within(namespace))

    def begin():
        process.stdout.readline()
        return [json.loads(line) for line in process.communicate("begin\n")[0].splitlines()]

    try:
        yield begin
    finally:
        process.kill()
        process.communicate()


def exchanges_of(found):
    return Exchanges(*[np.array(c, dtype=np.int64) for c in found["columns"]])


def impair(namespace, interface, *netem):
    """Slow one direction with netem; whether the kernel has it."""
    command = [*within(namespace), "tc", "qdisc", "replace", "dev", interface, "root", "netem", *netem]
    return shutil.which("tc") is not None and not subprocess.run(command, capture_output=True, check=False).returncode


def test_a_machine_in_another_namespace_is_found_within_the_bound_and_absent_ones_are_told_apart(namespaces):
    rig, host = namespaces
    clock = SimulatedClock(offset_s=-0.123456, skew_ppm=80.0)
    hosts = [(HOST, None), (HOST, 9), (NOBODY, None)]
    with (
        prober(rig, hosts, seconds=1.0, rate_hz=30.0) as begin,
        machine([clock], HOST, RIGCAL_PORT, within(host)),
    ):
        found, closed, off = begin()
    assert (found["sent"], found["lost"]) == (30, 0)
    lower_s, upper_s = assert_bounded(exchanges_of(found), clock)
    assert upper_s - lower_s < 2e-3
    assert_found(exchanges_of(found), clock)
    assert closed["reason"] == (
        f"nothing listens on port 9 of {HOST} (ICMP): start `rigcal sync serve` there, or an NTP server"
    )
    assert off["reason"] == (
        f"no machine answers at {NOBODY} (ICMP: unreachable): check that it is on, its cable and its address"
    )


def test_a_network_of_the_kernel_that_delays_and_loses_keeps_the_bound(namespaces):
    rig, host = namespaces
    there = impair(rig, "eth-rig", "delay", "2ms", "1ms", "loss", "10%")
    if not there or not impair(host, "eth-cam", "delay", "12ms", "4ms", "loss", "10%"):
        pytest.skip("the kernel has no netem; the relay's networks stand in for it")
    clock = SimulatedClock(offset_s=1.5, skew_ppm=-60.0)
    with (
        prober(rig, [(HOST, None)], seconds=2.0, rate_hz=40.0) as begin,
        machine([clock], HOST, RIGCAL_PORT, within(host)),
    ):
        (found,) = begin()
    assert 0 < found["lost"] < found["sent"] / 2
    lower_s, upper_s = assert_bounded(exchanges_of(found), clock)
    assert upper_s - lower_s > 0.008
    assert_found(exchanges_of(found), clock)
