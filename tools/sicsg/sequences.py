"""Evaluation sequences: short multi-view videos with their truth, made from committed scene files.

A sequence is a folder that the project's own commands read::

    SEQUENCE/cam0.mp4 ...       H.264, one video per camera
    SEQUENCE/timestamps.csv     cam_id,frame_time: stamps of each camera's own clock, seconds since the epoch
    SEQUENCE/true.rig.json      the true calibration, world and clocks
    SEQUENCE/scene.json         the scene file
    SEQUENCE/truth.json         instants, ids and classes, violations as [start_s, end_s) of true time
    SEQUENCE/truth.npz          see :func:`arrays_of`

Instants are the frames of camera 0: instant ``n`` is its ``n``-th frame. True time 0 of a scene is ``EPOCH_S``.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig, RigCamera
from rigcal.rigfile import document_of_rig, write_rigfile
from tools.sicsg.assets import Split
from tools.sicsg.catalog import item
from tools.sicsg.moment import moment
from tools.sicsg.photograph import Photographer, Picture, Renderer, renderer_of
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.rendering.lens import camera_of
from tools.sicsg.scene import Scene, SceneCamera, read_scene, write_scene

Floats = NDArray[np.float64]
EPOCH_S = 1_790_000_000.0
"""True time 0 of every scene, in UTC seconds."""


def frame_times(scene: Scene, camera: SceneCamera) -> Floats:
    """(F,) true times of a camera's frames, mid-exposure."""
    return camera.phase_s + np.arange(int(np.floor((scene.duration_s - camera.phase_s) * camera.fps))) / camera.fps


def stamps_of(camera: SceneCamera, true_s: Floats) -> Floats:
    """(F,) what the camera's clock says at these true times, in UTC seconds.

    The rig's model is t_true = t_cam + offset + drift * 1e-6 * (t_cam - at), with ``at`` the scene's start.
    """
    return EPOCH_S + (true_s - camera.clock_offset_s) / (1 + camera.clock_drift_ppm * 1e-6)


