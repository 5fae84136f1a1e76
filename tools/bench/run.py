"""`make bench`: fixed-seed benchmarks beside a peer in the same run, one JSON object per line.

Each line has ``name``, what was measured with its unit, the peer's figure and the ratio of the two. Times are medians.
Seconds of one machine say nothing about another; ratios travel better.

    python tools/bench/run.py [NAME...]
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import Writer

from recognition.association import associate
from recognition.epipolar import RigGeometry
from recognition.observations import FrameSet, ViewDetections
from recognition.recording import Recorder, iter_messages
from recognition.synthetic import simulate
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from recognition.tracking import Tracker, TrackerState
from recognition.triangulation import triangulate_objects, triangulate_people
from rigcal._colmap import solve_with_colmap
from rigcal.board import Checkerboard
from rigcal.bundle import SolveOptions, solve
from rigcal.detect import find_board
from rigcal.detections import SiteDetections
from rigcal.pipeline import CalibrateOptions, calibrate_lenses, calibrate_site
from rigcal.rig import Rig
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile
from rigcal.site import GateLimits
from rigcal.synthetic import (
    BoardRenderer,
    arc_rig,
    board_poses_for_camera,
    board_poses_for_pair,
    draw_board,
    exact_detections,
    room_background,
)
from rigcal.synthetic import with_noise as corner_noise

BOARD = Checkerboard(9, 6, 0.06)
Line = Mapping[str, Any]


def median_s(action: Callable[[], object], *, repeats: int) -> float:
    """Median wall time of an action in seconds, after one run to warm up."""
    action()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def ring(cameras: int, seed: int) -> tuple[Rig, SiteDetections]:
    """A closed ring: 20 boards for each pair of neighbours, 10 for each camera alone, 0.2 px noise."""
    rig = arc_rig(cameras, arc_deg=360, radius_m=4, model="opencv4", seed=seed)
    poses, seen = [], []
    for index, (one, two) in enumerate(pairwise((*rig.camera_ids, "cam0"))):
        poses += board_poses_for_pair(rig, one, two, BOARD, 20, distance_m=(1.5, 5), seed=seed + index)
        poses += board_poses_for_camera(rig, one, BOARD, 10, distance_m=(0.7, 2.2), seed=seed + 50 + index)
        seen += [(one, two)] * 20 + [(one,)] * 10
    return rig, corner_noise(exact_detections(rig, BOARD, poses, seen_by=seen), 0.2, seed=seed)


def detection() -> Iterator[Line]:
    """Boards in rendered 1080p images, beside OpenCV's sector-based finder at full size, on one thread."""
    rig = arc_rig(2, arc_deg=50)
    camera, texture, rng = rig.cameras[0], draw_board(BOARD), np.random.default_rng(0)
    renderer, background = BoardRenderer(camera.camera), room_background(camera.camera.size_wh, seed=0)
    poses = board_poses_for_pair(rig, "cam0", "cam1", BOARD, 12, distance_m=(1.5, 4.5), seed=0)
    truth = [view.corners_px for view in exact_detections(rig, BOARD, poses).cameras[0].views]
    images = [renderer.render(texture, camera.cam_from_rig @ p, rng=rng, background=background) for p in poses]
    empty = [room_background(camera.camera.size_wh, seed=seed) for seed in range(1, 5)]
    size = (BOARD.columns, BOARD.rows)

    def ours(image: Any) -> Any:
        found = find_board(image, BOARD, thorough=False)
        return None if found is None or len(found.corner_ids) < len(truth[0]) else found.corners_px

    def opencv(image: Any) -> Any:
        found, corners = cv2.findChessboardCornersSB(image, size, flags=0)
        return corners.reshape(-1, 2) if found else None

    cv2.setNumThreads(1)
    line: dict[str, Any] = {"name": "detection.checkerboard_1080p", "images": len(images)}
    for name, find in (("ours", ours), ("opencv_sb", opencv)):
        found = [(find(image), corners) for image, corners in zip(images, truth, strict=True)]
        errors = [
            min(np.sqrt(((order - corners) ** 2).sum(axis=1).mean()) for order in (pixels, pixels[::-1]))
            for pixels, corners in found
            if pixels is not None
        ]
        line |= {
            f"{name}_found": len(errors),
            f"{name}_error_px": float(np.median(errors)),
            f"{name}_ms": 1e3 * float(np.median([median_s(lambda i=i, f=find: f(i), repeats=1) for i in images])),
            f"{name}_empty_ms": 1e3 * float(np.median([median_s(lambda i=i, f=find: f(i), repeats=1) for i in empty])),
        }
    cv2.setNumThreads(-1)
    yield line | {
        "ratio_error": line["ours_error_px"] / line["opencv_sb_error_px"],
        "ratio_ms": line["ours_ms"] / line["opencv_sb_ms"],
        "ratio_empty_ms": line["ours_empty_ms"] / line["opencv_sb_empty_ms"],
    }


