"""Detection of checkerboards beside ``cv2.findChessboardCornersSB``: one JSON object per line.

Recall, corner error and milliseconds on rendered images (fixed seeds, truth known), with and without a board, and on
the shared captures where they are there; every flag set of OpenCV's finder searches the same images at full size. All
finders run on one thread and are timed by the processor's clock of that thread. The last line is a video capture of
four cameras: seconds of `rigcal calibrate` from end to end over those of decoding alone, before and after it.

    python tools/bench/detection.py [--images N] [--seconds S] [--only images|shared|video]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from rigcal.board import Checkerboard
from rigcal.camera import Camera
from rigcal.detect import find_board
from rigcal.geometry import Floats, Pose
from rigcal.synthetic import (
    BoardRenderer,
    GreyImage,
    arc_rig,
    board_poses_for_camera,
    board_poses_for_pair,
    draw_board,
    random_camera,
    room_background,
)

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "calibration"
BOARD = Checkerboard(9, 6, 0.06)
FLAG_SETS = {
    "0": 0,
    "normalize": cv2.CALIB_CB_NORMALIZE_IMAGE,
    "accuracy": cv2.CALIB_CB_ACCURACY,
    "larger": cv2.CALIB_CB_LARGER,
    "exhaustive": cv2.CALIB_CB_EXHAUSTIVE,
    "normalize+exhaustive+accuracy": cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY,
}
Finder = Callable[[GreyImage, Checkerboard], tuple[Floats, NDArray[Any]] | None]
Line = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Case:
    """A kind of picture."""

    distance_m: tuple[float, float] = (2.0, 5.0)
    most_tilt_deg: float = 70.0
    least_tilt_deg: float = 0.0
    size_wh: tuple[int, int] = (1920, 1080)
    model: str = "opencv5"
    blur_px: float = 0.7
    noise_dn: float = 2.5
    light: str = "even"
    board: Checkerboard = BOARD


CASES = {
    "far": Case(),
    "near": Case((0.8, 2.0), 60),
    "steep": Case((1.5, 4.0), 76, 62),
    "portrait": Case((1.0, 3.5), 60, size_wh=(1088, 1920)),
    "4k": Case((1.0, 5.0), 65, size_wh=(3840, 2160)),
    "320x240": Case((0.8, 2.0), 50, size_wh=(320, 240)),
    "fisheye": Case((0.4, 2.0), 50, model="fisheye4"),
    "uneven light": Case((1.0, 4.0), light="uneven"),
    "shadow": Case((1.0, 4.0), 60, light="shadow"),
    "dim": Case((1.0, 4.0), 60, light="dim"),
    "blurred": Case((1.0, 2.5), 45, blur_px=2.5),
    "noisy": Case((1.0, 3.5), 50, noise_dn=8.0),
    "symmetric": Case((1.0, 4.0), 60, board=Checkerboard(8, 6, 0.06)),
    "28x17": Case((1.0, 3.0), 55, board=Checkerboard(28, 17, 0.03)),
}
MILD = {"far", "near", "steep", "portrait", "4k", "fisheye", "uneven light", "symmetric", "28x17"}
"""Cases with 0.7 px of blur and 2.5 grey levels of noise at a usual resolution, and no edge of a shadow."""


@dataclass(slots=True)
class Score:
    """What a finder did."""

    images: int = 0
    found: int = 0
    squares: list[Floats] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)

    def add(self, find: Finder, image: GreyImage, board: Checkerboard, truth: Floats | None = None) -> None:
        """Search one image; corners count in either order."""
        start = time.thread_time()
        found = find(image, board)
        self.ms.append(1e3 * (time.thread_time() - start))
        self.images += 1
        if found is not None:
            self.found += 1
            if truth is not None:
                corners, ids = found
                either = [((corners - order[ids]) ** 2).sum(axis=1) for order in (truth, truth[::-1])]
                self.squares.append(min(either, key=np.median))

    @classmethod
    def joined(cls, scores: Sequence[Score]) -> Score:
        """Several as one."""
        whole = cls(sum(score.images for score in scores), sum(score.found for score in scores))
        for score in scores:
            whole.squares += score.squares
            whole.ms += score.ms
        return whole

    @property
    def rms_px(self) -> float | None:
        """Root-mean-square distance of the corners from the truth."""
        return float(np.sqrt(np.concatenate(self.squares).mean())) if self.squares else None


def ours(image: GreyImage, board: Checkerboard) -> tuple[Floats, NDArray[Any]] | None:
    """What a video's frames are searched with, and images first."""
    found = find_board(image, board, thorough=False)
    return None if found is None or found.problem else (found.corners_px, found.corner_ids)


