"""The machine's check-up: this machine passes, and every check shows each of its outcomes."""

import json
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import cv2
import pytest
from typer.testing import CliRunner

from rigcal import doctor
from rigcal.cli import app
from rigcal.doctor import (
    Check,
    check_cache,
    check_clock,
    check_cores,
    check_disk,
    check_memory,
    check_opencv,
    check_packages,
    check_pycolmap,
    check_python,
    check_time_service,
    check_video,
    examine_machine,
    healthy,
)
from rigcal.sync.network import NoTracking, parse_tracking

NOW = datetime(2030, 5, 1, 7, 0, tzinfo=UTC)


def test_a_machine_that_runs_these_tests_is_healthy(tmp_path, monkeypatch):
    monkeypatch.setenv("RIGCAL_CACHE", str(tmp_path / "cache"))
    checks = examine_machine(tmp_path, datetime.now(UTC))
    assert healthy(checks), [check for check in checks if check.status == "failed"]
    assert [check.name for check in checks] == [
        *("python", "packages", "opencv", "pycolmap", "onnxruntime", "video"),
        *("cache", "disk", "cores", "memory", "clock", "time service"),
    ]
    for check in checks:
        assert (check.do_next is None) == (check.status == "ok")


def test_an_old_python_fails():
    assert check_python((3, 11, 2), ">=3.11").status == "ok"
    assert check_python((3, 9, 2), ">=3.11") == Check(
        "python", "failed", "3.9.2, needs >=3.11", "install that Python and make a new virtual environment"
    )


def test_absent_and_old_packages_are_named():
    installed = {"numpy": "2.10.1", "scipy": "1.9.0"}
    good, *wrong = check_packages(["numpy>=2.2", "scipy>=1.15", "mcap>=1.6"], installed.get)
    assert good.detail == "1 of 3 present and new enough"
    assert [(check.name, check.status, check.detail) for check in wrong] == [
        ("package scipy", "failed", "1.9.0, needs 1.15 or newer"),
        ("package mcap", "failed", "not installed, needs 1.6 or newer"),
    ]
    assert all("fresh virtual environment" in check.do_next for check in wrong)


def test_an_opencv_without_aruco_fails_and_two_opencvs_warn():
    poor = SimpleNamespace(__version__="4.2.0", fisheye=None, findChessboardCornersSB=None, CALIB_CB_LARGER=1)
    failed = check_opencv(poor, ["opencv-python"])
    assert failed.status == "failed"
    assert failed.detail == "4.2.0 of opencv-python lacks aruco.CharucoDetector, aruco.ArucoDetector"
    assert "install opencv-contrib-python-headless" in failed.do_next
    doubled = check_opencv(cv2, ["opencv-contrib-python-headless", "opencv-python"])
    assert doubled.status == "warning"
    assert "overwrite each other's files" in doubled.detail


@pytest.mark.parametrize(("name", "check"), [("onnxruntime", doctor.check_onnxruntime), ("video", check_video)])
def test_a_library_that_does_not_load_fails_with_its_message(monkeypatch, tmp_path, name, check):
    def missing(library):
        raise ImportError(f"lib{library}.so: cannot open shared object file")

    monkeypatch.setattr(doctor, "import_module", missing)
    with pytest.raises(ImportError, match="cannot open shared object file"):
        check()
    found = {check.name: check for check in examine_machine(tmp_path, datetime.now(UTC))}[name]
    assert found.status == "failed"
    assert found.detail.startswith("cannot be loaded: lib")
    assert not healthy([found])


def test_a_solver_that_finds_another_rig_fails(monkeypatch):
    assert check_pycolmap().status == "ok"

    def idle(observations, start, *, free_lenses):
        return SimpleNamespace(cam_from_rig=start.cam_from_rig)

    monkeypatch.setattr("rigcal._colmap.solve_with_colmap", idle)
    found = check_pycolmap()
    assert (found.status, found.detail) == ("failed", "a small rig came out 20 mm off")