def joint_solve() -> Iterator[Line]:
    """The joint solve beside pycolmap's from the same start, and both beside the chain of pairs."""
    for cameras in (4, 8):
        ours_mm, peer_mm, chain_mm, ours_s, peer_s = [], [], [], [], []
        for seed in range(3):
            rig, detections = ring(cameras, seed)
            options = CalibrateOptions("opencv4")
            lenses = calibrate_lenses(detections, None, options)
            result = calibrate_site(detections, GateLimits(), lenses, options)
            joint = result.joint

            def ours(joint: Any = joint) -> object:
                return solve(joint.observations, joint.start, joint.freedom, SolveOptions())

            def peer(joint: Any = joint, cameras: int = cameras) -> object:
                return solve_with_colmap(joint.observations, joint.start, free_lenses=[True] * cameras)

            ours_s.append(median_s(ours, repeats=3))
            peer_s.append(median_s(peer, repeats=3))
            opinion = solve_with_colmap(joint.observations, joint.start, free_lenses=[True] * cameras)
            for worst, poses in (
                (ours_mm, joint.cam_from_rig),
                (peer_mm, opinion.cam_from_rig),
                (chain_mm, result.chain.cam_from_rig),
            ):
                gaps = [
                    np.linalg.norm(found.inverse().translation_m - true.cam_from_rig.inverse().translation_m)
                    for found, true in zip(poses, rig.cameras, strict=True)
                ]
                worst.append(1e3 * max(gaps))
        yield {
            "name": f"joint_solve.ring{cameras}",
            "ours_s": float(np.median(ours_s)),
            "pycolmap_s": float(np.median(peer_s)),
            "ratio_s": float(np.median(ours_s) / np.median(peer_s)),
            "ours_worst_mm": float(np.median(ours_mm)),
            "pycolmap_worst_mm": float(np.median(peer_mm)),
            "chain_worst_mm": float(np.median(chain_mm)),
        }


def crowd(frames: int) -> tuple[Rig, list[tuple[ViewDetections, ...]], list[int]]:
    """Four workers and 14 objects before four cameras, 3 px noise, 5 % of the joints missing."""
    rig = arc_rig(4)
    site = simulate(rig, workers=4, frames=frames, seed=0)
    noise = DetectorNoise(pixel_sigma=3.0, missing_joint=0.05, missed=0.03, false_per_view=0.1)
    views = [
        tuple(view.detections for view in with_noise(observe(site, frame), rig, noise, seed=(0, frame)))
        for frame in range(frames)
    ]
    return rig, views, site.t_ns.tolist()


def frame_set() -> Iterator[Line]:
    """Association, triangulation and tracking of a frame set; triangulation beside cv2.triangulatePoints per pair."""
    rig, views, times = crowd(200)
    geometry, tracker = RigGeometry.of(rig), Tracker(rig.world_from_rig)
    state, stages = TrackerState(), []
    for index, (seen, t_ns) in enumerate(zip(views, times, strict=True)):
        start = time.perf_counter()
        groups = associate(geometry, seen)
        associated = time.perf_counter()
        people, objects = triangulate_people(geometry, seen, groups), triangulate_objects(geometry, seen, groups)
        triangulated = time.perf_counter()
        state, _ = tracker.step(state, people, objects, t_ns=t_ns, index=index)
        stages.append((associated - start, triangulated - associated, time.perf_counter() - triangulated))
    milliseconds = 1e3 * np.array(stages)
    total = milliseconds.sum(axis=1)
    peer = [_opencv_triangulation_ms(rig, seen, associate(geometry, seen).people.members) for seen in views[:50]]
    yield {
        "name": "frame_set.4cameras_4workers_14objects",
        "median_ms": float(np.median(total)),
        "p99_ms": float(np.quantile(total, 0.99)),
        "associate_ms": float(np.median(milliseconds[:, 0])),
        "triangulate_ms": float(np.median(milliseconds[:, 1])),
        "track_ms": float(np.median(milliseconds[:, 2])),
        "opencv_triangulate_pairs_ms": float(np.median(peer)),
        "ratio_triangulate": float(np.median(milliseconds[:, 1]) / np.median(peer)),
    }