def opencv(flags: int) -> Finder:
    """OpenCV's sector-based finder at full size; a larger grid than the board's does not count."""

    def find(image: GreyImage, board: Checkerboard) -> tuple[Floats, NDArray[Any]] | None:
        found, corners = cv2.findChessboardCornersSB(image, (board.columns, board.rows), flags=flags)
        count = board.columns * board.rows
        return (corners.reshape(-1, 2), np.arange(count)) if found and len(corners) == count else None

    return find


FINDERS: Mapping[str, Finder] = {"ours": ours} | {f"sb {name}": opencv(flags) for name, flags in FLAG_SETS.items()}


def rendered(case: Case, count: int, seed: int) -> Iterator[tuple[GreyImage, Floats]]:
    """Images of a board anywhere in view, and its true corners (n, 2) in pixels."""
    rng = np.random.default_rng(seed)
    camera = random_camera(case.model, case.size_wh, rng)
    renderer, texture = (
        BoardRenderer(camera, supersampling=2 if max(case.size_wh) < 3000 else 1),
        draw_board(case.board),
    )
    for index in range(count):
        pose, truth = _pose_in_view(camera, case, rng)
        background = room_background(case.size_wh, seed=100 * seed + index)
        image = renderer.render(texture, pose, blur_px=case.blur_px, noise_dn=0, rng=rng, background=background)
        lit = image * _light(case, truth, rng) + rng.normal(0, case.noise_dn, image.shape)
        yield np.clip(np.rint(lit), 0, 255).astype(np.uint8), truth


def _pose_in_view(camera: Camera, case: Case, rng: np.random.Generator) -> tuple[Pose, Floats]:
    corners, size = case.board.corners_in_board, np.array(case.size_wh)
    while True:
        ray = camera.rays(rng.uniform(0, size))
        z = ray / np.linalg.norm(ray)
        x = np.array([1.0, 0, 0]) - z[0] * z
        x /= np.linalg.norm(x)
        axis, tilt = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(case.least_tilt_deg, case.most_tilt_deg))
        tilted = Rotation.from_rotvec(tilt * np.array([np.cos(axis), np.sin(axis), 0]))
        turned = Rotation.from_rotvec([0, 0, np.deg2rad(rng.uniform(-30, 30))])
        rotation = np.stack([x, np.cross(z, x), z], axis=1) @ (tilted * turned).as_matrix()
        pose = Pose(rotation, ray * rng.uniform(*case.distance_m) - rotation @ corners.mean(axis=0))
        points = pose.apply(corners)
        if (points[:, 2] > 0.05).all():
            truth = camera.project(points)
            margin = 3 + 0.01 * max(case.size_wh)
            if ((truth > margin) & (truth < size - 1 - margin)).all():
                return pose, truth


def _light(case: Case, truth: Floats, rng: np.random.Generator) -> Floats | float:
    """Share of the light that reaches each pixel."""
    if case.light in ("even", "dim"):
        return 1.0 if case.light == "even" else 0.15
    rows, columns = np.mgrid[: case.size_wh[1], : case.size_wh[0]]
    angle = rng.uniform(0, 2 * np.pi)
    along = np.cos(angle) * (columns - truth[:, 0].mean()) + np.sin(angle) * (rows - truth[:, 1].mean())
    if case.light == "uneven":
        slope = np.exp(1.2 * along / max(case.size_wh))
        return np.asarray(slope / slope.max())
    return np.asarray(0.35 + 0.65 / (1 + np.exp(-np.clip(along / 2.5, -50, 50))))


