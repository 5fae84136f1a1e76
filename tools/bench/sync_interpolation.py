"""What interpolating 2D detections to the common time gains: 3D joints of cameras that are not triggered together.

Three simulated workers before four cameras, each camera late by up to half a frame at random, and the shared
multi-person capture with every other camera half a frame late. Errors are medians over joints, against the truth at
the common times; the peer is the same without interpolation, and ``ratio`` is ours over it. Where interpolation hurts,
it is above 1.

    python tools/bench/sync_interpolation.py
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from recognition.association import associate
from recognition.epipolar import RigGeometry
from recognition.interpolation import in_common_time
from recognition.observations import FrameSet, Instant, ViewDetections
from recognition.sources.detections_file import read_detections
from recognition.synthetic import Site, semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, LabelledView, observe, with_noise
from recognition.triangulation import triangulate_people
from rigcal.formats import import_rig
from rigcal.geometry import Floats, Ints
from rigcal.rig import Rig
from rigcal.rigfile import rig_of

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "recognition" / "pose2sim_multi"
REAL_FPS = 60.0
SIMULATED_HZ = 600.0
"""Rate of the simulated truth; between its samples joints leave the straight line by 10 micrometres at the most."""
SECONDS, INSTANTS, TRIALS = 32.0, 24, 3
"""Length of the simulation, instants of a trial, and trials of a case."""
MOTIONS: Mapping[str, float] = {"static": 0.0, "walking_0.9m_per_s": 1.6, "fast_2.3m_per_s": 4.0}
"""Factor of the simulated speed, whose median at the hips is 0.58 m/s."""
NOISES_PX = (0.0, 1.0, 3.0)
WRONG_PX = 80.0
Line = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One draw of the cameras' delays, seen without noise."""

    site: Site
    views: tuple[tuple[LabelledView, ...], ...]
    """(I, V) what each camera sees at its own time."""
    times_ns: Ints
    """(I, V) its own times."""
    truth_m: Floats
    """(I, W, 17, 3) joints at the common times, in the rig frame."""

    def instants(self, pixel_sigma: float, seed: int, wrong_joints: float = 0.0) -> list[Instant]:
        """As a detector with noise, lost joints and lost workers reports them; perfect without noise.

        A share of the joints is wrong by :data:`WRONG_PX`, in each frame others.
        """
        rng = np.random.default_rng(seed)
        lost = 0.05 if pixel_sigma else 0.0
        noise = DetectorNoise(pixel_sigma=pixel_sigma, missing_joint=lost, missed=lost / 2, shuffled=bool(lost))
        found = []
        for index, (labelled, times_ns) in enumerate(zip(self.views, self.times_ns.tolist(), strict=True)):
            seen = with_noise(labelled, self.site.rig, noise, seed=(seed, index))
            views = tuple(spoiled(view.detections, wrong_joints, rng) for view in seen)
            found.append(instant(index, times_ns, views))
        return found


def spoiled(seen: ViewDetections, share: float, rng: np.random.Generator) -> ViewDetections:
    """The same, with a share of the joints somewhere else."""
    wrong = rng.random(seen.people_px.shape[:2]) < share
    shift_px = rng.normal(0.0, WRONG_PX, seen.people_px.shape)
    return replace(seen, people_px=seen.people_px + np.where(wrong[..., None], shift_px, 0.0))


def instant(index: int, times_ns: Sequence[int], views: Sequence[ViewDetections]) -> Instant:
    """An instant whose common time is the mean of its cameras' times."""
    common_ns = times_ns[0] + round(float(np.mean(np.array(times_ns) - times_ns[0])))
    return Instant(FrameSet(index, common_ns, (None,) * len(views), tuple(times_ns)), tuple(views))


