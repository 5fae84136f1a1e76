"""Packets against figures of RFC 5905 and a reader that knows only the RFC's layout."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from rigcal.sync.exchanges import UNKNOWN
from rigcal.sync.network.clocks import SimulatedClock, SystemClock, read_both_ns
from rigcal.sync.network.packet import (
    UNSYNCHRONISED,
    Claim,
    ns_from_ntp,
    ntp_from_ns,
    read_answer,
    read_request,
    write_answer,
    write_request,
)

NONCE = bytes(range(8))
NOW_NS = 1_795_341_690_123_456_789


def header_of(data):
    """The RFC's figure 8, word by word, as other clients read it."""
    names = ("flags", "stratum", "poll", "precision", "root_delay", "root_dispersion", "reference_id")
    values = struct.unpack("!BBbb11I", data[:48])
    header = dict(zip(names, values[:7], strict=True))
    stamps = values[7:]
    for i, name in enumerate(("reference", "origin", "receive", "transmit")):
        header[name] = stamps[2 * i] + stamps[2 * i + 1] / 2**32
    return header


@pytest.mark.parametrize(
    ("unix_s", "seconds_of_era"),
    [
        (0, 2_208_988_800),
        (946_684_800, 3_155_673_600),  # 1 Jan 2000 (RFC 5905, figure 4)
        (2_085_955_200, 4_294_944_000),  # 7 Feb 2036, the last day that begins in era 0
        (2_086_041_600, 63_104),  # 8 Feb 2036, the first day that begins in era 1
    ],
)
def test_timestamps_are_those_of_the_rfc_in_either_era(unix_s, seconds_of_era):
    assert ntp_from_ns(unix_s * 10**9) == seconds_of_era << 32
    assert ns_from_ntp(seconds_of_era << 32) == unix_s * 10**9


def test_timestamps_round_trip_to_the_nanosecond():
    rng = np.random.default_rng(1)
    times_ns = rng.integers(0, 4_102_444_800 * 10**9, 20_000).tolist()
    assert [ns_from_ntp(ntp_from_ns(t)) for t in times_ns] == times_ns


def test_a_clock_that_came_up_without_its_battery_is_read_as_1970():
    assert ns_from_ntp(ntp_from_ns(12_000_000_000)) == 12_000_000_000


def test_a_plain_request_is_48_bytes_that_tell_nothing_but_the_nonce():
    request = write_request(NONCE, extended=False)
    assert request == bytes([0b00_100_011]) + bytes(39) + NONCE
    assert read_request(request).nonce == NONCE
    assert not read_request(request).extended


def test_our_request_adds_a_well_formed_extension_field():
    request = write_request(NONCE, extended=True)
    kind, length = struct.unpack_from("!HH", request, 48)
    assert 0xF000 <= kind <= 0xFFFF  # set aside for experiments
    assert length == len(request) - 48 == 28  # the least of a last field without a MAC (RFC 7822, section 7.5)
    assert read_request(request).extended


def test_an_answer_holds_the_times_in_the_places_of_the_rfc():
    claim = Claim(1, 3, 0.0125, 0.001)
    data = write_answer(read_request(write_request(NONCE, extended=False)), claim, NOW_NS, NOW_NS + 5_000, 77)
    header = header_of(data)
    assert len(data) == 48
    assert header["flags"] == 0b01_100_100
    assert header["stratum"] == 3
    assert header["root_delay"] / 65536 == pytest.approx(0.0125, abs=1 / 65536)
    assert header["root_dispersion"] / 65536 >= 0.001
    assert header["origin"] == int.from_bytes(NONCE, "big") / 2**32
    assert header["receive"] - 2_208_988_800 == pytest.approx(NOW_NS * 1e-9, abs=1e-6)
    assert header["transmit"] - header["receive"] == pytest.approx(5e-6, abs=1e-6)


@pytest.mark.parametrize("extended", [False, True])
def test_an_answer_is_as_long_as_its_request_and_reads_back(extended):
    request = write_request(NONCE, extended=extended)
    data = write_answer(read_request(request), Claim(0, 2, 0.5, 0.25), NOW_NS, NOW_NS + 1, 123_456_789)
    answer = read_answer(data)
    assert len(data) == len(request)
    assert (answer.received_ns, answer.replied_ns, answer.nonce) == (NOW_NS, NOW_NS + 1, NONCE)
    assert answer.monotonic_ns == (123_456_789 if extended else UNKNOWN)
    assert answer.claim.error_s == 0.5


def test_a_host_that_is_not_synchronised_says_so_and_claims_no_error():
    request = read_request(write_request(NONCE, extended=False))
    data = write_answer(request, UNSYNCHRONISED, NOW_NS, NOW_NS, 0)
    assert data[0] >> 6 == 3
    assert data[1] == 0  # stratum 16 on the wire
    assert data[12:16] == b"INIT"
    answer = read_answer(data)
    assert answer.kiss is None
    assert (answer.leap, answer.stratum, answer.claim.error_s) == (3, 16, None)


def test_bounds_in_a_packet_are_rounded_up():
    request = read_request(write_request(NONCE, extended=False))
    answer = read_answer(write_answer(request, Claim(0, 1, 1e-9, 1e-9), NOW_NS, NOW_NS, 0))
    assert answer.root_delay_s >= 1e-9
    assert answer.root_dispersion_s >= 1e-9


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(47),
        write_request(NONCE, extended=False)[:47],
        bytes([0b00_100_100]) + bytes(47),  # an answer
        bytes([0b00_100_001]) + bytes(47),  # a peer
        bytes([0b00_100_110]) + bytes(47),  # a control message
        bytes([0b00_111_011]) + bytes(47),  # version 7
        bytes([0b00_000_011]) + bytes(47),  # version 0
    ],
)
def test_what_is_no_request_is_none(data):
    assert read_request(data) is None


def test_what_is_no_answer_is_none():
    answer = write_answer(read_request(write_request(NONCE, extended=False)), UNSYNCHRONISED, NOW_NS, NOW_NS, 0)
    assert read_answer(answer[:47]) is None
    assert read_answer(write_request(NONCE, extended=True)) is None
    assert read_answer(answer[:32] + bytes(16)) is None  # it tells no time


def test_a_field_of_another_kind_is_not_taken_for_ours():
    plain = write_request(NONCE, extended=False)
    assert not read_request(plain + struct.pack("!HH24x", 0xF323, 28)).extended
    assert not read_request(plain + bytes(20)).extended  # a MAC


def test_a_simulated_clock_is_as_wrong_as_told():
    clock = SimulatedClock(offset_s=-2.5, skew_ppm=100, step_s=0.25, step_after_s=10, start_ns=10**18)
    assert clock.ahead_s(10**18) == -2.5
    assert clock.ahead_s(10**18 + 9 * 10**9) == pytest.approx(-2.5 + 9e-4, abs=1e-12)
    assert clock.realtime_at_ns(10**18 + 10**10) == 10**18 + 10**10 - 2_500_000_000 + 250_000_000 + 1_000_000


def test_a_simulated_step_leaves_the_monotonic_clock_alone():
    stepped = SimulatedClock(step_s=5.0, step_after_s=0.0)
    realtime_ns, monotonic_ns = read_both_ns(stepped)
    true_ns, true_monotonic_ns = read_both_ns(SystemClock())
    assert realtime_ns - true_ns == pytest.approx(5e9, abs=5e7)
    assert 0 <= true_monotonic_ns - monotonic_ns < 5e7
