"""Clocks through the command line: responders, probes, video, the check before a recording and the report after it.

The site is simulated: four hosts whose clocks are off answer on loopback, and a film of a carried board is stamped by
them. Every fault of the bench is not repeated here, only those that need different parts of the program.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools" / "bench"))
from conftest import command
from sync_sites import AHEAD_S, Fault, check_site, clocks, film_site, hosts, late, right, swapped, write_site

from rigcal.rigfile import digest, read_rigfile
from rigcal.stamps import TIMESTAMPS


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("hall")
    film_site(made, seconds=4.4, fps=15)
    return made


@pytest.fixture(scope="module")
def probed(folder):
    """The rig file with its hosts' clocks, and what the probe said."""
    with hosts(clocks()) as ports:
        write_site(folder / "hall.site.toml", ports)
        return command(
            *("rigcal", "sync", "probe", folder / "hall.site.toml", "--rig", folder / "hall.rig.json"),
            *(
                "--seconds",
                4,
                "--log",
                folder / "board" / "clock_probes.csv",
                "-o",
                folder / "probed.rig.json",
                "--json",
            ),
        )


def test_a_probe_writes_clocks_that_hold_the_truth_with_history_and_gates(folder, probed):
    assert probed.code == 0, probed.out
    document = read_rigfile(folder / "probed.rig.json")
    for camera in document.cameras:
        truth_s = -AHEAD_S[camera.id]  # what to add to its stamps
        assert abs(camera.clock.offset_s - truth_s) <= camera.clock.bound_s
        assert camera.clock.bound_s < 0.003
        assert camera.clock.method == "probe"
    assert [entry.command for entry in document.history] == ["import", "sync probe"]
    assert {gate.camera for gate in document.gates if gate.name == "clock_error_m"} == set(AHEAD_S)
    before = read_rigfile(folder / "hall.rig.json")
    assert document.geometry_digest == before.geometry_digest
    assert document.digest == digest(json.loads((folder / "probed.rig.json").read_text()))
    assert (folder / "probed.report.html").exists()


def test_video_finds_the_clocks_that_nobody_probed(folder):
    out = folder / "video.rig.json"
    told = command("rigcal", "sync", "video", folder / "board", "--rig", folder / "hall.rig.json", "-o", out, "--json")
    assert told.code == 0, told.out
    assert told.json["method"] == "board"
    for camera in read_rigfile(out).cameras[1:]:
        truth_s = AHEAD_S["cam0"] - AHEAD_S[camera.id]
        assert camera.clock.method == "video"
        assert abs(camera.clock.offset_s - truth_s) <= camera.clock.bound_s < 0.001


def test_videos_without_stamps_get_them_so_that_their_clocks_can_be_used(folder, tmp_path):
    shutil.copytree(folder / "board", tmp_path / "board")
    (tmp_path / "board" / TIMESTAMPS).unlink()
    out = tmp_path / "video.rig.json"
    told = command(
        "rigcal", "sync", "video", tmp_path / "board", "--rig", folder / "hall.rig.json", "-o", out, "--timestamps"
    )
    assert f"stamps {tmp_path / 'board' / TIMESTAMPS}" in "".join(told.out.split("\n"))
    rows = (tmp_path / "board" / TIMESTAMPS).read_text().splitlines()
    assert rows[0] == "cam_id,frame_time"
    assert len(rows) > 250
    assert abs(read_rigfile(out).cameras[1].clock.offset_s) < 0.001  # all cameras began together, and only that shows


def test_without_a_rig_whole_frames_are_compared_and_nothing_is_written(folder):
    before = sorted(folder.iterdir())
    told = command("rigcal", "sync", "video", folder / "board", "--json")
    assert told.json["method"] == "motion energy"
    assert told.json["rig_file"] is None
    for camera in told.json["cameras"]:
        if camera["confident"] and camera["id"] != "cam0":
            assert camera["bound_s"] >= 0.5 / 15
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    "fault",
    [
        Fault("healthy", "", ""),
        Fault("12 ms offset", "cam1", "offset", film=late),
        Fault("swapped files", "cam1+cam2", "swapped cameras", film=swapped),
        Fault("dead host", "cam0", "dead host", dead=("cam0",)),
    ],
    ids=lambda fault: fault.name.replace(" ", "_"),
)
def test_the_check_names_camera_and_fault(folder, fault):
    checked = check_site(folder, fault, seconds=4.0)
    assert right(fault, checked), checked