def _opencv_triangulation_ms(rig: Rig, views: tuple[ViewDetections, ...], members: Any) -> float:
    """The usual way: undistort each person in each view, triangulate each pair of views, average."""
    start = time.perf_counter()
    for row in members:
        seen = [v for v in range(len(views)) if row[v] >= 0]
        xy = {v: rig.cameras[v].camera.undistort(views[v].people_px[row[v]]) for v in seen}
        points = []
        for i, one in enumerate(seen):
            for two in seen[i + 1 :]:
                P = [rig.cameras[v].cam_from_rig.matrix[:3] for v in (one, two)]
                homogeneous = cv2.triangulatePoints(P[0], P[1], xy[one].T, xy[two].T)
                points.append(homogeneous[:3] / homogeneous[3])
        if points:
            np.ma.masked_invalid(points).mean(axis=0)
    return 1e3 * (time.perf_counter() - start)


def recording() -> Iterator[Line]:
    """Recording detections and scenes, beside the bare ``mcap`` writer given the same bytes."""
    rig, views, times = crowd(200)
    geometry, tracker, state = RigGeometry.of(rig), Tracker(rig.world_from_rig), TrackerState()
    scenes = []
    for index, (seen, t_ns) in enumerate(zip(views, times, strict=True)):
        groups = associate(geometry, seen)
        people, objects = triangulate_people(geometry, seen, groups), triangulate_objects(geometry, seen, groups)
        state, scene = tracker.step(state, people, objects, t_ns=t_ns, index=index)
        scenes.append(scene)
    with tempfile.TemporaryDirectory() as folder:
        rig_path, path = Path(folder) / "a.rig.json", Path(folder) / "a.mcap"
        document = document_of_rig(rig, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
        write_rigfile(document, rig_path)
        loaded = rig_of(read_rigfile(rig_path))

        def ours() -> None:
            with Recorder(path, rig=loaded, rig_json=rig_path.read_bytes(), metadata={}) as recorder:
                for seen, scene in zip(views, scenes, strict=True):
                    recorder.write_detections(FrameSet(scene.index, scene.t_ns, (None,) * 4), seen)
                    recorder.write_scene(scene)

        ours_s = median_s(ours, repeats=3)
        messages = [(m.topic, m.log_ns, m.message.SerializeToString()) for m in iter_messages(path)]

        def bare() -> None:
            with (Path(folder) / "b.mcap").open("wb") as file:
                writer = Writer(file)
                writer.start()
                schema = writer.register_schema("x", "protobuf", b"")
                channels = {topic: writer.register_channel(topic, "protobuf", schema) for topic, _, _ in messages}
                for topic, log_ns, data in messages:
                    writer.add_message(channels[topic], log_ns, data, log_ns)
                writer.finish()

        bare_s = median_s(bare, repeats=3)
        yield {
            "name": "recording.4cameras_4workers_14objects",
            "us_per_message": 1e6 * ours_s / len(messages),
            "bare_writer_us_per_message": 1e6 * bare_s / len(messages),
            "ratio": ours_s / bare_s,
            "messages": len(messages),
        }


BENCHMARKS: Mapping[str, Callable[[], Iterator[Line]]] = {
    "detection": detection,
    "joint_solve": joint_solve,
    "frame_set": frame_set,
    "recording": recording,
}


def main(names: list[str]) -> int:
    """Run the named benchmarks, or all."""
    for name in names or list(BENCHMARKS):
        for line in BENCHMARKS[name]():
            rounded = {key: float(f"{v:.4g}") if isinstance(v, float) else v for key, v in line.items()}
            print(json.dumps(rounded), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
