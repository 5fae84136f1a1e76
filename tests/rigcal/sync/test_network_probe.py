"""The prober against a scripted host: losses, delays, copies, forgeries, kisses, silence."""

from __future__ import annotations

import errno
import heapq
import itertools
import os
import re
import select
import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from rigcal.errors import OptionError
from rigcal.sync.exchanges import UNKNOWN
from rigcal.sync.network import Target, probe, serve
from rigcal.sync.network import resolving as resolving_module
from rigcal.sync.network.clocks import SimulatedClock
from rigcal.sync.network.ledger import Ledger
from rigcal.sync.network.outcome import outcome_of
from rigcal.sync.network.packet import UNSYNCHRONISED, Claim, read_request, write_answer
from rigcal.sync.network.session import SETTLE_S, open_session

QUICK = {"seconds": 0.25, "rate_hz": 40.0, "timeout_s": 0.2}
"""Ten requests."""
LINUX_ONLY = pytest.mark.skipif(not hasattr(socket, "MSG_ERRQUEUE"), reason="ICMP errors are heard on Linux only")


def plain_answer(request, claim=UNSYNCHRONISED):
    now_ns = time.time_ns()
    return write_answer(request._replace(extended=False), claim, now_ns, now_ns, 0)


def kiss(code):
    """What a server sends in place of the time."""

    def script(number, request):
        answer = bytearray(plain_answer(request))
        answer[12:16] = code
        return [(0.0, bytes(answer))]

    return script


