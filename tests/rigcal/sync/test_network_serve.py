"""The responder, asked by hand."""

from __future__ import annotations

import dataclasses
import errno
import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from rigcal.errors import OptionError, ServeTimeError
from rigcal.sync.network import RIGCAL_PORT, SimulatedClock, SystemClock, parse_tracking, serve
from rigcal.sync.network import claims as claims_module
from rigcal.sync.network.packet import read_answer, write_request

NONCE = b"nonce-01"
TRACKED = (
    "7F000001,127.0.0.1,9,1795341688.6,0.000001164,0.000000119,0.000001,1.5,0.001,0.02,"
    "0.000002461,0.000001559,0.3,Normal"
)
LINUX_ONLY = pytest.mark.skipif(not hasattr(socket, "MSG_ERRQUEUE"), reason="the kernel stamps datagrams on Linux only")


@contextmanager
def serving(address="127.0.0.1", clock=None):
    """A responder in a thread; its places, and afterwards what it did."""
    stop, ready, places, served = threading.Event(), threading.Event(), [], []

    def on_ready(listening):
        places.extend(listening)
        ready.set()

    def run():
        served.append(serve(address, 0, clock=clock or SimulatedClock(), stop=stop, on_ready=on_ready))

    thread = threading.Thread(target=run)
    thread.start()
    assert ready.wait(5)
    try:
        yield places, served
    finally:
        stop.set()
        thread.join()


def address_of(place):
    host, _, port = place.rpartition(":")
    return host.strip("[]"), int(port)


def ask(place, request, host=None, timeout_s=2.0):
    """The first answer and where it came from; None where there is none."""
    listening, port = address_of(place)
    family = socket.AF_INET6 if ":" in listening else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as sock:
        sock.settimeout(timeout_s)
        sock.sendto(request, (host or listening, port))
        try:
            return sock.recvfrom(1024)
        except TimeoutError:
            return None


def test_it_tells_the_time_of_its_clock():
    clock = SimulatedClock(offset_s=3600.0)
    with serving(clock=clock) as (places, _):
        before_ns = time.time_ns()
        data, _ = ask(places[0], write_request(NONCE, extended=True))
        after_ns = time.time_ns()
    answer = read_answer(data)
    hour_ns = 3600 * 10**9
    assert before_ns + hour_ns <= answer.received_ns <= answer.replied_ns <= after_ns + hour_ns
    assert answer.nonce == NONCE
    assert abs(answer.monotonic_ns - time.monotonic_ns()) < 5e9


def test_it_answers_at_every_address_in_either_family():
    with serving(None) as (places, _):
        assert places[0].startswith("0.0.0.0:")
        assert ask(places[0], write_request(NONCE, extended=False), "127.0.0.1") is not None
        if len(places) == 1:
            pytest.skip("no IPv6 on this machine")
        assert places[1] == f"[::]:{address_of(places[0])[1]}"
        assert ask(places[1], write_request(NONCE, extended=False), "::1") is not None


@LINUX_ONLY
def test_the_answer_leaves_from_the_address_that_was_asked():
    with serving("0.0.0.0") as (places, _):
        _, sender = ask(places[0], write_request(NONCE, extended=False), "127.0.0.7")
    assert sender == ("127.0.0.7", address_of(places[0])[1])


def test_no_answer_is_longer_than_its_request_and_what_is_no_request_gets_none():
    rng = np.random.default_rng(3)
    requests = [rng.bytes(int(n)) for n in rng.integers(0, 200, 300)]
    requests += [bytes([0b00_100_011]) + rng.bytes(int(n)) for n in rng.integers(47, 200, 100)]
    requests.append(write_request(NONCE, extended=True))
    with serving() as (places, served), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(2)
        sock.connect(address_of(places[0]))
        answers = 0
        for request in requests:
            sock.send(request)
            if len(request) >= 48 and request[0] & 7 == 3 and 1 <= (request[0] >> 3) & 7 <= 4:
                assert len(sock.recv(1024)) <= len(request)
                answers += 1
    assert answers > 100
    assert (served[0].answered, served[0].ignored) == (answers, len(requests) - answers)


