"""Workers of a run, judged by a truth in 3D."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from recognition.errors import DatasetError
from recognition.evaluation.timed import TimedTruth
from recognition.metrics import AGREE_M, Scores, Truth, nearest_m, score
from recognition.observations import Instant, Scene
from recognition.poses import Poses
from rigcal.geometry import Ints, Pose

FEW = 0.2
"""Recall below this raises the question whether truth and tracks have one frame."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What a run was worth."""

    scores: Scores
    instants: int
    """How many were run."""
    scenes: int
    """At how many of them something could be placed."""
    truth_instants: int
    """How many the truth knows."""
    warnings: tuple[str, ...] = ()
    """What may make the figures say less than they seem to."""


def evaluate_people(
    instants: Iterable[Instant],
    place: Callable[[Instant], Scene | None],
    truth: Truth | TimedTruth,
    *,
    world_from_rig: Pose | None,
    scored: Collection[int] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Evaluation:
    """Place the workers of every instant and score their tracks.

    Args:
        instants: In order of time.
        place: What turns an instant into a scene, such as a placer's ``place``.
        truth: Of frames numbered as the instants are, or of times; in the world frame where ``world_from_rig`` is
            given, else in the rig frame.
        world_from_rig: Of the rig.
        scored: The workers over whom PCP3D is averaged; None: all.
        progress: Called with the number of instants done.

    Raises:
        DatasetError: where the truth knows none of the instants.
    """
    number, t_ns, scenes = [], [], []
    for instant in instants:
        number.append(instant.frame_set.index)
        t_ns.append(instant.frame_set.t_ns)
        if (scene := place(instant)) is not None:
            scenes.append(scene)
        if progress:
            progress(len(number))
    numbers, times_ns = np.array(number, dtype=np.int64), np.array(t_ns, dtype=np.int64)
    known = truth.at(numbers, times_ns) if isinstance(truth, TimedTruth) else truth
    frames = np.unique(known.frame)
    judged = np.isin(numbers, frames)
    if not judged.any():
        raise DatasetError(
            "the truth knows none of the instants of this run",
            where=None,
            expected="frames or times that both have",
            got=f"a truth of {len(frames)} frames{_span(frames)}, a run of {len(numbers)} instants{_span(numbers)}",
            do_next="see that gt_frame counts as det_frame does, or that the rig's clocks are those of the truth",
        )
    poses = Poses.of(scenes, world_from_rig)
    scores = score(known, poses, period_s=_period_s(times_ns[judged]), scored=scored)
    warnings = [*_unrun(frames, numbers), *_unknown(scores)]
    if scores.recall < FEW:
        warnings += _elsewhere(known, scenes, world_from_rig)
    return Evaluation(scores, len(numbers), len(scenes), len(frames), tuple(warnings))


def _span(numbers: Ints) -> str:
    return f", {numbers.min()} to {numbers.max()}" if len(numbers) else ""


def _unrun(frames: Ints, numbers: Ints) -> Iterator[str]:
    lacking = frames[~np.isin(frames, numbers)]
    if len(lacking):
        yield (
            f"{len(lacking)} of the truth's {len(frames)} frames{_span(lacking)}, are not of this run"
            f"{_span(numbers)}: whoever is there counts as missed"
        )


def _unknown(scores: Scores) -> Iterator[str]:
    names = [name for name, share in scores.pcp3d_parts.items() if np.isnan(share)]
    if names:
        yield f"the truth does not know these parts, and PCP3D is without them: {', '.join(names)}"


def _elsewhere(truth: Truth, scenes: Sequence[Scene], world_from_rig: Pose | None) -> Iterator[str]:
    """Where the tracks are, if not where the truth is: in another frame, perhaps."""
    away_m = _away_m(truth, scenes, world_from_rig)
    if not np.isfinite(away_m) or away_m < AGREE_M:
        return
    frame = "the rig frame, as the rig file has no world" if world_from_rig is None else "the world of the rig file"
    text = f"the tracks are {away_m:.3g} m from the truth (median), which must be in metres in {frame}"
    if world_from_rig is not None and _away_m(truth, scenes, None) < AGREE_M:
        text += "; it is in the rig frame: apply the rig file's world_from_rig to it"
    yield text


def _away_m(truth: Truth, scenes: Sequence[Scene], world_from_rig: Pose | None) -> float:
    """How far tracks are from the truth, in the median of the rows that have one at their instant; NaN for none."""
    away_m = nearest_m(truth, Poses.of(scenes, world_from_rig))
    there = away_m[np.isfinite(away_m)]
    return float(np.median(there)) if len(there) else float("nan")


def _period_s(t_ns: Ints) -> float:
    """Usual time between instants; NaN for a single one."""
    gaps_s = np.diff(t_ns) * 1e-9
    return float(np.median(gaps_s)) if len(gaps_s) else float("nan")