def trial(site: Site, *, fps: float, motion: float, late: float, seed: int) -> Trial:
    """Cameras at a frame rate, each up to ``late`` frames late; ``motion`` is the factor of the speed."""
    rng, cameras = np.random.default_rng(seed), len(site.rig.cameras)
    start_s = rng.uniform(1.0, SECONDS - max(motion, 1.0) * (INSTANTS + 1) / fps)
    own_s = np.arange(INSTANTS)[:, None] / fps + rng.uniform(0.0, late / fps, cameras)
    columns = []
    for view in range(cameras):
        shown = at_times(site, start_s + motion * own_s[:, view])
        columns.append([observe(shown, index)[view] for index in range(INSTANTS)])
    truth = at_times(site, start_s + motion * own_s.mean(axis=1)).joints_in_world_m
    in_rig = site.rig.world_from_rig.inverse() if site.rig.world_from_rig else None
    return Trial(
        site=site,
        views=tuple(zip(*columns, strict=True)),
        times_ns=np.rint(own_s * 1e9).astype(np.int64),
        truth_m=truth if in_rig is None else in_rig.apply(truth),
    )


def at_times(site: Site, t_s: Floats) -> Site:
    """The site at any times within the simulation."""
    place = t_s * SIMULATED_HZ
    before = np.minimum(place.astype(np.int64), len(site.t_ns) - 2)
    part = (place - before)[:, None, None]

    def between(values: Floats) -> Floats:
        weight = part if values.ndim == 3 else part[..., None]
        return np.asarray(values[before] + weight * (values[before + 1] - values[before]))

    return replace(
        site,
        t_ns=np.rint(t_s * 1e9).astype(np.int64),
        joints_in_world_m=between(site.joints_in_world_m),
        object_centre_in_world_m=between(site.object_centre_in_world_m),
    )


def errors_m(rig: Rig, views: Sequence[ViewDetections], truth_m: Floats) -> Floats:
    """Distances of the triangulated joints from those of the nearest person of the truth (W, 17, 3)."""
    geometry = RigGeometry.of(rig)
    joints = triangulate_people(geometry, views, associate(geometry, views)).joints_m
    joints = joints[np.isfinite(joints).any(axis=(1, 2))]
    gaps = np.linalg.norm(joints[:, None] - truth_m[None], axis=-1)
    nearest = gaps[np.arange(len(gaps)), np.nanmedian(gaps, axis=2).argmin(axis=1)] if len(gaps) else np.zeros((0, 17))
    return np.asarray(nearest[np.isfinite(nearest)])


def compared(name: str, cases: Sequence[tuple[Rig, list[Instant], Callable[[Instant], Floats]]]) -> Line:
    """The line of some runs: rig, instants, and the truth (W, 17, 3) of an instant; ends are left out."""
    ours, peer, took_s, spread_ns = [], [], 0.0, []
    for rig, instants, truth in cases:
        start = time.perf_counter()
        moved = list(in_common_time(instants))
        took_s += time.perf_counter() - start
        for entry in moved[1:-1]:
            ours.append(errors_m(rig, entry.common, truth(entry)))
            peer.append(errors_m(rig, entry.views, truth(entry)))
        spread_ns += [np.ptp([t for t in i.frame_set.times_ns if t is not None]) for i in instants]
    mm = [1e3 * np.concatenate(parts) for parts in (ours, peer)]
    return {
        "name": name,
        "spread_ms": 1e-6 * float(np.median(spread_ns)),
        "ours_mm": float(np.median(mm[0])),
        "without_mm": float(np.median(mm[1])),
        "ratio": float(np.median(mm[0]) / np.median(mm[1])),
        "ours_p90_mm": float(np.quantile(mm[0], 0.9)),
        "without_p90_mm": float(np.quantile(mm[1], 0.9)),
        "ours_ms_per_instant": 1e3 * took_s / sum(len(instants) for _, instants, _ in cases),
    }