def test_the_check_speaks_to_a_technician(folder, probed):
    told = command("rigcal", "sync", "verify", folder / "probed.rig.json", folder / "board", "--seconds", 1)
    assert told.code == 1  # the hosts that the rig file remembers are gone
    assert told.out.startswith("RED do not record yet: cam0, cam1, cam2, cam3 (limit 20 mm at 2 m/s)")
    assert re.search(r"cam2 red: its host 127\.0\.0\.1:\d+ does not answer", told.out)
    assert "do next: see that 127.0.0.1" in " ".join(told.out.split())


def test_the_report_of_a_capture_is_one_page(folder, probed):
    told = command(
        *("rigcal", "sync", "report", folder / "board", "--rig", folder / "probed.rig.json", "--json"),
        *("--site", folder / "hall.site.toml", "-o", folder / "sync.html"),
    )
    assert told.code == 0, told.out
    assert {camera["camera"] for camera in told.json["cameras"]} == set(AHEAD_S)
    page = (folder / "sync.html").read_text()
    assert page.count("<svg") >= 4
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_the_responder_answers_until_it_is_stopped(tmp_path):
    program = [sys.executable, "-u", "-c", "from rigcal.cli import main; main()"]
    serving = subprocess.Popen(
        [*program, "sync", "serve", "--port", "0", "--address", "127.0.0.1"], stdout=subprocess.PIPE, text=True
    )
    first = serving.stdout.readline()
    port = re.search(r"127\.0\.0\.1:(\d+)", first)[1]
    from rigcal.sync.network import probe, targets_of

    (found,) = probe(targets_of([f"127.0.0.1:{port}"], ["cam0"]), seconds=0.5)
    serving.terminate()
    rest, _ = serving.communicate(timeout=10)
    assert serving.returncode == 0
    assert len(found.exchanges) >= 4
    assert np.abs(found.exchanges.least_offset_s).max() < 0.1
    assert re.match(r"answered \d+ requests", rest)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("probe", "a", "b", "--rig", "{rig}"), "it is not clear which host tells which camera's time"),
        (("probe", "cam9=a", "--rig", "{rig}"), "the rig has no camera 'cam9'"),
        (("probe", "h", "--rig", "{rig}", "--seconds", "0"), "option seconds is out of range"),
        (("video", "{board}", "--by", "people"), "option --by people is out of range"),
        (("video", "{board}", "--by", "board"), "option --by board is out of range"),
        (("video", "{board}", "--rig", "{rig}", "--readout", "20"), "expected: 20ms, or CAMERA=20ms"),
        (("verify", "{rig}", "rtsp://a", "rtsp://b"), "expected: one capture folder, 4 URLs in rig order"),
        (("report", "{board}/nothing"), "no such folder"),
        (("serve", "--port", "99999"), "option port is out of range"),
    ],
)
def test_bad_input_is_told_in_words(folder, arguments, words):
    filled = [text.format(rig=folder / "hall.rig.json", board=folder / "board") for text in arguments]
    told = command("rigcal", "sync", *filled)
    assert told.code == 2
    assert " ".join(words.split()) in " ".join(told.err.split())


def test_images_without_times_cannot_be_compared_and_the_message_says_what_to_do(folder, tmp_path):
    for camera_id in AHEAD_S:
        (tmp_path / camera_id).mkdir()
        assert cv2.imwrite(str(tmp_path / camera_id / "0001.png"), np.zeros((9, 16), np.uint8))
    told = command("rigcal", "sync", "video", tmp_path)
    assert told.code == 2
    assert "the capture does not say when its frames were taken" in told.err
    assert "write timestamps.csv" in told.err
