"""A small simulated site as files, and the commands run as a user runs them."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rigcal.board import Checkerboard
from rigcal.synthetic import (
    BoardRenderer,
    arc_rig,
    board_poses_for_camera,
    board_poses_for_pair,
    draw_board,
    exact_detections,
    room_background,
)

BOARD = Checkerboard(7, 6, 0.12)
REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data"


def command(program, *arguments):
    """Run a console script; returns its exit code, output, errors and, with --json, the object it printed."""
    executable = Path(sys.executable).parent / program
    done = subprocess.run([executable, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    printed = json.loads(done.stdout) if "--json" in arguments and done.stdout else None
    return SimpleNamespace(code=done.returncode, out=done.stdout, err=done.stderr, json=printed)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """Board detections of the tests are kept apart from the user's."""
    patch = pytest.MonkeyPatch()
    patch.setenv("RIGCAL_CACHE", str(tmp_path_factory.mktemp("cache")))
    yield
    patch.undo()


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """Three cameras, rendered board images of 26 instants (few without a board, as they cost time), and the truth."""
    folder = tmp_path_factory.mktemp("site")
    rig = arc_rig(3, arc_deg=80, radius_m=4, size_wh=(800, 600), seed=2)
    poses = []
    for index, (one, two) in enumerate((("cam0", "cam1"), ("cam1", "cam2"))):
        poses += board_poses_for_pair(rig, one, two, BOARD, 7, distance_m=(1.5, 4.5), seed=index)
    for index, one in enumerate(rig.camera_ids):
        poses += board_poses_for_camera(rig, one, BOARD, 4, distance_m=(0.9, 2.5), seed=20 + index)
    texture, exact = draw_board(BOARD), exact_detections(rig, BOARD, poses)
    for index, camera in enumerate(rig.cameras):
        (folder / "boards" / camera.id).mkdir(parents=True)
        renderer, rng = BoardRenderer(camera.camera), np.random.default_rng(index)
        background = room_background(camera.camera.size_wh, seed=index)
        seen = {view.frame_idx for view in exact.cameras[index].views}
        for number, pose in enumerate(poses):
            if number not in seen and number % 13:
                continue
            image = renderer.render(texture, camera.cam_from_rig @ pose, rng=rng, background=background)
            assert cv2.imwrite(str(folder / "boards" / camera.id / f"{number:03d}.png"), image)
    return SimpleNamespace(capture=folder / "boards", rig=rig, board=BOARD.spec, folder=folder)


@pytest.fixture(scope="session")
def calibrated(site):
    """The site's rig file, calibrated through the command line."""
    output = site.folder / "site.rig.json"
    done = command("rigcal", "calibrate", site.capture, "--board", site.board, "-o", output, "--json")
    return SimpleNamespace(path=output, done=done)
