"""Claims about the committed demo site: complete, small, its truth right, and good enough to calibrate from."""

import csv
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import av
import numpy as np
import pytest

from rigcal.rigfile import read_rigfile, rig_of
from rigcal.site import load_site
from rigcal.sync.estimator.estimate import estimate_clock
from rigcal.sync.log import read_exchanges
from tools.demo_truth import camera_errors, clock_errors, floor_error, read_truth

ROOT = Path(__file__).parents[2]
SITE = ROOT / "rig_configs" / "demo"
WORK = SITE / "work"
CAMERAS = ("cam0", "cam1", "cam2", "cam3")


@pytest.fixture(scope="module")
def truth():
    return read_truth(WORK)


def frames_of(video):
    with av.open(str(video)) as file:
        stream = file.streams.video[0]
        return stream.frames, (stream.width, stream.height), stream.codec_context.name, float(stream.average_rate)


def stamps(folder):
    with (folder / "timestamps.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row["frame_time"]) for row in rows if row["cam_id"] == name]) for name in CAMERAS}


def test_the_folder_is_complete_and_small():
    videos = [SITE / part / f"{name}.mp4" for part in ("boards", "floor", "work") for name in CAMERAS]
    tables = [SITE / part / "timestamps.csv" for part in ("boards", "floor", "work")]
    others = [WORK / name for name in ("truth.json", "truth.npz", "true.rig.json", "scene.json")]
    texts = [SITE / name for name in ("demo.site.toml", "demo.rig.json", "clock_probes.csv")]
    wanted = {*videos, *tables, *others, *texts}
    assert {path for path in SITE.rglob("*") if path.is_file()} == wanted
    assert sum(path.stat().st_size for path in wanted) <= 15e6


@pytest.mark.parametrize("part", ["boards", "floor", "work"])
def test_every_video_is_full_hd_and_every_frame_has_a_stamp(part):
    told = stamps(SITE / part)
    for name in CAMERAS:
        count, size_wh, codec, _ = frames_of(SITE / part / f"{name}.mp4")
        assert (size_wh, codec) == ((1920, 1080), "h264")
        assert count == len(told[name])
        assert (np.diff(told[name]) > 0).all()


def test_the_work_lasts_long_enough_and_holds_every_violation_and_safe_moments(truth):
    count, _, _, fps = frames_of(WORK / "cam0.mp4")
    assert fps >= 10
    assert 20 <= count / fps <= 30
    assert count == len(truth.instants_s)
    violations = truth.facts["violations"]
    assert {one["kind"] for one in violations} == {"no_hat", "ladder", "window", "platform"}
    against = [any(v["start_s"] <= t < v["end_s"] for v in violations) for t in truth.instants_s]
    assert 0.2 < np.mean(against) < 0.9


def test_the_truth_projects_as_written_out_by_hand(truth):
    """Poses, then Brown and Conrady's model as OpenCV documents it."""
    arrays, rng = truth.arrays, np.random.default_rng(0)
    entry = json.loads((WORK / "true.rig.json").read_text())
    world = turned(entry["world_from_rig"])
    for number, camera in enumerate(entry["cameras"]):
        rotation, shift = turned(camera["cam_from_rig"])
        c = camera["coefficients"]
        for frame in rng.integers(len(truth.instants_s), size=12):
            points = arrays["joints_m"][frame].reshape(-1, 3).astype(np.float64)
            x, y, z = ((points - world[1]) @ world[0] @ rotation.T + shift).T
            a, b = x / z, y / z
            r2 = a * a + b * b
            radial = 1 + c["k1"] * r2 + c["k2"] * r2**2 + c["k3"] * r2**3
            u = c["fx"] * (a * radial + 2 * c["p1"] * a * b + c["p2"] * (r2 + 2 * a * a)) + c["cx"]
            v = c["fy"] * (b * radial + c["p1"] * (r2 + 2 * b * b) + 2 * c["p2"] * a * b) + c["cy"]
            told = arrays["joints_px"][frame, number].reshape(-1, 2)
            inside = (np.abs(told - (960, 540)) < (1000, 600)).all(axis=1)
            assert np.abs(told - np.stack([u, v], axis=1))[inside].max() < 0.01


def turned(pose):
    w, x, y, z = pose["quat_wxyz"]
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rotation), np.array(pose["translation_m"])


