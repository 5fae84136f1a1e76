"""Clocks from people: simulated workers whose clocks are known, and real detections shifted by whole frames.

A camera is *found* where its offset is nearest to the right whole frame, *sure* where it is claimed to be, and *wrong*
where it is claimed and its nearest frame is another, or the bound does not hold the truth. A shifted
reference counts as found where all the others are. No peer's figure stands beside these: none gives part of a frame, a
bound or a refusal.

    python tools/bench/sync_people.py
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recognition.synthetic import Site, semicircle_rig, simulate, walking
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from rigcal.formats import import_rig
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import rig_of
from rigcal.sync.content.people.keypoints import Keypoints, read_keypoints
from rigcal.sync.content.people.lags import people_lags

Line = Mapping[str, Any]
DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "recognition"
DETECTOR = DetectorNoise(pixel_sigma=3.0, missing_joint=0.05, missed=0.03, false_per_view=0.1)
FPS = 30.0
_FINER = 16  # instants of the simulation per frame: clocks are off by multiples of 2.08 ms
_MOST_FRAMES = 15
_BORN_UTC = "2026-01-01T00:00:00Z"


@dataclass(frozen=True, slots=True)
class Scene:
    """Detections of a simulated site by cameras whose clocks are off."""

    rig: Rig
    keypoints: Keypoints
    times_s: Floats
    offset_s: Floats
    """(V,) truth, what to add to each camera's stamps; 0 for the first."""


def walkers(seed: int, seconds: float, *, workers: int = 4) -> Scene:
    """People who walk about a room."""
    rig, count = semicircle_rig(4), _instants(seconds)
    site = simulate(rig, workers=workers, frames=count, fps=FPS * _FINER, seed=seed)
    return _recorded(site, rig, seconds, seed)


def on_the_spot(seed: int, seconds: float, *, speed_m_s: float, workers: int = 2) -> Scene:
    """People on treadmills; at a speed of 0 they stand still."""
    rig, count = semicircle_rig(4), _instants(seconds)
    rng = np.random.default_rng(seed)
    walked_m = speed_m_s * np.arange(count) / (FPS * _FINER)
    path = np.stack([walked_m, np.zeros(count)], axis=-1)
    joints = np.stack([walking(path, phase=rng.uniform(0, 2 * np.pi)) for _ in range(workers)], axis=1)
    joints[..., 0] -= walked_m[:, None, None]
    for worker in range(workers):
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        joints[:, worker, :, :2] = joints[:, worker, :, :2] @ turn + rng.uniform(-1.5, 1.5, 2)
    still = simulate(rig, workers=1, frames=1, seed=seed)
    return _recorded(_bare(rig, still.cam_from_world, joints), rig, seconds, seed)


def simulated(name: str, scenes: Sequence[Callable[[], Scene]]) -> Line:
    """What becomes of simulated recordings."""
    errors_s, bounds_s, refused, wrong, took_s = [], [], 0, 0, []
    for make in scenes:
        scene = make()
        started = time.process_time()
        found = people_lags(scene.rig, scene.keypoints, scene.times_s)
        took_s.append(time.process_time() - started)
        for lag, truth_s in list(zip(found.cameras, scene.offset_s, strict=True))[1:]:
            refused += not lag.confident
            if lag.confident:
                errors_s.append(abs(lag.offset_s - float(truth_s)))
                bounds_s.append(lag.bound_s)
                wrong += bool(errors_s[-1] > 1 / FPS)
    covered = sum(bool(error <= bound) for error, bound in zip(errors_s, bounds_s, strict=True))
    line: dict[str, Any] = {"name": f"sync_people.{name}", "recordings": len(scenes), "cpu_s": max(took_s)}
    line |= {"sure": len(errors_s), "refused": refused, "wrong_by_a_frame": wrong}
    if errors_s:
        line |= {
            "rms_ms": 1e3 * float(np.sqrt(np.mean(np.square(errors_s)))),
            "worst_ms": 1e3 * max(errors_s),
            "bound_ms": 1e3 * float(np.median(bounds_s)),
            "covered": f"{covered}/{len(errors_s)}",
        }
    return line


def shifted(dataset: str, file: str, *, trials: int = 60) -> Line:
    """Real detections, one camera at a time shifted by a random whole number of frames, cut where the others end."""
    rig, fps = _real_rig(dataset), 60.0
    truth = read_keypoints(DATA / dataset / file, rig)
    frames = truth.frames
    times_s = np.repeat(np.arange(frames)[:, None] / fps, len(rig.cameras), axis=1)
    rng = np.random.default_rng(0)
    found = sure = sure_found = wrong = 0
    for trial in range(trials):
        camera, shift = trial % len(rig.cameras), int(rng.integers(-30, 31))
        keypoints = _shifted(truth, camera, shift, frames)
        lags = people_lags(rig, keypoints, times_s).cameras
        right_s = -shift / fps * ((np.arange(len(lags)) == camera) - float(camera == 0))
        judged = [camera] if camera else [1, 2, 3]
        near = [round((lags[c].offset_s - right_s[c]) * fps) == 0 for c in judged]
        claimed = all(lags[c].confident for c in judged)
        found, sure, sure_found = found + all(near), sure + claimed, sure_found + (claimed and all(near))
        wrong += any(_is_wrong(lag, true_s, fps) for lag, true_s in zip(lags, right_s, strict=True) if lag.confident)
    return {
        "name": f"sync_people.shifted.{dataset}.{file.removesuffix('.npz')}",
        "trials": trials,
        "found_percent": 100 * found / trials,
        "sure_percent": 100 * sure / trials,
        "found_of_sure_percent": 100 * sure_found / max(sure, 1),
        "wrong": wrong,
    }