def images(count: int) -> Iterator[Line]:
    """Rendered boards by case, images without a board, and all together."""
    by_case: dict[str, Mapping[str, Score]] = {}
    for seed, (case_name, case) in enumerate(CASES.items()):
        by_case[case_name] = {name: Score() for name in FINDERS}
        for image, truth in rendered(case, count, seed):
            for name, find in FINDERS.items():
                by_case[case_name][name].add(find, image, case.board, truth)
        yield _line(f"rendered.{case_name}", by_case[case_name])
    without = {name: Score() for name in FINDERS}
    for image in _empty_images():
        for name, find in FINDERS.items():
            without[name].add(find, image, BOARD)
    yield _line("rendered.no_board", without)
    together = {name: Score.joined([scores[name] for scores in by_case.values()]) for name in FINDERS}
    mild = Score.joined([by_case[name]["ours"] for name in MILD])
    ms = {name: float(np.mean(together[name].ms + without[name].ms)) for name in FINDERS}
    yield _line("rendered.all", together) | {
        "ours_mild_error_px": mild.rms_px,
        "ours_ms_with_and_without": ms["ours"],
        "sb 0_ms_with_and_without": ms["sb 0"],
        "ratio_ms": ms["ours"] / ms["sb 0"],
    }


def _line(name: str, scores: Mapping[str, Score]) -> dict[str, Any]:
    line: dict[str, Any] = {"name": f"detection.{name}", "images": scores["ours"].images}
    for finder, score in scores.items():
        line |= {f"{finder}_found": score.found, f"{finder}_ms": float(np.mean(score.ms))}
        if score.rms_px is not None:
            line[f"{finder}_error_px"] = score.rms_px
    return line


def _empty_images() -> Iterator[GreyImage]:
    """Rooms with sensor noise, and frames of the shared videos in which nobody holds a board."""
    for seed in range(4):
        room = room_background((1920, 1080), seed=500 + seed) + np.random.default_rng(seed).normal(0, 2.5, (1080, 1920))
        yield np.clip(np.rint(room), 0, 255).astype(np.uint8)
    for path in sorted((SHARED / "pose2sim_singleperson" / "videos").glob("*.mp4")):
        with av.open(str(path)) as container:
            yield np.asarray(next(container.decode(container.streams.video[0])).to_ndarray(format="gray"), np.uint8)


def shared() -> Iterator[Line]:
    """The real checkerboard captures, as many images as there are."""
    folders = {"opencv_stereo_chess": "*.jpg", "stereopi_pairs/pairs": "*.png"}
    folders |= {f"pose2sim_singleperson/calibration/intrinsics/int_cam0{k}_img": "*.jpg" for k in range(1, 5)}
    for folder, pattern in folders.items():
        board = Checkerboard(4, 7, 0.06) if "pose2sim" in folder else Checkerboard(9, 6, 0.025)
        scores = {name: Score() for name in FINDERS}
        for path in sorted((SHARED / folder).glob(pattern)):
            image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION), np.uint8)
            for name, find in FINDERS.items():
                scores[name].add(find, image, board)
        if scores["ours"].images:
            yield _line(f"shared.{folder.split('/')[-1]}", scores)