def simulated() -> Iterator[Line]:
    """Frame rate by motion by noise; how late the cameras are; and joints that are wrong, which is where it hurts."""
    rig = semicircle_rig()
    site = simulate(rig, workers=3, frames=round(SECONDS * SIMULATED_HZ), fps=SIMULATED_HZ, seed=3)

    def line(name: str, trials: Sequence[Trial], pixel_sigma: float, wrong_joints: float = 0.0) -> Line:
        cases = [
            (rig, one.instants(pixel_sigma, seed, wrong_joints), lambda i, one=one: one.truth_m[i.frame_set.index])
            for seed, one in enumerate(trials)
        ]
        return compared(name, cases)

    for fps in (30.0, 15.0, 5.0):
        for motion, factor in MOTIONS.items():
            trials = [trial(site, fps=fps, motion=factor, late=0.5, seed=seed) for seed in range(TRIALS)]
            for pixel_sigma in NOISES_PX if factor else NOISES_PX[1:]:
                yield line(f"interpolation.{fps:g}fps.{motion}.{pixel_sigma:g}px", trials, pixel_sigma)
    for late in (0.1, 0.2, 0.3):
        walk = MOTIONS["walking_0.9m_per_s"]
        trials = [trial(site, fps=30.0, motion=walk, late=late, seed=seed) for seed in range(TRIALS)]
        yield line(f"interpolation.30fps.walking_0.9m_per_s.1px.{late:g}frames_late", trials, 1.0)
    for fps in (30.0, 5.0):
        for motion in ("static", "walking_0.9m_per_s"):
            trials = [trial(site, fps=fps, motion=MOTIONS[motion], late=0.5, seed=seed) for seed in range(TRIALS)]
            yield line(f"interpolation.{fps:g}fps.{motion}.1px.wrong_joints", trials, 1.0, wrong_joints=0.1)


def real() -> Iterator[Line]:
    """OpenPose's detections of two people, thinned out, every other camera half a frame late.

    The truth at a common time is what all cameras together gave in the two frames around it, which shares the errors
    of the detector but none of those of time.
    """
    rig = rig_of(import_rig(REAL / "dataset.json", from_format=None, created_utc="2026-01-01T00:00:00Z"))
    known = read_detections(REAL / "data.npz", rig)
    views = [known.views(frame) for frame in known.frames]
    geometry = RigGeometry.of(rig)
    joints = [triangulate_people(geometry, seen, associate(geometry, seen)).joints_m for seen in views]
    for step in (2, 4, 8):
        late = [0 if view % 2 == 0 else step // 2 for view in range(len(rig.cameras))]
        instants = [
            instant(
                first,
                [round((first + by) * 1e9 / REAL_FPS) for by in late],
                [views[first + by][view] for view, by in enumerate(late)],
            )
            for first in range(0, len(views) - step, step)
        ]

        def truth(entry: Instant) -> Floats:
            place = entry.frame_set.t_ns * 1e-9 * REAL_FPS
            frame = int(place + 1e-3)
            return between(joints[frame], joints[frame + 1], place - frame)

        yield compared(f"interpolation.{REAL_FPS / step:g}fps.pose2sim_multi", [(rig, instants, truth)])


def between(first_m: Floats, second_m: Floats, part: float) -> Floats:
    """(W, 17, 3) people of two frames that are within 30 cm of each other, at a part of the way."""
    gaps = np.linalg.norm(first_m[:, None] - second_m[None], axis=-1)
    shared = np.isfinite(gaps)
    mean = np.where(shared, gaps, 0.0).sum(axis=-1) / np.maximum(shared.sum(axis=-1), 1)
    rows, columns = np.nonzero(shared.any(axis=-1) & (mean < 0.3))
    return np.asarray(first_m[rows] + part * (second_m[columns] - first_m[rows]))


def interpolation() -> Iterator[Line]:
    """Every line of this part."""
    yield from simulated()
    if REAL.exists():
        yield from real()


def main() -> int:
    """Print the lines, as ``make bench-sync`` does."""
    for line in interpolation():
        rounded = {key: float(f"{v:.4g}") if isinstance(v, float) else v for key, v in line.items()}
        print(json.dumps(rounded), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