def test_a_pyav_without_h264_fails(monkeypatch):
    import av

    def refuse(*arguments, **options):
        raise av.codec.codec.UnknownCodecError("h264")

    monkeypatch.setattr(av, "open", refuse)
    found = check_video()
    assert found.status == "failed"
    assert found.detail.endswith("cannot encode and decode H.264: h264")


def test_a_cache_that_cannot_be_written_to_warns(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"x" * 1024)
    assert check_cache(tmp_path).detail == f"{tmp_path}, 0.00 GiB of board detections"
    file = tmp_path / "file"
    file.write_text("not a folder")
    found = check_cache(file / "cache")
    assert found.status == "warning"
    assert found.detail == f"{file / 'cache'}: Not a directory"
    assert found.do_next.startswith("set RIGCAL_CACHE to a folder that can be written to")


def test_a_large_cache_warns(tmp_path, monkeypatch):
    (tmp_path / "a.npz").write_bytes(b"x" * 1024)
    monkeypatch.setattr(doctor, "LARGE_CACHE_GIB", 1e-7)
    assert check_cache(tmp_path).status == "warning"


@pytest.mark.parametrize(
    ("check", "status"),
    [
        (check_disk, {100.0: "ok", 3.0: "warning", 0.05: "failed"}),
        (lambda _, gib: check_memory(gib), {16.0: "ok", 1.0: "warning", None: "ok"}),
        (lambda _, cores: check_cores(cores), {8: "ok", 1: "warning"}),
    ],
)
def test_little_of_something_warns(tmp_path, check, status):
    for amount, expected in status.items():
        found = check(tmp_path, amount)
        assert found.status == expected
        assert (found.do_next is None) == (expected == "ok")


def test_a_machine_without_a_time_service_is_told_so():
    line = "7F000001,127.0.0.1,9,1795000000.0,0.000001164,0.0,0.0,-11.2,0.0,0.1,0.000002461,0.000001559,0.3,Normal"
    kept = check_time_service(parse_tracking(line))
    assert (kept.status, kept.detail) == ("ok", "chronyd keeps this clock within 0.00395 ms of UTC")
    adrift = check_time_service(parse_tracking(line.replace("Normal", "Not synchronised")))
    assert (adrift.status, adrift.detail) == ("warning", "chronyd runs and is not synchronised")
    absent = check_time_service(NoTracking("chrony is not installed on this machine"))
    assert absent.detail == "nothing says how far this clock is from UTC: chrony is not installed on this machine"
    assert "install chrony" in absent.do_next


def test_a_clock_before_the_installation_is_wrong():
    assert check_clock(NOW, NOW - timedelta(days=1)).status == "ok"
    found = check_clock(datetime(1970, 1, 1, 0, 3, tzinfo=UTC), NOW)
    assert found == Check(
        "clock",
        "failed",
        "1970-01-01 00:03:00 UTC is before this package was installed, 2030-05-01 07:00:00 UTC",
        "set the system's time, best by turning on network time; dates in rig files would be wrong",
    )


def test_the_command_exits_with_1_when_something_failed(monkeypatch):
    good, bad = Check("disk", "ok", "9 GiB"), Check("clock", "failed", "1970", "set it")
    monkeypatch.setattr(doctor, "examine_machine", lambda folder, now: (good, bad))
    shown = CliRunner().invoke(app, ["doctor"])
    assert shown.exit_code == 1
    assert shown.stdout.splitlines() == ["ok       disk   9 GiB", "failed   clock  1970", " " * 16 + "do next: set it"]
    told = json.loads(CliRunner().invoke(app, ["doctor", "--json"]).stdout)
    assert told["healthy"] is False
    assert told["checks"][1] == {"name": "clock", "status": "failed", "detail": "1970", "do_next": "set it"}
    monkeypatch.setattr(doctor, "examine_machine", lambda folder, now: (good,))
    assert CliRunner().invoke(app, ["doctor"]).exit_code == 0
