"""rigcal world and rigcal drift through the command line, on rendered images of a site whose truth is known."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from conftest import BOARD, REAL, command

from rigcal.geometry import Pose
from rigcal.rigfile import digest, read_rigfile, rig_of
from rigcal.synthetic import BoardRenderer, board_poses_for_pair, draw_board, exact_detections, room_background

real = pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")


def render(rig, poses, folder):
    """A capture of boards at ``rig_from_board`` poses; cameras that do not see one whole have no image of it."""
    texture, exact = draw_board(BOARD), exact_detections(rig, BOARD, poses)
    for index, camera in enumerate(rig.cameras):
        (folder / camera.id).mkdir(parents=True)
        renderer, rng = BoardRenderer(camera.camera), np.random.default_rng(index)
        background = room_background(camera.camera.size_wh, seed=index)
        for view in exact.cameras[index].views:
            pose = camera.cam_from_rig @ poses[view.frame_idx]
            image = renderer.render(texture, pose, rng=rng, background=background)
            assert cv2.imwrite(str(folder / camera.id / f"{view.frame_idx:03d}.png"), image)
    return folder


def shown(rig, *, seed):
    """Six boards in front of either pair of neighbours."""
    pairs = (("cam0", "cam1"), ("cam1", "cam2"))
    return [
        pose
        for index, pair in enumerate(pairs)
        for pose in board_poses_for_pair(rig, *pair, BOARD, 6, distance_m=(1.5, 4.5), seed=seed + index)
    ]


@pytest.fixture(scope="module")
def moved_rig(site):
    """The site after somebody knocked camera 2 by 0.7 degrees and 30 mm."""
    knock = Pose.from_rvec(np.deg2rad([0.3, -0.6, 0.2]), [0.02, 0.0, 0.02])
    cameras = (
        *site.rig.cameras[:2],
        replace(site.rig.cameras[2], cam_from_rig=knock @ site.rig.cameras[2].cam_from_rig),
    )
    return replace(site.rig, cameras=cameras)


@pytest.fixture(scope="module")
def after_the_knock(moved_rig, tmp_path_factory):
    return render(moved_rig, shown(moved_rig, seed=50), tmp_path_factory.mktemp("knocked") / "boards")


@pytest.fixture(scope="module")
def floor(site, tmp_path_factory):
    """The board on the floor in two places, on a plate of 5 mm."""
    places = [
        Pose.from_rvec([0, 0, np.deg2rad(turn)], [x, y, 0.005]) @ Pose.from_rvec([np.pi, 0, 0], [0, 0, 0])
        for x, y, turn in ((-0.3, 0.2, 0), (0.3, 0.6, 30))
    ]
    poses = [site.rig.world_from_rig.inverse() @ place for place in places]
    return render(site.rig, poses, tmp_path_factory.mktemp("floor") / "boards")


def test_a_rig_that_stayed_is_unchanged(site, calibrated, tmp_path):
    capture = render(site.rig, shown(site.rig, seed=70), tmp_path / "boards")
    done = command("rigcal", "drift", calibrated.path, capture, "--json")
    assert done.code == 0, done.err
    assert done.json["unchanged"]
    assert [camera["status"] for camera in done.json["cameras"]] == ["stayed"] * 3


def test_a_knocked_camera_is_named_and_placed_again(site, calibrated, moved_rig, after_the_knock, tmp_path):
    """Its new place within 3 sigma or 10 mm of the truth; the others to the last digit; history and digests right."""
    done = command("rigcal", "drift", calibrated.path, after_the_knock, "--json")
    assert done.code == 1
    assert (done.json["moved"], done.json["suspects"]) == (["cam2"], [])
    movement = done.json["cameras"][2]["movement"]
    assert movement["rotation_deg"] == pytest.approx(0.7, abs=max(3 * movement["rotation_sigma_deg"], 0.02))
    assert movement["shift_px"] > 3
    text = command("rigcal", "drift", calibrated.path, after_the_knock)
    assert text.out.startswith("cam2 moved (3 of 3 cameras judged, limit 0.5 px)")
    assert re.search(r"cam2 +moved +\d+ +\d+\.\d\d \+- 0\.\d\d", text.out)
    output = tmp_path / "new.rig.json"
    resolved = command("rigcal", "drift", calibrated.path, after_the_knock, "--resolve", "-o", output, "--json")
    assert resolved.json["resolved"]["rig_file"] == str(output)
    document, before = read_rigfile(output), read_rigfile(calibrated.path)
    assert resolved.code == (0 if document.verdict == "PASS" else 1)
    assert document.verdict == "PASS", [gate for gate in document.gates if not gate.passed]
    assert document.cameras[1] == before.cameras[1]
    found, true = (rig.camera("cam2").cam_from_rig.inverse().translation_m for rig in (rig_of(document), moved_rig))
    assert np.linalg.norm(found - true) < max(3 * document.cameras[2].sigma.position_m, 0.01)
    assert document.history[-1].command == "drift"
    assert document.history[-1].parent_digest == before.digest
    content = json.loads(output.read_text())
    assert digest(content) == content["digest"]
    assert {path.name for path in tmp_path.iterdir()} == {"new.rig.json", "new.residuals.npz", "new.report.html"}
    again = command("rigcal", "drift", output, after_the_knock)
    assert again.code == 0
    assert again.out.startswith("No camera moved")


def test_a_board_on_the_floor_gives_the_world(site, calibrated, floor, tmp_path):
    """Heights of the cameras within 10 mm, the vertical within 3 sigma or 0.1 degrees of the truth."""
    output = tmp_path / "world.rig.json"
    done = command(
        "rigcal", "world", calibrated.path, "--floor-board", floor, "--thickness", "5mm", "-o", output, "--json"
    )  # fmt: skip
    assert done.code == 0, done.err
    true = site.rig.world_from_rig
    for camera in site.rig.cameras:
        height = true.apply(camera.cam_from_rig.inverse().translation_m)[2]
        assert done.json["camera_heights_m"][camera.id] == pytest.approx(height, abs=0.01)
    document = read_rigfile(output)
    up = document.world_from_rig.pose.rotation[2]
    tilt = np.rad2deg(np.arccos(np.clip(up @ true.rotation[2], -1, 1)))
    assert tilt < max(3 * done.json["tilt_sigma_deg"], 0.1)
    assert document.verdict == read_rigfile(calibrated.path).verdict
    assert [entry.command for entry in document.history] == ["calibrate", "world"]
    assert document.extensions["rigcal"]["world"]["method"] == "floor board"
    text = command("rigcal", "world", output, "--floor-board", floor, "-o", output)
    assert text.out.startswith("World from the floor board: vertical +- ")
    assert [entry.command for entry in read_rigfile(output).history] == ["calibrate", "world", "world"]
    assert command("rigcal", "validate", output).code == 0


def test_points_and_a_plumb_line_give_the_world(site, calibrated, tmp_path):
    true, names = (
        site.rig.world_from_rig,
        {"a": (0, 0, 0), "b": (0.8, 0.2, 0), "c": (0.1, 0.7, 0.9), "d": (-0.6, 0.3, 0.4)},
    )
    line = {"top": (0.2, 0.3, 1.6), "bottom": (0.2, 0.3, 0.3), "floor": (0.0, 0.5, 0.0)}

    def pixels(points):
        rows = ["name,camera,u_px,v_px"]
        for name, point in points.items():
            for camera in site.rig.cameras:
                u, v = camera.camera.project(camera.cam_from_rig.apply(true.inverse().apply(point)))
                rows.append(f"{name},{camera.id},{u:.2f},{v:.2f}")
        return "\n".join(rows)

    table, seen, plumb = (tmp_path / name for name in ("points.csv", "pixels.csv", "plumb.csv"))
    table.write_text("name,x_m,y_m,z_m\n" + "\n".join(f"{n},{x},{y},{z}" for n, (x, y, z) in names.items()))
    seen.write_text(pixels(names))
    plumb.write_text(pixels(line))
    output = tmp_path / "world.rig.json"
    points = command("rigcal", "world", calibrated.path, "--points", table, "--pixels", seen, "-o", output, "--json")
    assert points.code == 0, points.err
    assert abs(points.json["scale_percent"]) < 1
    hanging = command("rigcal", "world", calibrated.path, "--plumb", plumb, "-o", output, "--json")
    for camera in site.rig.cameras:
        height = true.apply(camera.cam_from_rig.inverse().translation_m)[2]
        assert points.json["camera_heights_m"][camera.id] == pytest.approx(height, abs=0.02)
        assert hanging.json["camera_heights_m"][camera.id] == pytest.approx(height, abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "there must be one way to find the floor and the vertical"),
        (("--floor-board", "x", "--plumb", "y"), "got:      --floor-board, --plumb"),
        (("--points", "p.csv"), "--pixels FILE.csv together with --points"),
        (("--plumb", "p.csv", "--thickness", "5mm"), "--thickness only together with --floor-board"),
        (("--plumb", "p.csv", "--height", "cam9:2m"), "CAMERA:LENGTH with CAMERA one of cam0, cam1, cam2"),
        (("--plumb", "p.csv", "--height", "cam0:2"), "a length above 0 with its unit: 5mm, 2.41m"),
        (("--plumb", "p.csv"), "this table cannot be read"),
    ],
)
def test_a_world_that_cannot_be_measured_is_refused(calibrated, tmp_path, arguments, message):
    done = command("rigcal", "world", calibrated.path, *arguments, "-o", tmp_path / "w.rig.json")
    assert done.code == 2
    assert message in done.err
    assert not (tmp_path / "w.rig.json").exists()


def test_drift_refuses_what_it_cannot_compare(calibrated, after_the_knock, tmp_path):
    small = tmp_path / "small"
    for camera in ("cam0", "cam1"):
        (small / camera).mkdir(parents=True)
        assert cv2.imwrite(str(small / camera / "000.png"), np.zeros((300, 400), dtype=np.uint8))
    done = command("rigcal", "drift", calibrated.path, small)
    assert done.code == 2
    assert "camera cam0 has images of another size" in done.err
    (small / "cam1").rename(small / "hall")
    assert "the rig has no camera hall" in command("rigcal", "drift", calibrated.path, small).err
    without = command("rigcal", "drift", calibrated.path, after_the_knock, "--resolve")
    assert without.code == 2
    assert "--resolve together with -o OUT.rig.json" in without.err


@real
def test_a_real_pair_does_not_drift_against_its_own_capture(tmp_path):
    capture, rig = REAL / "calibration" / "opencv_stereo_chess", tmp_path / "pair.rig.json"
    command("rigcal", "calibrate", capture, "--board", "checkerboard:9x6:25mm", "-o", rig)
    done = command("rigcal", "drift", rig, capture, "--json")
    assert done.code == 0, done.err
    assert max(camera["movement"]["shift_px"] for camera in done.json["cameras"]) < 0.05
    other = command("rigcal", "drift", rig, REAL / "calibration" / "stereopi_pairs" / "pairs")
    assert other.code == 2
    assert "640x480 px, as in the rig file" in other.err
