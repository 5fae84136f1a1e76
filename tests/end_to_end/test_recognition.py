"""recognition through its command line: run, check and recover, and a message for every bad input."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from conftest import REAL, command

from recognition.observations import ViewDetections
from recognition.recording import iter_messages, read_metadata
from recognition.sources.detections_file import write_detections
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from rigcal.rig import ClockModel
from rigcal.rigfile import document_of_rig, read_rigfile, write_rigfile

real = pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")
FRAMES, FPS = 150, 30.0


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A rig file, and the detections of two workers over five seconds."""
    folder = tmp_path_factory.mktemp("simulated")
    rig = semicircle_rig()
    document = document_of_rig(rig, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(document, folder / "s.rig.json")
    site = simulate(rig, workers=2, frames=FRAMES, fps=FPS, seed=1)
    views = [[view.detections for view in observe(site, frame)] for frame in range(FRAMES)]
    write_detections(folder / "d.npz", views, time_s=(site.t_ns * 1e-9).tolist())
    return folder


def test_detections_become_tracks_poses_and_a_recording(simulated, tmp_path):
    done = command(
        "recognition", "run", simulated / "s.rig.json", "--detections", simulated / "d.npz",
        "-o", tmp_path / "r.mcap", "--poses", tmp_path / "p.npz", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert list(done.json["workers"].values()) == [FRAMES, FRAMES]
    with np.load(tmp_path / "p.npz") as data:
        assert len(data["frame"]) == 2 * FRAMES
        assert len(set(data["track_id"].tolist())) == 2
        assert (
            0.0 < np.nanmin(data["joints_m"][..., 2]) < np.nanmax(data["joints_m"][..., 2]) < 2.0
        )  # z up, in the world
    checked = command("recognition", "check", tmp_path / "r.mcap", "--json")
    assert checked.code == 0
    assert checked.json["ok"] is True


def test_views_can_be_left_out(simulated, tmp_path):
    done = command(
        "recognition", "run", simulated / "s.rig.json", "--detections", simulated / "d.npz",
        "-o", tmp_path / "r.mcap", "--views", "cam0,cam2", "--association", "paper", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert [done.json["people_detected"][c] > 0 for c in ("cam0", "cam1", "cam2", "cam3")] == [True, False, True, False]


def test_a_killed_recording_is_recovered_up_to_the_last_second(simulated, tmp_path):
    """Paced at 30 instants a second and killed after 1.7-2.7 s: exit 3, everything older than a second is there."""
    seconds = float(np.random.default_rng(5).uniform(1.7, 2.7))
    executable = Path(sys.executable).parent / "recognition"
    arguments = [
        "run",
        simulated / "s.rig.json",
        "--detections",
        simulated / "d.npz",
        "-o",
        tmp_path / "r.mcap",
        "--realtime",
    ]
    run = subprocess.Popen([executable, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    part = tmp_path / "r.mcap.part"
    while not part.exists():
        time.sleep(0.01)
    started = time.monotonic()
    time.sleep(seconds)
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    lasted = time.monotonic() - started
    assert not (tmp_path / "r.mcap").exists()
    assert command("recognition", "check", part).code == 1
    done = command("recognition", "recover", part, "-o", tmp_path / "r.mcap")
    assert done.code == 3
    assert "lost:" in done.out
    scenes = [m.log_ns for m in iter_messages(tmp_path / "r.mcap", ["/scene"])]
    assert scenes == [round(i / FPS * 1e9) for i in range(len(scenes))]
    assert len(scenes) >= (lasted - 1.0 - 0.3) * FPS  # the first 0.3 s: the loop's start after the file's
    assert command("recognition", "check", tmp_path / "r.mcap").code == 0


def test_the_keyboard_ends_a_run_and_keeps_its_recording(simulated, tmp_path):
    executable = Path(sys.executable).parent / "recognition"
    arguments = ["run", simulated / "s.rig.json", "--detections", simulated / "d.npz", "-o", tmp_path / "r.mcap"]
    run = subprocess.Popen([executable, *arguments, "--realtime"], stdout=subprocess.PIPE, text=True)
    while not (tmp_path / "r.mcap.part").exists():
        time.sleep(0.01)
    time.sleep(1.5)
    run.send_signal(signal.SIGINT)
    out = run.communicate(timeout=30)[0]
    assert run.returncode == 0
    assert "stopped by the keyboard" in out
    checked = command("recognition", "check", tmp_path / "r.mcap", "--json")
    assert checked.json["ok"] is True
    assert 0 < checked.json["messages"]["/scene"] < FRAMES


def test_an_earlier_part_is_not_overwritten(simulated, tmp_path):
    (tmp_path / "r.mcap.part").write_bytes(b"an earlier run")
    done = command(
        "recognition", "run", simulated / "s.rig.json", "--detections", simulated / "d.npz", "-o", tmp_path / "r.mcap"
    )
    assert done.code == 2
    assert "recognition recover" in done.err
    assert (tmp_path / "r.mcap.part").read_bytes() == b"an earlier run"


# --- captures named by timestamp ------------------------------------------------------------------------------------

START_NS = 1_775_986_201_250_000_000  # 2026-04-12T09:30:01.25Z
CLOCKS = {
    "cam1": ClockModel(0.5120004, 45.0, "2026-04-12T09:00:00Z", 2e-4, 0.05, "probe"),
    "cam2": ClockModel(-1.2839991, -60.0, "2026-04-12T09:00:00Z", 1.5e-3, 0.1, "video"),
}
"""Half an hour before the capture: the drifts have added 82 and -108 ms, which is one and more than one frame."""
LOST = {"cam1": (20, 21), "cam2": (33,)}
STAMPED_FRAMES, STAMPED_FPS = 60, 15.0
LATE_NS = {"cam0": 0, "cam1": 21_000_000, "cam2": 9_000_000}


def name_of(camera, t_ns):
    """The paper's way, an integer of nanoseconds, and one of microseconds."""
    if camera == "cam0":
        second, rest = divmod(t_ns, 10**9)
        return f"{datetime.fromtimestamp(second, UTC):%Y%m%dT%H%M%S}.{rest // 1000:06d}Z"
    return f"{t_ns}" if camera == "cam1" else f"{t_ns // 1000}"


@pytest.fixture(scope="module")
def stamped(tmp_path_factory):
    """Images named by the cameras' own clocks, detections by instant, and the truth in rig time.

    The clocks of cam1 and cam2 are off and drift; both lost frames. Each worker is seen where he was at the time of
    each frame.
    """
    folder = tmp_path_factory.mktemp("stamped")
    rig = semicircle_rig(3, size_wh=(160, 90))
    timed = replace(rig, cameras=tuple(replace(c, clock=CLOCKS.get(c.id)) for c in rig.cameras))
    for name, made in (("with", timed), ("without", rig)):
        document = document_of_rig(made, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
        write_rigfile(document, folder / f"{name}.rig.json")
    dense = simulate(rig, workers=2, frames=4500, fps=1000.0, seed=5)
    image = cv2.imencode(".jpg", np.full((90, 160, 3), 90, np.uint8))[1].tobytes()
    views = []
    for n in range(STAMPED_FRAMES):
        at_ns = [round(n * 1e9 / STAMPED_FPS) + late for late in LATE_NS.values()]
        seen = [observe(dense, round(t * 1e-6))[v].detections for v, t in enumerate(at_ns)]
        for v, camera in enumerate(LATE_NS):
            if n in LOST.get(camera, ()):
                seen[v] = ViewDetections.empty()
                continue
            t_cam_ns = camera_stamp_ns(CLOCKS.get(camera), START_NS + at_ns[v])
            place = folder / "capture" / camera / f"{name_of(camera, t_cam_ns)}.jpg"
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(image)
        views.append(seen)
    write_detections(folder / "d.npz", views)
    return folder, dense


def camera_stamp_ns(clock, t_rig_ns):
    """What a camera's clock shows at a rig time: the model solved for it, in integers."""
    if clock is None:
        return t_rig_ns
    at_ns, rate = round(clock.at_s) * 10**9, clock.drift_ppm * 1e-6
    since_ns = t_rig_ns - at_ns - round(clock.offset_s * 1e9)
    return at_ns + since_ns - round(since_ns * rate / (1 + rate))


def run_stamped(folder, output, *options, rig="with"):
    """By the paper's method, which places each instant by itself: what is off is off by the clocks."""
    done = command(
        "recognition", "run", folder / f"{rig}.rig.json", "--source", folder / "capture",
        "--detections", folder / "d.npz", "-o", output, "--poses", output.with_suffix(".npz"),
        "--association", "paper", *options,
    )  # fmt: skip
    assert done.code == 0, done.err
    return done


def joint_errors_mm(path, dense):
    """Median distance of the joints from where they were at the instants' common times."""
    truth = dense.joints_in_world_m
    with np.load(path) as data:
        at = np.rint((data["t_ns"] - START_NS) * 1e-6).astype(int)
        gaps = np.linalg.norm(data["joints_m"][:, None] - truth[at], axis=-1)
    return 1e3 * float(np.nanmedian(np.nanmedian(gaps, axis=2).min(axis=1)))


@pytest.fixture(scope="module")
def grouped(stamped):
    """A run with the clocks of the rig; its recording is ``r.mcap``."""
    return run_stamped(stamped[0], stamped[0] / "r.mcap", "--json").json


def test_images_named_by_time_are_grouped_by_the_clocks_of_the_rig(stamped, grouped):
    folder, dense = stamped
    sync = grouped["sync"]
    counts = [(c["frames"], c["missing"], c["repeated"], c["alone"]) for c in sync["cameras"]]
    assert counts == [(60, 0, 0, 0), (58, 2, 0, 0), (59, 1, 0, 0)]
    assert (sync["rule"], sync["instants"], sync["alone"]) == ("file times", 60, 0)
    assert sync["spread_median_s"] == pytest.approx(0.021, abs=1e-6)
    clocks = [c["clock"] for c in sync["cameras"]]
    assert clocks[0] is None
    assert [c["method"] for c in clocks[1:]] == ["probe", "video"]
    assert clocks[1]["age_s"] == pytest.approx(1801.25 + 59 / 15, abs=1.0)
    assert clocks[1]["bound_s"] == pytest.approx(2e-4 + 1805 * 0.05e-6, rel=0.01)
    assert "the stamps of cam0 are taken as rig time" in grouped["warnings"][0]
    assert len(grouped["workers"]) == 2
    assert min(grouped["workers"].values()) >= 55
    assert joint_errors_mm(folder / "r.npz", dense) < 6.0  # measured: 4.5 mm
    own = {"/cam0/image": [], "/cam1/image": [], "/cam2/image": [], "/scene": []}
    for message in iter_messages(folder / "r.mcap", list(own)):
        own[message.topic].append(message.publish_ns - START_NS)
    for camera, late in LATE_NS.items():
        true = [round(n * 1e9 / STAMPED_FPS) + late for n in range(60) if n not in LOST.get(camera, ())]
        rounding = 500 if camera == "cam0" else 1 if camera == "cam1" else 1001
        assert np.abs(np.array(own[f"/{camera}/image"]) - true).max() <= 2 * rounding
    assert (np.diff(own["/scene"]) > 0).all()
    assert command("recognition", "check", folder / "r.mcap").code == 0
    assert json.loads(read_metadata(folder / "r.mcap")["sync"]) == sync
    logged = [m.message.message for m in iter_messages(folder / "r.mcap", ["/log"])]
    assert logged == grouped["warnings"]


def test_without_the_clocks_the_same_images_make_wrong_instants(stamped, tmp_path):
    folder, dense = stamped
    done = run_stamped(folder, tmp_path / "r.mcap", "--json", rig="without")
    assert [c["clock"] for c in done.json["sync"]["cameras"]] == [None] * 3
    assert done.json["sync"]["alone"] > 30
    assert joint_errors_mm(tmp_path / "r.npz", dense) > 100.0


def test_interpolation_brings_walking_workers_nearer_to_the_truth(stamped, grouped, tmp_path):
    """Cameras 21 ms apart at 15 fps: 4.5 mm off in the median as they are, 0.2 mm interpolated."""
    folder, dense = stamped
    assert "--interpolate moves what they saw to a common time" in grouped["warnings"][1]
    told = run_stamped(folder, tmp_path / "r.mcap", "--interpolate").out
    assert "--interpolate" not in told
    assert "60 instants, 60 of them in 3D" in told
    assert "cam1: 58 frames, 2 missing, 0 repeated, 0 without a partner; clock by probe, within 0.29 ms" in told
    assert read_metadata(tmp_path / "r.mcap")["interpolate"] == "true"
    as_they_are, moved = (joint_errors_mm(at / "r.npz", dense) for at in (folder, tmp_path))
    assert moved < 0.1 * as_they_are, (moved, as_they_are)


def refused(*arguments, rig, output):
    done = command("recognition", "run", rig, *arguments, "-o", output)
    assert done.code == 2, done.out
    assert done.err.startswith("error: ")
    assert "do next:" in done.err
    assert not output.exists()
    return done.err


def test_a_rig_that_failed_its_gates_is_refused(simulated, tmp_path):
    failed = read_rigfile(simulated / "s.rig.json").model_copy(update={"verdict": "RECAPTURE"})
    write_rigfile(failed, tmp_path / "f.rig.json")
    message = refused("--detections", simulated / "d.npz", rig=tmp_path / "f.rig.json", output=tmp_path / "r.mcap")
    assert "this rig file failed its gates" in message
    assert "rigcal validate" in message


def test_a_rig_edited_by_hand_is_refused(simulated, tmp_path):
    content = json.loads((simulated / "s.rig.json").read_text())
    content["cameras"][1]["cam_from_rig"]["translation_m"][0] += 0.1
    (tmp_path / "e.rig.json").write_text(json.dumps(content))
    message = refused("--detections", simulated / "d.npz", rig=tmp_path / "e.rig.json", output=tmp_path / "r.mcap")
    assert "the rig file was changed after rigcal wrote it" in message


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "nothing to run on"),
        (("--detections", "D", "--views", "cam9"), "the rig has no camera cam9"),
        (("--detections", "D", "--views", ","), "the rig has no camera (none given)"),
        (("--detections", "MISSING"), "missing.npz"),
        (("--detections", "D", "--interpolate"), "there is nothing to interpolate"),
    ],
)
def test_runs_that_cannot_start_say_why(simulated, tmp_path, arguments, words):
    places = {"D": simulated / "d.npz", "CAPTURE": tmp_path, "MISSING": tmp_path / "missing.npz"}
    replaced = [places.get(argument, argument) for argument in arguments]
    assert words in refused(*replaced, rig=simulated / "s.rig.json", output=tmp_path / "r.mcap")


def test_what_is_no_recording_is_told(tmp_path):
    path = tmp_path / "x.mcap"
    path.write_text("hello")
    for arguments in (("check", path), ("recover", path, "-o", tmp_path / "y.mcap"), ("check", tmp_path / "none.mcap")):
        done = command("recognition", *arguments)
        assert done.code == 2
        assert done.err.startswith("error: ")
    assert not (tmp_path / "y.mcap").exists()


# --- real captures --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    path = tmp_path_factory.mktemp("imported") / "p.rig.json"
    dataset = REAL / "recognition" / "pose2sim_multi" / "dataset.json"
    assert command("rigcal", "import", dataset, "--from", "multiview-dataset", "-o", path).code == 0
    return path


def poses_of(path):
    with np.load(path) as data:
        return {
            int(track): dict(zip(data["frame"][rows].tolist(), data["joints_m"][rows], strict=True))
            for track in np.unique(data["track_id"])
            for rows in [data["track_id"] == track]
        }


@pytest.fixture(scope="module")
def from_openpose(imported, tmp_path_factory):
    folder = tmp_path_factory.mktemp("openpose")
    done = command(
        "recognition", "run", imported, "--detections", REAL / "recognition" / "pose2sim_multi" / "data.npz",
        "-o", folder / "r.mcap", "--poses", folder / "p.npz", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    return done.json, poses_of(folder / "p.npz")


@real
def test_two_people_keep_their_identities_from_openpose(from_openpose):
    told, _ = from_openpose
    assert sorted(told["workers"].values())[-2] >= 90
    assert told["verdict"] == "IMPORTED"


@real
def test_two_people_keep_their_identities_from_video_and_agree(imported, from_openpose, tmp_path):
    """The athlete's joints from two networks agree within 80 mm (measured: 45 mm).

    The other person of the OpenPose file is of another rendering, 1.4 m away from where the videos show it.
    """
    done = command(
        "recognition", "run", imported, "--source", REAL / "recognition" / "pose2sim_multi",
        "--object-model", REAL / "models" / "yolox_nano.onnx",
        "--pose-model", REAL / "models" / "movenet_lightning_int8.onnx",
        "-o", tmp_path / "r.mcap", "--poses", tmp_path / "p.npz", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert sorted(done.json["workers"].values())[-2] >= 90
    assert command("recognition", "check", tmp_path / "r.mcap").code == 0
    gaps = []
    for first in from_openpose[1].values():
        for second in poses_of(tmp_path / "p.npz").values():
            common = sorted(set(first) & set(second))
            if len(common) >= 90:
                gap = np.linalg.norm([first[f] - second[f] for f in common], axis=-1)
                gaps.append(float(np.median(gap[np.isfinite(gap)])))
    assert min(gaps) <= 0.080