def genlocked(dataset: str, file: str) -> Line:
    """The real cameras as they are: their offsets are 0."""
    rig = _real_rig(dataset)
    keypoints = read_keypoints(DATA / dataset / file, rig)
    times_s = np.repeat(np.arange(keypoints.frames)[:, None] / 60.0, len(rig.cameras), axis=1)
    lags = people_lags(rig, keypoints, times_s).cameras[1:]
    return {
        "name": f"sync_people.genlocked.{dataset}.{file.removesuffix('.npz')}",
        "offset_ms": [1e3 * lag.offset_s for lag in lags],
        "bound_ms": [1e3 * lag.bound_s for lag in lags],
        "sure": [lag.confident for lag in lags],
        "reason": [lag.reason for lag in lags],
    }


def people_lines() -> Iterator[Line]:
    """All figures, with fixed seeds."""
    yield simulated("walk_20s", [lambda s=s: walkers(s, 20.0) for s in range(6)])
    yield simulated("walk_40s", [lambda s=s: walkers(100 + s, 40.0) for s in range(2)])
    yield simulated("walk_alone_20s", [lambda s=s: walkers(200 + s, 20.0, workers=1) for s in range(6)])
    yield simulated("walk_4s", [lambda s=s: walkers(300 + s, 4.0, workers=2) for s in range(10)])
    yield simulated("treadmill_10s", [lambda s=s: on_the_spot(s, 10.0, speed_m_s=1.3) for s in range(6)])
    yield simulated("standing_10s", [lambda s=s: on_the_spot(s, 10.0, speed_m_s=0.0) for s in range(6)])
    for dataset in ("pose2sim_multi", "pose2sim_single"):
        for file in ("data.npz", "data_movenet.npz"):
            if (DATA / dataset / file).exists():
                yield shifted(dataset, file, trials=100 if dataset.endswith("multi") else 24)
                yield genlocked(dataset, file)


def _instants(seconds: float) -> int:
    return (round(seconds * FPS) + 2 * (_MOST_FRAMES + 1)) * _FINER


def _bare(rig: Rig, cam_from_world: tuple[Pose, ...], joints: Floats) -> Site:
    """A site of people without objects."""
    count = len(joints)
    return Site(rig, cam_from_world, np.arange(count), joints, (), np.zeros((count, 0, 3)), np.zeros((0, 3)))


def _recorded(site: Site, rig: Rig, seconds: float, seed: int) -> Scene:
    """What detectors make of the site when each camera's frames are taken at its own time."""
    frames = round(seconds * FPS)
    late = np.random.default_rng((seed, 1)).integers(
        -_MOST_FRAMES * _FINER, _MOST_FRAMES * _FINER + 1, len(rig.cameras)
    )
    late[0] = 0
    frame, view, kpts = [], [], []
    for index, mounted in enumerate(rig.cameras):
        alone = Rig("one camera", (RigCamera(mounted.id, mounted.camera, Pose.identity()),), mounted.id, "PASS")
        taken = (_MOST_FRAMES + 1) * _FINER + late[index] + np.arange(frames) * _FINER
        seen = _bare(alone, site.cam_from_world[index : index + 1], site.joints_in_world_m[taken])
        for number in range(frames):
            (noisy,) = with_noise(observe(seen, number), alone, DETECTOR, seed=(seed, index, number))
            people = np.dstack([noisy.detections.people_px, noisy.detections.people_score])
            kpts.append(np.where(np.isfinite(people).all(axis=-1, keepdims=True), people, 0.0))
            frame.append(np.full(len(people), number))
            view.append(np.full(len(people), index))
    keypoints = Keypoints(np.concatenate(frame), np.concatenate(view), np.concatenate(kpts))
    times_s = np.repeat(np.arange(frames)[:, None] / FPS, len(rig.cameras), axis=1)
    return Scene(rig, keypoints, times_s, late / (FPS * _FINER))


def _real_rig(dataset: str) -> Rig:
    path = DATA / dataset / "dataset.json"
    return rig_of(import_rig(path, from_format="multiview-dataset", created_utc=_BORN_UTC))


def _shifted(truth: Keypoints, camera: int, shift: int, frames: int) -> Keypoints:
    frame = np.where(truth.view == camera, truth.frame + shift, truth.frame)
    kept = (frame >= 0) & (frame < frames)
    return Keypoints(frame[kept], truth.view[kept], truth.kpts[kept])


def _is_wrong(lag: Any, true_s: float, fps: float) -> bool:
    error_s = abs(lag.offset_s - true_s)
    return bool(error_s > lag.bound_s + 1e-12 or error_s > 0.5 / fps)


if __name__ == "__main__":
    for line in people_lines():
        print(json.dumps(line), flush=True)
