"""How far the demo's results are from the truth of its simulated site."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from recognition.recording import iter_messages
from rigcal.geometry import Floats, Ints
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import read_rigfile, rig_of

POSITION_MM, ROTATION_DEG, SIGMAS = 8.0, 0.1, 2.0
"""What calibration promises of this capture: within both, and within twice what its own uncertainty says."""
NEAR_M = {"worker": 0.5, "object": 0.5}
"""How far from the truth something found still counts as found: the mean over joints, or the centre."""
SEEN_PIXELS = 60
"""What a camera must show of an object for it to count as seen by it; two such cameras can place it."""


@dataclass(frozen=True, slots=True)
class CameraError:
    """A camera beside the truth, seen from the reference camera."""

    camera_id: str
    position_mm: float
    position_sigma_mm: float
    rotation_deg: float
    rotation_sigma_deg: float
    focal_percent: float

    @property
    def position_limit_mm(self) -> float:
        """The stricter of both limits."""
        return min(POSITION_MM, SIGMAS * self.position_sigma_mm)

    @property
    def rotation_limit_deg(self) -> float:
        """The stricter of both limits."""
        return min(ROTATION_DEG, SIGMAS * self.rotation_sigma_deg)

    @property
    def holds(self) -> bool:
        """Whether both errors are within their limits."""
        return self.position_mm <= self.position_limit_mm and self.rotation_deg <= self.rotation_limit_deg


@dataclass(frozen=True, slots=True)
class ClockError:
    """A camera's clock beside the truth, over the recording."""

    camera_id: str
    offset_ms: float
    """What was measured that is to be added to its stamps."""
    error_ms: float
    """The greatest over the recording."""
    bound_ms: float
    """What the error must not exceed, by the rig file."""

    @property
    def holds(self) -> bool:
        """Whether the truth lies within the bound."""
        return abs(self.error_ms) <= self.bound_ms


@dataclass(frozen=True, slots=True)
class FloorError:
    """The world frame beside the truth."""

    tilt_deg: float
    """Between both verticals."""
    origin_mm: float
    """Between both origins."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """How much of one kind of thing was found in 3D, and how well."""

    name: str
    there: int
    """Instants of each that two cameras or more saw, added up."""
    found: int
    false: int
    """Found where nothing of this kind is."""
    errors_m: Floats
    """(N,) distances from the truth: of every joint, or of every centre."""

    @property
    def share(self) -> float:
        """Part of what was there that was found."""
        return self.found / self.there if self.there else 0.0

    def error_mm(self, percent: float) -> float | None:
        """A percentile of the errors; None where nothing was found."""
        return float(np.percentile(self.errors_m, percent)) * 1e3 if len(self.errors_m) else None


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What is true of the work sequence."""

    facts: dict[str, Any]
    arrays: dict[str, np.ndarray]
    rig: RigDocument

    @property
    def instants_s(self) -> Floats:
        """(F,) true time of each instant after the start."""
        return np.asarray(self.facts["instants_s"], dtype=np.float64)

    def frames_at(self, t_ns: Ints) -> Ints:
        """The instant nearest to each rig time."""
        t_s = (np.asarray(t_ns) - round(self.facts["epoch_s"] * 1e9)) * 1e-9
        return np.abs(self.instants_s - t_s[:, None]).argmin(axis=1)


def read_truth(folder: Path) -> Truth:
    """The truth of a sequence's folder."""
    with np.load(folder / "truth.npz") as stored:
        arrays = dict(stored)
    return Truth(json.loads((folder / "truth.json").read_text()), arrays, read_rigfile(folder / "true.rig.json"))


def camera_errors(found: RigDocument, true: RigDocument) -> list[CameraError]:
    """Every camera but the reference, which both rigs are seen from; of it only the lens counts."""
    errors = []
    for camera in found.cameras:
        right = next(one for one in true.cameras if one.id == camera.id)
        pose, true_pose = camera.cam_from_rig.pose, right.cam_from_rig.pose
        gap = pose.inverse().translation_m - true_pose.inverse().translation_m
        sigma = camera.sigma
        if sigma is None:
            raise SystemExit(f"{camera.id}: the rig file tells no uncertainty")
        errors.append(
            CameraError(
                camera.id,
                float(np.linalg.norm(gap)) * 1e3,
                sigma.position_m * 1e3,
                float(np.rad2deg((pose @ true_pose.inverse()).angle_rad)),
                sigma.rotation_deg,
                100 * (camera.coefficients["fx"] / right.coefficients["fx"] - 1),
            )
        )
    return errors