@contextmanager
def scripted(script, address="127.0.0.1"):
    """A host on a free port; ``script(number, request)`` gives its packets as (delay in s, bytes[, other sender])."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    seen, stop = [], threading.Event()
    with socket.socket(family, socket.SOCK_DGRAM) as sock, socket.socket(family, socket.SOCK_DGRAM) as other:
        sock.bind((address, 0))
        other.bind((address, 0))

        def run():
            due, order = [], itertools.count()
            while not stop.is_set():
                if select.select([sock], [], [], 0.002)[0]:
                    data, sender = sock.recvfrom(512)
                    seen.append((time.monotonic(), data))
                    for delay_s, packet, *elsewhere in script(len(seen) - 1, read_request(data)):
                        source = other if elsewhere else sock
                        heapq.heappush(due, (time.monotonic() + delay_s, next(order), source, packet, sender))
                while due and due[0][0] <= time.monotonic():
                    _, _, source, packet, sender = heapq.heappop(due)
                    source.sendto(packet, sender)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield Target(("cam0",), address, sock.getsockname()[1]), seen
        finally:
            stop.set()
            thread.join()


@contextmanager
def serving(address="127.0.0.1", port=0, clock=None):
    stop, ready, places = threading.Event(), threading.Event(), []

    def on_ready(listening):
        places.extend(listening)
        ready.set()

    clock = clock or SimulatedClock()
    thread = threading.Thread(
        target=serve, args=(address, port), kwargs={"clock": clock, "stop": stop, "on_ready": on_ready}
    )
    thread.start()
    assert ready.wait(5)
    try:
        yield int(places[0].rpartition(":")[2])
    finally:
        stop.set()
        thread.join()


def settled(script):
    """A plain host that answers the first form it meets, and follows the script for plain requests."""

    def only_plain(number, request):
        return script(number, request) if not request.extended else []

    return only_plain


def test_a_plain_server_is_found_and_asked_without_extension_from_then_on():
    claim = Claim(0, 2, 0.010, 0.002)
    with scripted(lambda n, r: [(0.0, plain_answer(r, claim))]) as (target, seen):
        (host,) = probe([target], seconds=0.8, rate_hz=30.0, timeout_s=0.2)
    late = [data for at_s, data in seen if at_s > seen[0][0] + SETTLE_S + 0.1]
    assert late
    assert {len(data) for data in late} == {48}
    assert (host.address, host.port, host.ours, host.reason) == ("127.0.0.1", target.port, False, None)
    assert (host.stratum, host.leap) == (2, 0)
    assert host.claimed_error_s == pytest.approx(0.007, abs=2 / 65536)
    assert set(host.exchanges.host_monotonic_ns) == {UNKNOWN}
    assert host.sent == 24
    assert host.lost == host.late == host.duplicates == host.spoofed == host.malformed == 0


def test_our_responder_is_recognised_and_tells_its_monotonic_clock():
    with serving() as port:
        (host,) = probe([Target(("cam0",), "127.0.0.1", port)], **QUICK)
    assert host.ours
    assert (host.sent, host.lost, len(host.exchanges)) == (10, 0, 10)
    assert (host.stratum, host.leap, host.claimed_error_s) == (16, 3, None)
    either = host.exchanges.rig_monotonic_ns - host.exchanges.host_monotonic_ns
    assert np.all((either >= 0) & (either < 1e9))


def test_the_monotonic_clock_is_that_of_the_answers_arrival():
    with serving() as port:
        (host,) = probe([Target(("cam0",), "127.0.0.1", port)], **QUICK)
    apart_ns = host.exchanges.returned_ns - host.exchanges.rig_monotonic_ns
    assert np.ptp(apart_ns) < 1_000_000
    assert abs(int(apart_ns[0]) - (time.time_ns() - time.monotonic_ns())) < 1_000_000


def test_ipv6_hosts_are_probed_beside_ipv4_ones():
    if not socket.has_ipv6:
        pytest.skip("no IPv6 on this machine")
    with serving("::1") as six, serving() as four:
        hosts = probe([Target(("cam0",), "::1", six), Target(("cam1",), "127.0.0.1", four)], **QUICK)
    assert [(host.address, host.lost) for host in hosts] == [("::1", 0), ("127.0.0.1", 0)]


def test_lost_answers_are_counted_and_the_rest_kept():
    with scripted(settled(lambda n, r: [] if n % 3 == 0 else [(0.0, plain_answer(r))])) as (target, seen):
        (host,) = probe([target], **QUICK)
    plain = [number for number, (_, data) in enumerate(seen) if len(data) == 48]
    assert host.sent == len(plain)
    assert host.lost == sum(number % 3 == 0 for number in plain) > 0
    assert len(host.exchanges) == host.sent - host.lost


def test_late_answers_are_counted_and_still_bound_the_offset():
    plain = itertools.count()

    def slow_once(number, request):
        return [(0.4 if next(plain) == 4 else 0.0, plain_answer(request))]

    with scripted(settled(slow_once)) as (target, _):
        (host,) = probe([target], seconds=0.7, rate_hz=20.0, timeout_s=0.25)
    assert host.late == 1
    assert host.lost == 0
    assert np.all(np.diff(host.exchanges.sent_ns) > 0)
    assert host.exchanges.round_trip_s.max() > 0.25
    assert host.exchanges.least_offset_s.max() <= host.exchanges.greatest_offset_s.min()


def test_each_request_is_answered_once():
    with scripted(lambda n, r: [(0.0, plain_answer(r)), (0.001, plain_answer(r))]) as (target, _):
        (host,) = probe([target], **QUICK)
    assert len(host.exchanges) == host.sent == 10
    assert host.duplicates >= host.sent - 1
    assert host.spoofed == 0


def test_an_answer_with_another_origin_is_spoofed_and_moves_nothing():
    def forged(number, request):
        hour_ahead = write_answer(
            request._replace(nonce=os.urandom(8), extended=False),
            UNSYNCHRONISED,
            *[time.time_ns() + 3600 * 10**9] * 2,
            0,
        )
        return [(0.0, hour_ahead), (0.002, plain_answer(request))]

    with scripted(forged) as (target, _):
        (host,) = probe([target], **QUICK)
    assert host.spoofed >= host.sent
    assert host.lost == 0
    assert np.all(np.abs(host.exchanges.greatest_offset_s) < 1)


def test_an_answer_from_another_address_is_not_taken():
    with scripted(lambda n, r: [(0.0, plain_answer(r), "elsewhere")]) as (target, _):
        (host,) = probe([target], **QUICK)
    assert len(host.exchanges) == 0
    assert host.spoofed >= 9
    words = r"the answers come from 127.0.0.1:(\d+), not from where they were asked for: probe 127.0.0.1:\1"
    assert re.fullmatch(words, host.reason)


def test_a_copy_of_another_hosts_answer_is_not_taken():
    """One host hears nothing; the other answers for both, with the right nonces."""
    heard = []
    hear = scripted(lambda n, r: heard.append(r) or [])
    tell = scripted(lambda n, r: [(0.0, plain_answer(q)) for q in [r, *heard[-1:]]])
    with hear as (mute, _), tell as (loud, _):
        silent, good = probe([mute, loud], **QUICK)
    assert len(silent.exchanges) == 0
    assert silent.spoofed > 0
    assert len(good.exchanges) == good.sent


def test_garbage_is_counted_and_ignored():
    with scripted(lambda n, r: [(0.0, b"\x24" + bytes(46)), (0.001, plain_answer(r))]) as (target, _):
        (host,) = probe([target], **QUICK)
    assert host.malformed >= 10
    assert len(host.exchanges) == host.sent


def test_a_port_that_speaks_something_else_is_named():
    with scripted(lambda n, r: [(0.0, b"HTTP/1.1 400 Bad Request\r\n\r\n")]) as (target, _):
        (host,) = probe([target], **QUICK)
    assert host.reason == f"what answers on port {target.port} of 127.0.0.1 does not speak NTP: check the port"


def test_a_host_that_asks_for_fewer_requests_gets_fewer():
    with scripted(kiss(b"RATE")) as (target, seen):
        (host,) = probe([target], seconds=0.4, rate_hz=20.0, timeout_s=0.1)
    assert len(seen) <= 4
    assert host.kisses == ("RATE",)
    assert host.reason == (
        "127.0.0.1 asks for fewer requests (RATE) and told no time: lift its rate limit for this machine"
    )


@pytest.mark.parametrize("code", [b"DENY", b"RSTR"])
def test_a_host_that_refuses_is_left_alone(code):
    with scripted(kiss(code)) as (target, seen):
        (host,) = probe([target], seconds=0.4, rate_hz=20.0, timeout_s=0.1)
    assert len(seen) <= 2
    assert host.reason == (
        f"127.0.0.1 refuses to tell its time ({code.decode()}): let its NTP server answer this machine"
    )


def test_a_forged_kiss_does_not_silence_a_host():
    def forged(number, request):
        return [*kiss(b"DENY")(number, request._replace(nonce=bytes(8))), (0.0, plain_answer(request))]

    with scripted(forged) as (target, _):
        (host,) = probe([target], **QUICK)
    assert (host.sent, host.lost, host.kisses) == (10, 0, ())


def test_a_server_that_is_not_synchronised_yet_is_no_kiss():
    with scripted(lambda n, r: [(0.0, plain_answer(r))]) as (target, _):
        (host,) = probe([target], **QUICK)
    assert (host.stratum, host.leap, host.kisses, host.reason) == (16, 3, (), None)


@LINUX_ONLY
def test_a_closed_port_is_told_from_silence():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        closed = Target(("cam0",), "127.0.0.1", sock.getsockname()[1])
    with scripted(lambda n, r: []) as (mute, _):
        refused, silent = probe([closed, mute], **QUICK)
    assert refused.reason == (
        f"nothing listens on port {closed.port} of 127.0.0.1 (ICMP): start `rigcal sync serve` there, or an NTP server"
    )
    assert silent.reason == (
        f"no answer on port {mute.port} of 127.0.0.1: check that it is on, runs `rigcal sync serve` or an NTP server, "
        "and that no firewall is between"
    )
    assert refused.address is refused.port is refused.claim is None
    assert refused.lost == refused.sent > 0


def test_a_name_that_is_not_known_is_told():
    (host,) = probe([Target(("cam0",), "no-such-host.invalid", None)], **QUICK)
    assert host.reason.startswith("the name no-such-host.invalid is not known (")
    assert host.reason.endswith("): check its spelling, or give the address")
    assert host.sent == 0


def test_silent_name_servers_delay_no_more_than_their_time(monkeypatch):
    asleep = threading.Event()
    monkeypatch.setattr(resolving_module, "RESOLVE_S", 0.2)
    monkeypatch.setattr(resolving_module, "_look_up", lambda host: asleep.wait(5) and ())
    start_s = time.monotonic()
    (host,) = probe([Target(("cam0",), "cam0.local", None)], **QUICK)
    asleep.set()
    assert time.monotonic() - start_s < 1.5
    assert host.reason == (
        "the name cam0.local is not known (the name servers did not answer within 0.2 s): "
        "check its spelling, or give the address"
    )


@LINUX_ONLY
def test_dead_hosts_do_not_disturb_the_others():
    with scripted(lambda n, r: []) as (mute, _), serving("0.0.0.0") as port:
        alive = [Target((f"cam{i}",), f"127.0.0.{i + 1}", port) for i in range(4)]
        dead = [Target(("x",), f"127.0.1.{i}", 9) for i in range(4)]
        start_s = time.monotonic()
        hosts = probe([*dead, mute, *alive], **QUICK)
    assert time.monotonic() - start_s < 1.5
    assert [host.address for host in hosts] == [None] * 5 + [f"127.0.0.{i + 1}" for i in range(4)]
    assert all(host.lost == 0 for host in hosts[5:])


def test_one_host_may_be_asked_under_two_names():
    with serving() as port:
        hosts = probe([Target(("cam0",), "127.0.0.1", port), Target(("cam1",), "localhost", port)], **QUICK)
    assert [(host.sent, host.lost) for host in hosts] == [(10, 0), (10, 0)]


def test_progress_counts_rounds():
    calls = []
    with serving() as port:
        probe([Target(("cam0",), "127.0.0.1", port)], **QUICK, progress=lambda *call: calls.append(call))
    assert calls == [(n, 10) for n in range(1, 11)]


def test_no_targets_give_no_probes():
    assert probe([], **QUICK) == ()


@pytest.mark.parametrize(
    ("options", "name", "expected"),
    [
        ({"seconds": 0.0}, "seconds", "more than 0 seconds"),
        ({"timeout_s": float("inf")}, "timeout_s", "more than 0 seconds"),
        ({"rate_hz": 1000.0}, "rate_hz", "more than 0 and at most 200 per second"),
    ],
)
def test_numbers_out_of_range_are_refused(options, name, expected):
    with pytest.raises(OptionError) as caught:
        probe([], **options)
    assert str(caught.value) == (
        f"option {name} is out of range\n"
        f"  expected: {expected}\n"
        f"  got:      {options[name]!r}\n"
        f"  do next:  give {name} as {expected}"
    )


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        (
            errno.EHOSTUNREACH,
            "no machine answers at 10.0.0.5 (ICMP: unreachable): check that it is on, its cable and its address",
        ),
        (
            errno.ENETUNREACH,
            "this machine has no way to 10.0.0.5 (network unreachable): check its own cable or Wi-Fi",
        ),
        (
            errno.EPERM,
            "requests to 10.0.0.5 cannot be sent (Operation not permitted): check this machine's network and firewall",
        ),
    ],
)
def test_what_the_network_says_of_a_host_is_passed_on(code, reason):
    session = open_session(Target(("cam0",), "10.0.0.5"), ((socket.AF_INET, ("10.0.0.5", 0)),))
    ledger = Ledger([session], 10**9)
    ledger.unreachable(("10.0.0.5", 12123), code)
    assert outcome_of(session).reason == reason


def test_a_machine_without_ipv6_says_so_of_ipv6_hosts():
    session = open_session(Target(("cam0",), "::5"), ((socket.AF_INET6, ("::5", 0, 0, 0)),))
    Ledger([session], 10**9).unusable(socket.AF_INET6, errno.EAFNOSUPPORT)
    assert outcome_of(session).reason == (
        "requests to ::5 cannot be sent (Address family not supported by protocol): "
        "check this machine's network and firewall"
    )


def test_a_scope_is_kept_for_addresses_of_a_single_cable():
    session = open_session(Target(("cam0",), "fe80::1%eth0"), ((socket.AF_INET6, ("fe80::1", 0, 0, 4)),))
    assert [door.address for door in session.doors] == [("fe80::1", 12123, 0, 4), ("fe80::1", 123, 0, 4)]