@LINUX_ONLY
def test_arrivals_are_stamped_by_the_kernel_even_while_the_responder_is_busy():
    class Busy(SystemClock):
        def realtime_ns(self):
            time.sleep(0.05)
            return time.time_ns()

    with serving(clock=Busy()) as (places, _), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(5)
        sock.connect(address_of(places[0]))
        for number in range(2):
            sock.send(write_request(bytes([number + 1] * 8), extended=False))
        first, second = read_answer(sock.recv(1024)), read_answer(sock.recv(1024))
    assert second.received_ns < first.replied_ns - 30_000_000


def test_a_stamp_of_the_kernel_is_told_in_the_responders_own_time():
    with serving(clock=SimulatedClock(offset_s=-40.0)) as (places, _):
        data, _ = ask(places[0], write_request(NONCE, extended=False))
    answer = read_answer(data)
    assert 0 <= answer.replied_ns - answer.received_ns < 1e9


def test_how_right_the_system_clock_is_comes_from_chronyd(monkeypatch):
    asked = threading.Event()

    def tracked():
        asked.set()
        return parse_tracking(TRACKED)

    monkeypatch.setattr(claims_module, "read_tracking", tracked)
    with serving(clock=SystemClock()) as (places, _):
        assert asked.wait(2)
        time.sleep(0.05)
        data, _ = ask(places[0], write_request(NONCE, extended=False))
    answer = read_answer(data)
    assert (answer.stratum, answer.leap) == (9, 0)
    assert 2.461e-6 / 2 + 1.559e-6 + 1.164e-6 <= answer.claim.error_s < 100e-6


@pytest.mark.parametrize(("skew_ppm", "rate"), [(0.02, 15e-6), (500.0, 500e-6)])
def test_a_claim_grows_older(monkeypatch, skew_ppm, rate):
    tracking = dataclasses.replace(parse_tracking(TRACKED), root_dispersion_s=0.001, skew_ppm=skew_ppm)
    monkeypatch.setattr(claims_module, "read_tracking", lambda: tracking)
    with claims_module.ClaimKeeper() as keeper:
        while not keeper.current().synchronised:
            time.sleep(0.001)
        young = keeper.current()
        time.sleep(0.1)
        old = keeper.current()
    assert old.error_s - young.error_s == pytest.approx(rate * 0.1, rel=0.5)


def test_a_simulated_clock_claims_nothing():
    with serving() as (places, _):
        data, _ = ask(places[0], write_request(NONCE, extended=False))
    assert not read_answer(data).claim.synchronised


def refusal(address, port):
    with pytest.raises(ServeTimeError) as caught:
        serve(address, port, stop=threading.Event())
    return str(caught.value)


def test_a_taken_port_is_told():
    with serving() as (places, _):
        port = address_of(places[0])[1]
        assert refusal("127.0.0.1", port) == (
            f"the port {port} is taken\n"
            f"  where:    127.0.0.1:{port}\n"
            "  expected: a port that no other program listens at\n"
            "  got:      Address already in use\n"
            "  do next:  stop the other program (`ss -lunp` shows it), or choose another port; a host that runs "
            "chronyd or ntpd can be probed as it is"
        )


def test_a_port_that_is_not_allowed_is_told(monkeypatch):
    def forbidden(sock, address):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", forbidden, raising=False)
    assert refusal("127.0.0.1", 123) == (
        "this user may not listen at port 123\n"
        "  where:    127.0.0.1:123\n"
        "  expected: a port from 1024, or the right to use lower ones\n"
        "  got:      Permission denied\n"
        f"  do next:  leave the port at {RIGCAL_PORT}, where the probe looks by itself"
    )


def test_an_address_of_another_machine_is_told():
    assert refusal("203.0.113.9", 12123) == (
        "this machine cannot listen at that address\n"
        "  where:    203.0.113.9:12123\n"
        "  expected: an address of this machine (`ip address` lists them), or none to listen at all of them\n"
        "  got:      Cannot assign requested address\n"
        "  do next:  mend the address, or leave it out"
    )


def test_a_number_that_is_no_port_is_refused():
    with pytest.raises(OptionError) as caught:
        serve(None, 70_000, stop=threading.Event())
    assert str(caught.value) == (
        "option port is out of range\n"
        "  expected: a number from 0 to 65535\n"
        "  got:      70000\n"
        "  do next:  give port as a number from 0 to 65535"
    )