def true_rig(scene: Scene, site: str) -> Rig:
    """The rig as it is: lenses, poses, world and clocks without error (clocks to a microsecond)."""
    poses = [Pose.from_quat_wxyz(camera.quat_wxyz, camera.translation_m) for camera in scene.cameras]
    world_from_rig = poses[0].inverse()
    cameras = tuple(
        RigCamera(
            id=camera.id,
            camera=camera_of(camera),
            cam_from_rig=Pose.identity() if index == 0 else poses[index] @ world_from_rig,
            clock=ClockModel(
                offset_s=camera.clock_offset_s,
                drift_ppm=camera.clock_drift_ppm,
                at_utc=datetime.fromtimestamp(EPOCH_S, UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
                bound_s=1e-6,
                drift_bound_ppm=0.0,
                method="declared",
            ),
        )
        for index, camera in enumerate(scene.cameras)
    )
    return Rig(site, cameras, cameras[0].id, "IMPORTED", world_from_rig)


def make_sequence(scene: Scene, folder: Path, renderer: Renderer, passes: GlRenderer, *, crf: int = 20) -> None:
    """Write a sequence's folder; ``truth.json`` last, so that a folder that has it is finished."""
    if (folder / "truth.json").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    photographer = Photographer(scene, renderer, passes)
    times = {camera.id: frame_times(scene, camera) for camera in scene.cameras}
    count = min(len(own) for own in times.values())
    videos = {camera.id: Video(folder / f"{camera.id}.mp4", camera, crf) for camera in scene.cameras}
    taken: list[list[Picture]] = []
    together = all(np.array_equal(own[:count], times[scene.cameras[0].id][:count]) for own in times.values())
    for frame in range(count):
        if together:
            pictures = photographer.take(scene.cameras, float(times[scene.cameras[0].id][frame]), hidden_parts=True)
        else:
            pictures = [
                photographer.take([camera], float(times[camera.id][frame]), hidden_parts=True)[0]
                for camera in scene.cameras
            ]
        for picture in pictures:
            videos[picture.camera.id].add(picture.image_bgr)
        taken.append(pictures)
    for video in videos.values():
        video.close()
    write_scene(scene, folder / "scene.json")
    own = {camera_id: true_s[:count] for camera_id, true_s in times.items()}
    write_truth(folder, scene, folder.name, own, facts_of(scene, taken), arrays_of(scene, taken))


def write_truth(
    folder: Path,
    scene: Scene,
    site: str,
    times_s: Mapping[str, Floats],
    facts: dict[str, Any],
    arrays: Mapping[str, NDArray[Any]],
) -> None:
    """Write what a sequence's folder holds beside its videos and ``scene.json``; ``truth.json`` last.

    Args:
        folder: of the sequence.
        scene: its scene.
        site: name of the rig's site.
        times_s: (F,) true times of each camera's frames.
        facts: of :func:`facts_of`.
        arrays: of :func:`arrays_of`.
    """
    write_stamps(folder / "timestamps.csv", scene, times_s)
    digest = hashlib.sha256((folder / "scene.json").read_bytes()).hexdigest()
    rig = true_rig(scene, site)
    document = document_of_rig(rig, created_utc=rig.cameras[0].clock.at_utc, inputs_sha256=digest)
    write_rigfile(document, folder / "true.rig.json")
    np.savez_compressed(folder / "truth.npz", **arrays)
    (folder / "truth.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def write_stamps(path: Path, scene: Scene, true_s: Mapping[str, Floats]) -> None:
    """Write what each camera's clock says at these true times of its frames."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["cam_id", "frame_time"])
        for camera in scene.cameras:
            rows.writerows((camera.id, f"{stamp:.6f}") for stamp in stamps_of(camera, true_s[camera.id]))


_SAMPLES = 2
"""Of the path tracer, a pixel."""
SCENES = Path(__file__).parent / "scenes"
"""The committed scene files, ``SPLIT/NAME.scene.json``; NAME ends with its renderer."""


def make_sequences(split: Split, folder: Path, *, only: str, jobs: int, say: Callable[[str], None]) -> None:
    """Make what is still missing of a half's sequences, into ``folder/SPLIT/NAME``."""
    paths = [path for path in sorted((SCENES / split).glob("*.scene.json")) if only in path.name]
    missing = [path for path in paths if not (folder / split / name_of(path) / "truth.json").exists()]
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(_make_one, path, folder / split): path for path in missing}
        for done in as_completed(waiting):
            done.result()
            say(name_of(waiting[done]))
    say(f"{len(paths)} sequences, of which {len(missing)} are new")


def name_of(path: Path) -> str:
    """A sequence's name, of its scene file."""
    return path.name.removesuffix(".scene.json")


def _make_one(path: Path, folder: Path) -> None:
    cv2.setNumThreads(1)
    kind = name_of(path).rpartition("-")[2]
    with GlRenderer() as passes, renderer_of(kind, passes, samples=_SAMPLES) as renderer:
        make_sequence(read_scene(path), folder / name_of(path), renderer, passes)


class Video:
    """An H.264 file without B frames, with a key frame every ``key_s`` seconds."""

    def __init__(self, path: Path, camera: SceneCamera, crf: int, *, key_s: float = 1.0) -> None:
        rate = Fraction(camera.fps).limit_denominator(1000)
        self._file = av.open(str(path), "w")
        options = {"crf": str(crf), "preset": "medium", "bf": "0"}
        self._stream = self._file.add_stream("libx264", rate=rate, options=options)
        self._stream.width, self._stream.height = camera.size_wh
        self._stream.pix_fmt, self._stream.gop_size = "yuv420p", max(round(key_s * camera.fps), 1)
        self._stream.thread_count = 1

    def add(self, image_bgr: NDArray[np.uint8]) -> None:
        """Append a frame."""
        self._file.mux(self._stream.encode(av.VideoFrame.from_ndarray(image_bgr, format="bgr24")))

    def close(self) -> None:
        """Finish the file."""
        self._file.mux(self._stream.encode())
        self._file.close()


def facts_of(scene: Scene, taken: list[list[Picture]]) -> dict[str, Any]:
    """What ``truth.json`` holds."""
    return {
        "format": "sicsg.sequence",
        "version": 1,
        "epoch_s": EPOCH_S,
        "split": scene.split,
        "light": scene.light.kind,
        "cameras": [camera.id for camera in scene.cameras],
        "workers": [worker.id for worker in scene.workers],
        "objects": [{"id": thing.id, "class": thing.category} for thing in scene.things],
        "instants_s": [round(pictures[0].t_s, 6) for pictures in taken],
        "violations": [violation.model_dump() for violation in scene.violations],
    }


def arrays_of(scene: Scene, taken: list[list[Picture]]) -> dict[str, NDArray[Any]]:
    """What ``truth.npz`` holds, of F instants, V cameras, W workers and T objects.

    ``t_s (F, V)`` true time of each frame; in the world, at the instants: ``joints_m (F, W, 17, 3)``,
    ``object_m (F, T, 3)`` middle of the mesh's box, ``object_keypoints_m (F, T, 4, 3)`` (NaN: none);
    per view, at the view's own time: ``joints_px (F, V, W, 17, 2)``, ``joints_seen (F, V, W, 17)`` (0 outside,
    1 occluded, 2 self-occluded, 3 visible), ``worker_xyxy (F, V, W, 4)`` and ``object_xyxy (F, V, T, 4)`` boxes of
    what the id pass shows (NaN: nothing), ``worker_pixels``, ``object_pixels (F, V, T)``, and about how many they would
    be if nothing stood before them (where that was asked for): ``worker_full_pixels (F, V, W)``,
    ``object_full_pixels (F, V, T)``.
    """
    worlds = [moment(scene, pictures[0].t_s) for pictures in taken]
    boxes = [item(t.category, t.variant).mesh.vertices_m for t in scene.things]
    middles = [(v.min(axis=0) + v.max(axis=0)) / 2 for v in boxes]
    points = [item(t.category, t.variant).keypoints_m for t in scene.things]
    centre, keypoints = [], np.full((len(taken), len(scene.things), 4, 3), np.nan)
    for frame, world in enumerate(worlds):
        poses = [world.poses[thing.id] for thing in scene.things]
        centre.append([p[:3, :3] @ m + p[:3, 3] for p, m in zip(poses, middles, strict=True)])
        for index, (pose, own) in enumerate(zip(poses, points, strict=True)):
            keypoints[frame, index, : len(own)] = own @ pose[:3, :3].T + pose[:3, 3]
    nothing = np.full(4, np.nan)

    def per_view(of: Any) -> NDArray[Any]:
        return np.array([[of(picture) for picture in pictures] for pictures in taken])

    arrays = {
        "t_s": per_view(lambda p: p.t_s),
        "joints_m": np.array([[world.workers[w.id].joints_m for w in scene.workers] for world in worlds]),
        "object_m": np.array(centre),
        "object_keypoints_m": keypoints,
        "joints_px": per_view(lambda p: [one.joints_px for one in p.people]),
        "joints_seen": per_view(lambda p: [one.visibility for one in p.people]),
        "worker_xyxy": per_view(lambda p: [nothing if one.box is None else one.box for one in p.people]),
        "worker_pixels": per_view(lambda p: [one.pixels for one in p.people]),
        "object_xyxy": per_view(lambda p: [nothing if one.box is None else one.box for one in p.things]),
        "object_pixels": per_view(lambda p: [one.pixels for one in p.things]),
    }
    if taken[0][0].full_pixels:
        arrays["worker_full_pixels"] = per_view(lambda p: [p.full_pixels[one.id] for one in p.people])
        arrays["object_full_pixels"] = per_view(lambda p: [p.full_pixels[one.id] for one in p.things])
    return arrays
