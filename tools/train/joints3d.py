"""Joints in the world: the recognition pipeline over a sequence's videos, against where the joints are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from recognition.association import match
from recognition.detectors.protocol import Detector
from recognition.feeds import FeedOptions, open_feed
from recognition.observations import JOINTS
from recognition.poses import Poses
from recognition.recording import Recorder
from recognition.runtime import RunOptions, run
from rigcal.geometry import Bools, Floats
from tools.sicsg.truth import Visibility
from tools.train.sequences import EvaluationSequence

SAME_M = 0.5
"""A worker that is found farther than this from every true one, in the mean over the joints, shows nobody."""
NEAR_M = 0.15
"""A joint that is found within this counts as found there."""


@dataclass(frozen=True, slots=True, eq=False)
class Distances:
    """What the pipeline made of the joints of one sequence; N true workers, over all instants."""

    error_m: Floats
    """(N, 17) distance from the true joint; NaN where it was not found."""
    asked: Bools
    """(N, 17) whether two cameras or more see the joint."""
    false_workers: int
    """Workers found that match nobody."""
    instants: int


def run_pipeline(sequence: EvaluationSequence, detector: Detector, options: RunOptions | None = None) -> Poses:
    """What ``recognition run`` makes of the videos with the true rig: detect, associate, triangulate, track, record."""
    rig = sequence.rig
    feed = open_feed(rig, sequence.folder, None, detector, FeedOptions([True] * len(rig.cameras), sequence.fps))
    with TemporaryDirectory() as folder:
        rig_json = (sequence.folder / "true.rig.json").read_bytes()
        with Recorder(Path(folder) / "run.mcap", rig=rig, rig_json=rig_json, metadata={}) as recorder:
            result = run(rig, feed.instants, recorder, options or RunOptions())
    return Poses.of(result.scenes, rig.world_from_rig)


def distances(sequence: EvaluationSequence, poses: Poses) -> Distances:
    """Every true worker matched to what was found at the nearest time, within half an instant."""
    facts, arrays = sequence.facts, sequence.arrays
    found_s = (poses.t_ns - round(facts["epoch_s"] * 1e9)) * 1e-9
    seen = (arrays["joints_seen"] == Visibility.VISIBLE).sum(axis=1) >= 2
    errors, asked, false = [], [], 0
    for frame, t_s in enumerate(facts["instants_s"]):
        mine = poses.joints_m[np.abs(found_s - t_s) < 0.5 / sequence.fps]
        true = arrays["joints_m"][frame]
        error_m = errors_of(true, mine)
        errors.append(error_m)
        asked.append(seen[frame])
        false += len(mine) - int(np.isfinite(error_m).any(axis=1).sum())
    return Distances(np.concatenate(errors), np.concatenate(asked), false, len(facts["instants_s"]))


def errors_of(true_m: Floats, found_m: Floats) -> Floats:
    """(W, 17) distances of true joints (W, 17, 3) from those of the worker (P, 17, 3) that is matched; NaN: none."""
    apart = np.linalg.norm(true_m[:, None] - found_m[None], axis=-1)
    known = np.isfinite(apart)
    mean = np.where(known, apart, 0.0).sum(axis=-1) / np.maximum(known.sum(axis=-1), 1)
    rows, columns = match(np.where(known.any(axis=-1), mean, np.inf), SAME_M)
    errors = np.full(true_m.shape[:2], np.nan)
    errors[rows] = apart[rows, columns]
    return errors


def joint_facts(parts: Sequence[Distances]) -> dict[str, Any]:
    """Errors in millimetres and recalls over several sequences."""
    if not parts:
        return {"workers": 0}
    error_mm = 1000.0 * np.concatenate([part.error_m for part in parts])
    asked = np.concatenate([part.asked for part in parts])
    found = np.isfinite(error_mm)
    some = asked.any(axis=1)
    return {
        "workers": int(some.sum()),
        "worker_recall": _share(found.any(axis=1) & some, some),
        "false_workers_per_instant": sum(p.false_workers for p in parts) / max(sum(p.instants for p in parts), 1),
        "joints_found": int(found.sum()),
        "median_mm": _quantile(error_mm[found], 0.5),
        "p90_mm": _quantile(error_mm[found], 0.9),
        "asked": int(asked.sum()),
        "recall": _share(found & asked, asked),
        "recall_near": _share((error_mm <= 1000.0 * NEAR_M) & asked, asked),
        "median_of_asked_mm": _quantile(error_mm[found & asked], 0.5),
        "p90_of_asked_mm": _quantile(error_mm[found & asked], 0.9),
        "by_joint": {
            name: {
                "median_mm": _quantile(error_mm[found[:, index], index], 0.5),
                "p90_mm": _quantile(error_mm[found[:, index], index], 0.9),
                "recall": _share(found[:, index] & asked[:, index], asked[:, index]),
            }
            for index, name in enumerate(JOINTS)
        },
    }


def _share(part: Bools, whole: Bools) -> float:
    return float(part.sum() / whole.sum()) if whole.any() else float("nan")


def _quantile(values: Floats, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else float("nan")