def video(seconds: int) -> Iterator[Line]:
    """A board held by hand before four cameras, as one 1080p30 video each: calibrated, and only decoded."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _film(folder, seconds)
        before_s = _decode_s(folder)
        start = time.perf_counter()
        command = "from rigcal.cli import main; main()"
        calibrate = ["calibrate", name, "--board", BOARD.spec, "-o", f"{name}/out.rig.json", "--no-cache", "--json"]
        ended = subprocess.run([sys.executable, "-c", command, *calibrate], check=False, capture_output=True, text=True)
        whole_s = time.perf_counter() - start
        decode_s = (before_s + _decode_s(folder)) / 2
        if ended.returncode not in (0, 1):
            raise SystemExit(ended.stderr)
        cameras = json.loads((folder / "out.rig.json").read_text())["cameras"]
    yield {
        "name": f"detection.video.4x1080p30_{seconds}s",
        "frames": sum(camera["views"]["frames"] for camera in cameras),
        "found": sum(camera["views"]["detected"] for camera in cameras),
        "end_to_end_s": whole_s,
        "decode_s": decode_s,
        "ratio": whole_s / decode_s,
    }


def _decode_s(folder: Path) -> float:
    start = time.perf_counter()
    for path in sorted(folder.glob("*.mp4")):
        with av.open(str(path)) as container:
            container.streams.video[0].thread_type = "AUTO"
            for _ in container.decode(container.streams.video[0]):
                pass
    return time.perf_counter() - start


def _film(folder: Path, seconds: int, *, pictures_per_s: int = 10, repeats: int = 3) -> None:
    """One video per camera: the board rests for 0.7 s of every two; each picture is shown ``repeats`` times."""
    rig, texture = arc_rig(4, arc_deg=75, radius_m=4), draw_board(BOARD)
    poses = _route(seconds // 2 + 2)
    for number, camera in enumerate(rig.cameras):
        width, height = camera.camera.size_wh
        renderer, room = BoardRenderer(camera.camera), room_background((width, height), seed=number)
        rng = np.random.default_rng(number)
        grain = rng.normal(0, 2, (4, height, width)).astype(np.float32)
        with av.open(str(folder / f"{camera.id}.mp4"), "w") as container:
            stream = container.add_stream("libx264", rate=Fraction(pictures_per_s * repeats))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = {"preset": "veryfast", "crf": "21", "g": "60"}
            for index in range(seconds * pictures_per_s):
                pose = camera.cam_from_rig @ _held(poses, index / pictures_per_s)
                with np.errstate(divide="ignore"):  # rays along the board's plane never meet it
                    picture = renderer.render(texture, pose, noise_dn=0, rng=rng, background=room)
                for repeat in range(repeats):
                    noisy = np.clip(picture + grain[(index + repeat) % len(grain)], 0, 255).astype(np.uint8)
                    grey = np.concatenate([noisy, np.full((height // 2, width), 128, np.uint8)])
                    container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="yuv420p")))
            container.mux(stream.encode())


def _route(count: int) -> list[Pose]:
    """Poses ``rig_from_board`` from one pair of neighbours to the next, shared ones and those of one camera."""
    rig, each = arc_rig(4, arc_deg=75, radius_m=4), -(-count // 6)
    poses: list[Pose] = []
    for k, (one, two) in enumerate((("cam0", "cam1"), ("cam1", "cam2"), ("cam2", "cam3"))):
        poses += board_poses_for_pair(rig, one, two, BOARD, each, distance_m=(1.2, 4.0), seed=k)
        poses += board_poses_for_camera(rig, one, BOARD, each // 2, distance_m=(0.8, 2.5), seed=10 + k)
        poses += board_poses_for_camera(rig, two, BOARD, each - each // 2, distance_m=(0.8, 2.5), seed=20 + k)
    return poses[:count]


def _held(poses: Sequence[Pose], t_s: float) -> Pose:
    """Where a hand holds the board: at rest but for a tremor of 2 mm, then on its way to the next pose."""
    k = min(int(t_s / 2), len(poses) - 2)
    share = float(np.clip((t_s - 2 * k - 0.7) / 1.3, 0, 1))
    share = share * share * (3 - 2 * share)
    turn = Slerp([0, 1], Rotation.from_matrix([poses[k].rotation, poses[k + 1].rotation]))(share)
    place = (1 - share) * poses[k].translation_m + share * poses[k + 1].translation_m
    tremor = np.sin(2 * np.pi * t_s * np.array([1.1, 1.7, 0.6]))
    return Pose((turn * Rotation.from_rotvec(0.004 * tremor)).as_matrix(), place + 0.002 * tremor)


def main() -> int:
    """Run the chosen parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=4, help="rendered images per case")
    parser.add_argument("--seconds", type=int, default=10, help="length of the videos")
    parser.add_argument("--only", choices=("images", "shared", "video"), help="one part")
    chosen = parser.parse_args()
    parts: Mapping[str, Callable[[], Iterator[Line]]] = {
        "images": lambda: images(chosen.images),
        "shared": shared,
        "video": lambda: video(chosen.seconds),
    }
    cv2.setNumThreads(1)
    for name, part in parts.items():
        if chosen.only in (None, name):
            for line in part():
                rounded = {key: float(f"{v:.4g}") if isinstance(v, float) else v for key, v in line.items()}
                print(json.dumps(rounded), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
