"""Claims about `rigcal sync probe --from-log`: a log gives the clocks that asking gave, and what it lacks is told."""

import json

import pytest
from typer.testing import CliRunner

from rigcal.cli import app
from rigcal.errors import OptionError, ProbeLogError
from rigcal.rigfile import document_of_rig, read_rigfile, write_rigfile
from rigcal.sync.estimator.networks import BUSY, LAN, START_NS, HostOscillator, simulate_exchanges, true_clock
from rigcal.sync.log import append_exchanges
from rigcal.synthetic import arc_rig

OSCILLATORS = {"cam0": HostOscillator(0.012, 4.0), "cam1": HostOscillator(-0.031, -9.0, tells_monotonic=True)}
SECONDS = 60.0
HOSTS = ("cam0=pi-0.local", "cam1=pi-1.local:123")


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "hall.rig.json"
    write_rigfile(document_of_rig(arc_rig(2), created_utc="2026-11-22T09:00:00Z", inputs_sha256="0" * 64), path)
    return path


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "clock_probes.csv"
    append_exchanges(path, answers(OSCILLATORS))
    return path


def answers(oscillators):
    networks = (LAN, BUSY)
    return {
        camera_id: simulate_exchanges(networks[k], oscillator, seconds=SECONDS, rate_hz=2.0, seed=k)
        for k, (camera_id, oscillator) in enumerate(oscillators.items())
    }


def run(*arguments, code):
    done = CliRunner().invoke(app, ["sync", "probe", *map(str, arguments)])
    assert done.exit_code == code, done.output
    return done


def refused(error, *arguments):
    with pytest.raises(error) as caught:
        CliRunner().invoke(app, ["sync", "probe", *map(str, arguments)], catch_exceptions=False)
    return caught.value


def test_the_clocks_of_a_log_hold_the_truth_and_remember_host_and_evidence(rig, log):
    told = json.loads(run(*HOSTS, "--rig", rig, "--from-log", log, "--json", code=0).output)
    document = read_rigfile(rig)
    for number, camera in enumerate(document.cameras):
        truth = true_clock(OSCILLATORS[camera.id], seconds=SECONDS, seed=number)
        at_s = camera.clock.at_utc
        elapsed = true_elapsed_s(at_s)
        assert abs(camera.clock.offset_s - float(truth.offset_s(elapsed))) <= camera.clock.bound_s < 0.002
        evidence = document.extensions["rigcal"]["clocks"][camera.id]
        assert evidence["host"] == HOSTS[number].partition("=")[2]
        assert evidence["exchanges"] == 120
    assert [gate.passed for gate in document.gates if gate.name == "clock_error_m"] == [True, True]
    assert document.history[-1].command == "sync probe"
    assert [(host["answered"], host["sent"], host["lost"]) for host in told["hosts"]] == [(True, None, None)] * 2
    assert told["torn_rows"] == 0


def true_elapsed_s(at_utc):
    from datetime import datetime

    return datetime.fromisoformat(at_utc).timestamp() - START_NS * 1e-9


def test_the_hosts_of_a_site_file_serve_as_well(rig, log, tmp_path):
    site = tmp_path / "hall.site.toml"
    cameras = (
        f'[[cameras]]\nid = "cam{k}"\nclock = "ntp://pi-{k}.local"\ncapture_latency_s = 0.01\n' for k in range(2)
    )
    site.write_text('site = "hall"\n' + "".join(cameras))
    run(site, "--rig", rig, "--from-log", log, code=0)
    latency = read_rigfile(rig).extensions["rigcal"]["clocks"]["cam1"]["latency"]
    assert latency == {"latency_s": 0.01, "bound_s": 0.0, "source": "site file"}


def test_what_of_the_log_was_used_is_said_and_an_unfinished_row_is_counted(rig, log):
    log.write_bytes(log.read_bytes()[:-20])
    out = run(*HOSTS, "--rig", rig, "--from-log", log, code=0).output
    words = " ".join(out.split())
    assert f"239 answers from {log}" in words
    assert "its last row is unfinished and was left out" in words
    assert "Rig time is this machine's clock" not in words


def test_a_camera_that_the_log_lacks_is_told_and_the_others_are_written(rig, tmp_path):
    half = tmp_path / "half.csv"
    append_exchanges(half, answers({"cam0": OSCILLATORS["cam0"]}))
    out = run(*HOSTS, "--rig", rig, "--from-log", half, code=1).output
    assert "the log holds no answer of it" in " ".join(out.split())
    assert [camera.clock is not None for camera in read_rigfile(rig).cameras] == [True, False]


def test_an_empty_log_is_refused_and_nothing_is_written(rig, tmp_path):
    empty = tmp_path / "empty.csv"
    append_exchanges(empty, {})
    before = rig.read_bytes()
    assert str(refused(ProbeLogError, *HOSTS, "--rig", rig, "--from-log", empty)) == (
        "the log holds no probe\n"
        f"  where:    {empty}\n"
        "  expected: rows of answered probes below the first line\n"
        "  got:      no whole row\n"
        "  do next:  give the log of a probe that was answered, or probe the hosts: leave --from-log out"
    )
    assert rig.read_bytes() == before


def test_a_camera_that_the_rig_has_not_is_refused(rig, log):
    append_exchanges(log, {"cam7": answers(OSCILLATORS)["cam0"][:3]})
    error = refused(ProbeLogError, *HOSTS, "--rig", rig, "--from-log", log)
    assert error.what == "the rig has no camera 'cam7'"
    assert error.expected == "cameras of the rig: cam0, cam1"


def test_a_camera_without_a_named_host_is_refused(rig, log):
    error = refused(ProbeLogError, HOSTS[0], "--rig", rig, "--from-log", log)
    assert error.what == "it is not said on which host cam1 hangs"
    assert error.do_next == "add clock = entries to the site file, or name them: CAMERA=HOST"


@pytest.mark.parametrize("option", ["--seconds", "--rate", "--log"])
def test_options_of_asking_have_no_place_beside_a_log(rig, log, option):
    error = refused(OptionError, *HOSTS, "--rig", rig, "--from-log", log, option, "5")
    assert error.what == f"option {option} is out of range"
    assert error.expected == f"{option} without --from-log, which asks no host"


def test_the_same_log_gives_the_same_clocks(rig, log, tmp_path):
    for name in ("one", "two"):
        run(*HOSTS, "--rig", rig, "--from-log", log, "-o", tmp_path / f"{name}.rig.json", code=0)
    one, two = (read_rigfile(tmp_path / f"{name}.rig.json") for name in ("one", "two"))
    assert [camera.clock for camera in one.cameras] == [camera.clock for camera in two.cameras]