def floor_error(found: RigDocument, true: RigDocument) -> FloorError:
    """Where the board on the floor put the world, beside where it is."""
    if found.world_from_rig is None or true.world_from_rig is None:
        raise SystemExit("the rig file has no world")
    gap = found.world_from_rig.pose @ true.world_from_rig.pose.inverse()
    tilt = float(np.rad2deg(np.arccos(np.clip(gap.rotation[2, 2], -1, 1))))
    return FloorError(tilt, float(np.linalg.norm(gap.translation_m)) * 1e3)


def clock_errors(found: RigDocument, truth: Truth) -> list[ClockError]:
    """The clocks at both ends of the recording."""
    errors = []
    for camera, right in zip(rig_of(found).cameras, rig_of(truth.rig).cameras, strict=True):
        clock, true_clock = camera.clock, right.clock
        if clock is None or true_clock is None:
            raise SystemExit(f"{camera.id}: the rig file has no clock")
        ends_s = truth.facts["epoch_s"] + truth.instants_s[[0, -1]]
        off = [clock.rig_time_s(float(t)) - true_clock.rig_time_s(float(t)) for t in ends_s]
        worst = int(np.argmax(np.abs(off)))
        bound = clock.bound_at_s(float(ends_s[worst]))
        errors.append(ClockError(camera.id, clock.offset_s * 1e3, off[worst] * 1e3, bound * 1e3))
    return errors


def workers_found(truth: Truth, poses: Path) -> Found:
    """Workers beside the truth."""
    with np.load(poses) as stored:
        frames, joints = truth.frames_at(stored["t_ns"]), stored["joints_m"].astype(np.float64)
    right = truth.arrays["joints_m"].astype(np.float64)
    seen = (truth.arrays["worker_pixels"] > 0).sum(axis=1) >= 2
    errors, found, matched = [np.zeros(0)], 0, 0
    for frame in np.unique(frames):
        rows = np.flatnonzero(frames == frame)
        gaps = np.linalg.norm(joints[rows, None] - right[frame][None], axis=-1)
        for row, worker in _pairs(np.nanmean(gaps, axis=-1), NEAR_M["worker"]):
            found, matched = found + int(seen[frame, worker]), matched + 1
            errors.append(gaps[row, worker][np.isfinite(gaps[row, worker])])
    return Found("worker", int(seen.sum()), found, len(frames) - matched, np.concatenate(errors))


def objects_found(truth: Truth, recording: Path) -> list[Found]:
    """Objects beside the truth, class by class."""
    seen = (truth.arrays["object_pixels"] >= SEEN_PIXELS).sum(axis=1) >= 2
    classes = [thing["class"] for thing in truth.facts["objects"]]
    centres = truth.arrays["object_m"].astype(np.float64)
    there: dict[str, list[tuple[int, Floats]]] = {}
    for frame, name, centre in _recorded_objects(truth, recording):
        there.setdefault(name, []).append((frame, centre))
    results = []
    for name in sorted(set(classes) | set(there)):
        own = [index for index, known in enumerate(classes) if known == name]
        found, false, errors = 0, 0, []
        for frame in range(len(truth.instants_s)):
            points = np.array([centre for at, centre in there.get(name, []) if at == frame]).reshape(-1, 3)
            gaps = np.linalg.norm(points[:, None] - centres[frame, own][None], axis=-1)
            pairs = _pairs(gaps, NEAR_M["object"])
            errors += [gaps[row, index] for row, index in pairs]
            found += sum(bool(seen[frame, own[index]]) for _, index in pairs)
            false += len(points) - len(pairs)
        if seen[:, own].any() or name in there:
            results.append(Found(name, int(seen[:, own].sum()), found, false, np.array(errors)))
    return results


def _recorded_objects(truth: Truth, recording: Path) -> Iterable[tuple[int, str, Floats]]:
    for recorded in iter_messages(recording, ["/scene"]):
        frame = int(truth.frames_at(np.array([recorded.publish_ns]))[0])
        for entity in recorded.message.entities:
            kind, _, rest = entity.id.partition("/")
            if kind == "object":
                at = entity.cubes[0].pose.position
                yield frame, rest.rpartition("/")[0], np.array([at.x, at.y, at.z])


def _pairs(gaps_m: Floats, near_m: float) -> list[tuple[int, int]]:
    """Pairs of found and true things, each once, that are nearest in all and not further apart than ``near_m``."""
    cost = np.where(np.isfinite(gaps_m), gaps_m, 1e3)
    rows, columns = linear_sum_assignment(np.minimum(cost, 10 * near_m))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if gaps_m[r, c] <= near_m]
