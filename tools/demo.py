"""The main job from end to end on a simulated site: board images in, validated rig file, workers in 3D, recorded.

Renders the captures that a technician would make and simulates the detections that networks would give, then runs the
real commands on those files. Since the site is simulated, it ends with how far the results are from the truth.

    python tools/demo.py out/demo
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from recognition.sources.detections_file import write_detections
from recognition.synthetic import simulate
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from rigcal.board import Board
from rigcal.geometry import Pose
from rigcal.rig import Rig
from rigcal.rigfile import read_rigfile, rig_of
from rigcal.site import load_site
from rigcal.synthetic import (
    BoardRenderer,
    arc_rig,
    board_poses_for_camera,
    board_poses_for_pair,
    draw_board,
    room_background,
)

SITE = Path(__file__).parents[1] / "rig_configs" / "demo.site.toml"
SHARED, SINGLE = 14, 6
"""Board positions shown to each pair of neighbours, and to each camera alone."""
FRAMES, FPS = 300, 30.0
NOISE = DetectorNoise(pixel_sigma=3.0, missing_joint=0.05, missed=0.03, false_per_view=0.1)


def main(folder: Path) -> int:
    """Run the demo in a folder, which is emptied first; returns the exit code."""
    started = time.monotonic()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    site = load_site(SITE)
    board = site.calibration_board
    if board is None:
        raise SystemExit(f"{SITE} names no board")
    rig = arc_rig(len(site.cameras), size_wh=(1280, 720), seed=7)
    capture, rig_file, recording = folder / "boards", folder / "demo.rig.json", folder / "demo.mcap"
    say(f"Rendering board captures of a simulated site with {len(rig.cameras)} cameras into {capture}")
    render_captures(rig, board, capture)
    command("rigcal", "calibrate", capture, "--site", SITE, "-o", rig_file)
    command("rigcal", "validate", rig_file)
    command("rigcal", "report", rig_file, "-o", folder / "demo.report.html")
    say("Simulating what networks would detect of four workers and their tools for ten seconds")
    simulate_detections(rig, folder / "detections.npz")
    command(
        "recognition", "run", rig_file, "--detections", folder / "detections.npz", "-o", recording,
        "--poses", folder / "poses.npz",
    )  # fmt: skip
    command("recognition", "check", recording)
    compare(rig, rig_of(read_rigfile(rig_file)), folder / "poses.npz")
    say(f"Done in {time.monotonic() - started:.0f} s. Look at:")
    print(f"  rig file   {rig_file}")
    print(f"  report     {folder / 'demo.report.html'}   (any browser)")
    print(f"  recording  {recording}   (Foxglove)")
    return 0


def render_captures(rig: Rig, board: Board, folder: Path) -> None:
    """Write CAPTURE/<camera>/<number>.jpg: every camera at every instant, the board wherever it sees it."""
    poses: list[Pose] = []
    ids = rig.camera_ids
    for index, (one, two) in enumerate(pairwise(ids)):
        poses += board_poses_for_pair(rig, one, two, board, SHARED, distance_m=(2.5, 6.0), seed=index)
    for index, one in enumerate(ids):
        poses += board_poses_for_camera(rig, one, board, SINGLE, distance_m=(1.0, 3.0), seed=50 + index)
    texture = draw_board(board)

    def render(index: int) -> None:
        camera = rig.cameras[index]
        (folder / camera.id).mkdir(parents=True)
        renderer, rng = BoardRenderer(camera.camera), np.random.default_rng(index)
        background = room_background(camera.camera.size_wh, seed=index)
        for number, rig_from_board in enumerate(poses):
            cam_from_board = camera.cam_from_rig @ rig_from_board
            image = renderer.render(texture, cam_from_board, rng=rng, background=background)
            cv2.imwrite(str(folder / camera.id / f"{number:04d}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 92])

    with ThreadPoolExecutor() as pool:
        list(pool.map(render, range(len(rig.cameras))))


def simulate_detections(rig: Rig, path: Path) -> None:
    """Write noisy 2D detections of simulated workers and objects."""
    simulated = simulate(rig, workers=4, frames=FRAMES, fps=FPS, seed=3)
    frames = []
    for frame in range(FRAMES):
        noisy = with_noise(observe(simulated, frame), rig, NOISE, seed=(0, frame))
        frames.append([view.detections for view in noisy])
    write_detections(path, frames, time_s=(simulated.t_ns * 1e-9).tolist())


def compare(true: Rig, found: Rig, poses: Path) -> None:
    """Print how far the calibrated cameras and the tracked workers are from the truth."""
    centres = [
        np.linalg.norm(f.cam_from_rig.inverse().translation_m - t.cam_from_rig.inverse().translation_m) * 1e3
        for f, t in zip(found.cameras, true.cameras, strict=True)
    ]
    say("Against the simulation's truth")
    print(
        "  camera positions off by  "
        + ", ".join(f"{c.id} {mm:.1f} mm" for c, mm in zip(found.cameras, centres, strict=True))
    )
    simulated = simulate(true, workers=4, frames=FRAMES, fps=FPS, seed=3)
    rig_from_world = true.world_from_rig.inverse() if true.world_from_rig else Pose.identity()
    with np.load(poses) as data:
        frame, joints = data["frame"], data["joints_m"].astype(np.float64)
    truth = rig_from_world.apply(simulated.joints_in_world_m)[frame]
    gaps = np.nanmedian(np.linalg.norm(truth - joints[:, None], axis=-1), axis=-1).min(axis=1)
    print(f"  workers' joints off by   {np.median(gaps) * 1e3:.0f} mm (median)")
    print(f"  workers seen in 3D       {len(frame)} of {4 * FRAMES} worker instants")


def command(program: str, *arguments: object) -> None:
    """Run one of the project's own commands, as a user would; stop where it fails."""
    words = [program, *map(str, arguments)]
    say("$ " + " ".join(words))
    executable = Path(sys.executable).parent / program
    done = subprocess.run([str(executable), *words[1:]], check=False)
    if done.returncode:
        raise SystemExit(f"{program} ended with exit code {done.returncode}")


def say(text: str) -> None:
    """A line of the demo's own, set apart from the commands' output."""
    print(f"\n== {text}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/demo")))