def test_workers_stay_inside_the_pictures_of_several_cameras(truth):
    seen = (truth.arrays["worker_pixels"] > 500).sum(axis=1)
    assert (seen >= 2).mean() > 0.95


def test_stamps_are_the_instants_by_each_cameras_clock(truth):
    told = stamps(WORK)
    for camera in rig_of(truth.rig).cameras:
        true_s = np.array([camera.clock.rig_time_s(float(t)) for t in told[camera.id]])
        assert np.abs(true_s - truth.facts["epoch_s"] - truth.instants_s).max() < 2e-6


def test_the_probe_log_holds_the_truth_within_its_bounds(truth):
    site, log = load_site(SITE / "demo.site.toml"), read_exchanges(SITE / "clock_probes.csv")
    for camera in rig_of(truth.rig).cameras:
        host, declared = estimate_clock(log[camera.id]).model, site.camera(camera.id)
        for at_s in truth.facts["epoch_s"] + truth.instants_s[[0, -1]]:
            error = host.rig_time_s(at_s) - declared.capture_latency_s - camera.clock.rig_time_s(at_s)
            assert abs(error) <= host.bound_at_s(at_s) + declared.capture_latency_bound_s < 0.002


def test_site_and_rules_say_what_the_videos_hold(truth):
    site = load_site(SITE / "demo.site.toml")
    assert tuple(camera.id for camera in site.cameras) == CAMERAS == truth.rig.camera_ids
    assert all(camera.size_wh == (1920, 1080) and camera.clock for camera in site.cameras)
    rules = tomllib.loads((SITE.parent / "site.rules.toml").read_text())
    assert {rule["name"] for rule in rules["rules"]} == {one["kind"] for one in truth.facts["violations"]}


def test_the_rig_that_is_kept_is_a_calibrated_one_and_near_the_truth(truth):
    kept = read_rigfile(SITE / "demo.rig.json")
    assert (kept.verdict, [step.command for step in kept.history]) == ("PASS", ["calibrate", "world", "sync probe"])
    assert all(one.holds for one in (*camera_errors(kept, truth.rig), *clock_errors(kept, truth)))
    assert floor_error(kept, truth.rig).tilt_deg < 0.2


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    rig, patch = folder / "demo.rig.json", pytest.MonkeyPatch()
    patch.setenv("RIGCAL_CACHE", str(folder / "cache"))
    site = SITE / "demo.site.toml"
    command("calibrate", SITE / "boards", "--site", site, "-o", rig)
    command("world", rig, "--floor-board", SITE / "floor", "--thickness", "5mm", "-o", rig)
    command("sync", "probe", site, "--rig", rig, "--from-log", SITE / "clock_probes.csv")
    yield read_rigfile(rig)
    patch.undo()


def command(*arguments):
    done = subprocess.run(
        [Path(sys.executable).parent / "rigcal", *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_calibrating_from_the_board_videos_keeps_every_limit(calibrated, truth):
    assert calibrated.verdict == "PASS"
    for one in camera_errors(calibrated, truth.rig):
        assert one.position_mm <= min(8.0, 2 * one.position_sigma_mm), one
        assert one.rotation_deg <= min(0.1, 2 * one.rotation_sigma_deg), one
        assert abs(one.focal_percent) < 0.2
    floor = floor_error(calibrated, truth.rig)
    assert floor.tilt_deg < 0.1
    assert floor.origin_mm < 10


def test_clocks_from_the_log_hold_the_truth(calibrated, truth):
    for one in clock_errors(calibrated, truth):
        assert abs(one.error_ms) <= one.bound_ms < 2.0
