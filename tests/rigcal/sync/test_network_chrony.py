"""chronyd: what chronyc prints of it, and a real one on the loopback network."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from contextlib import contextmanager

import pytest

from rigcal.sync.estimator.estimate import estimate_clock
from rigcal.sync.network import NoTracking, Target, Tracking, parse_tracking, probe, read_tracking, tai_confusion
from rigcal.sync.network import chrony as chrony_module

SYNCHRONISED = (
    "C0A80001,192.168.0.1,3,1795341688.635832744,-0.000006523,-0.000006747,0.000035822,-3.225,-0.000,0.129,"
    "0.013639022,0.001100737,64.2,Normal\n"
)
LOCAL = "7F7F0101,,5,1795341688.6,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,Normal"
ADRIFT = "00000000,,0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised"
CHRONYD = shutil.which("chronyd") or shutil.which("chronyd", path="/usr/sbin:/usr/local/sbin")
REAL = pytest.mark.skipif(CHRONYD is None or shutil.which("chronyc") is None, reason="chrony is not installed")


def test_every_field_is_read_in_the_manuals_order():
    assert parse_tracking(SYNCHRONISED) == Tracking(
        reference_id="C0A80001",
        reference="192.168.0.1",
        stratum=3,
        reference_utc_s=1795341688.635832744,
        system_time_s=-0.000006523,
        last_offset_s=-0.000006747,
        rms_offset_s=0.000035822,
        frequency_ppm=-3.225,
        residual_frequency_ppm=0.0,
        skew_ppm=0.129,
        root_delay_s=0.013639022,
        root_dispersion_s=0.001100737,
        update_interval_s=64.2,
        leap_status="Normal",
    )


def test_the_bound_is_the_manuals():
    tracking = parse_tracking(SYNCHRONISED)
    assert tracking.bound_s == pytest.approx(0.000006523 + 0.001100737 + 0.013639022 / 2, abs=1e-12)
    assert tracking.claim.error_s == pytest.approx(tracking.bound_s, abs=1e-12)


@pytest.mark.parametrize("line", [LOCAL, ADRIFT])
def test_a_clock_without_a_source_is_not_synchronised(line):
    tracking = parse_tracking(line)
    assert not tracking.synchronised
    assert tracking.bound_s is None
    assert (tracking.claim.leap, tracking.claim.stratum) == (3, 16)


@pytest.mark.parametrize(
    "line",
    ["", "506 Cannot talk to daemon", SYNCHRONISED.replace("64.2", "nan"), SYNCHRONISED.replace("Normal", "Odd")],
)
def test_another_form_is_not_guessed_at(line):
    assert parse_tracking(line) == NoTracking(
        f"chronyc answers in a form that is not known here: {line.strip()[:120]!r}"
    )


def test_absent_chrony_is_told(monkeypatch):
    monkeypatch.setattr(chrony_module, "_COMMAND", ("no-such-chronyc",))
    assert read_tracking() == NoTracking("chrony is not installed on this machine")


def test_a_silent_chronyd_is_told(monkeypatch):
    monkeypatch.setattr(chrony_module, "_COMMAND", ("sh", "-c", "sleep 5", "chronyc"))
    monkeypatch.setattr(chrony_module, "_TIMEOUT_S", 0.1)
    assert read_tracking() == NoTracking("chronyc gave no answer within 0.1 s")


def test_a_chronyd_that_does_not_run_is_told(monkeypatch):
    monkeypatch.setattr(chrony_module, "_COMMAND", ("sh", "-c", "echo 506 Cannot talk to daemon; exit 1"))
    assert read_tracking() == NoTracking("chronyd does not run, or does not answer chronyc (506 Cannot talk to daemon)")


def test_a_camera_host_on_tai_is_recognised():
    assert tai_confusion(-37.0003, 0.001) == (
        "the camera's host is ahead of the rig's clock by 37.000 s: TAI, the time of PTP, runs 37 s ahead of UTC. Have "
        "the PTP grandmaster announce its UTC offset (currentUtcOffset 37, valid), or have the camera's host apply it "
        "(phc2sys -w), then probe again"
    )


def test_a_rig_on_tai_is_told_from_a_camera_on_tai():
    assert tai_confusion(36.95, 0.001).startswith("the rig's clock is ahead of the host by 36.950 s: TAI")
    assert "have this machine apply it" in tai_confusion(36.95, 0.001)


def test_gps_time_is_recognised():
    assert tai_confusion(-18.01, 0.001) == (
        "the camera's host is ahead of the rig's clock by 18.010 s: GPS time runs 18 s ahead of UTC. Set the GPS "
        "receiver or the time server behind it to give UTC, then probe again"
    )


@pytest.mark.parametrize(("offset_s", "bound_s"), [(0.012, 0.001), (-36.5, 0.001), (37.0, 2.0), (19.0, 0.001)])
def test_other_offsets_are_not_blamed_on_a_time_scale(offset_s, bound_s):
    assert tai_confusion(offset_s, bound_s) is None


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


@contextmanager
def chronyd(folder, *lines):
    """A chronyd that leaves the clock alone; its NTP port and the arguments of chronyc that reach it."""
    folder.mkdir()
    port, command_port = free_port(), free_port()
    entries = [
        f"port {port}",
        f"cmdport {command_port}",
        "bindaddress 127.0.0.1",
        "bindcmdaddress 127.0.0.1",
        "bindcmdaddress /",
        "allow 127.0.0.0/8",
        f"pidfile {folder}/pid",
        *lines,
    ]
    (folder / "chrony.conf").write_text("\n".join(entries) + "\n")
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            [CHRONYD, "-x", "-d", "-f", str(folder / "chrony.conf")], stdout=log, stderr=subprocess.STDOUT
        )
    reach = ("-h", "127.0.0.1", "-p", str(command_port))
    try:
        until_s = time.monotonic() + 5
        while isinstance(read_tracking(reach), NoTracking) and process.poll() is None and time.monotonic() < until_s:
            time.sleep(0.05)
        if process.poll() is not None:
            pytest.skip(f"chronyd does not run here: {(folder / 'log').read_text().splitlines()[-1]}")
        yield port, reach
    finally:
        process.terminate()
        process.wait()


@REAL
def test_a_real_chronyd_is_probed_and_its_clock_is_this_machines(tmp_path):
    with chronyd(tmp_path / "server", "local stratum 5") as (port, _):
        (host,) = probe([Target(("cam0",), "127.0.0.1", port)], seconds=1.0, rate_hz=30.0, timeout_s=0.5)
    assert (host.port, host.ours, host.lost, host.malformed, host.kisses) == (port, False, 0, 0, ())
    assert (host.stratum, host.leap) == (5, 0)
    assert len(host.exchanges) == host.sent == 30
    assert host.exchanges.least_offset_s.max() <= 0 <= host.exchanges.greatest_offset_s.min()
    clock = estimate_clock(host.exchanges).model
    assert abs(clock.offset_s) <= clock.bound_s
    assert host.exchanges.greatest_offset_s.min() - host.exchanges.least_offset_s.max() < 1e-3


@REAL
def test_a_real_chronyd_with_a_source_gives_a_bound(tmp_path):
    with (
        chronyd(tmp_path / "server", "local stratum 5") as (port, alone),
        chronyd(tmp_path / "client", f"server 127.0.0.1 port {port} iburst minpoll -2 maxpoll -2") as (asked, reach),
    ):
        assert not read_tracking(alone).synchronised
        until_s = time.monotonic() + 12
        tracking = read_tracking(reach)
        while (tracking.bound_s is None or tracking.bound_s > 0.05) and time.monotonic() < until_s:
            time.sleep(0.1)
            tracking = read_tracking(reach)
        (host,) = probe([Target(("cam0",), "127.0.0.1", asked)], seconds=0.6, rate_hz=20.0, timeout_s=0.5)
    assert tracking.synchronised
    assert (tracking.reference, tracking.stratum, tracking.leap_status) == ("127.0.0.1", 6, "Normal")
    assert 0 < tracking.bound_s < 0.05
    assert host.stratum == 6
    assert host.claimed_error_s == pytest.approx(tracking.bound_s, abs=0.05)
