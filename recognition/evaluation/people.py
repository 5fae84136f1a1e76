"""Workers of a run, judged by a truth in 3D."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass

import numpy as np

from recognition.errors import DatasetError
from recognition.evaluation.timed import TimedTruth
from recognition.metrics import Scores, Truth, score
from recognition.observations import Instant, Scene
from recognition.poses import Poses
from rigcal.geometry import Ints, Pose


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
            got=f"a truth of {len(frames)} frames, a run of {len(numbers)} instants",
            do_next="see that gt_frame counts as det_frame does, or that the rig's clocks are those of the truth",
        )
    poses = Poses.of(scenes, world_from_rig)
    scores = score(known, poses, period_s=_period_s(times_ns[judged]), scored=scored)
    return Evaluation(scores, len(numbers), len(scenes), len(frames))


def _period_s(t_ns: Ints) -> float:
    """Usual time between instants; NaN for a single one."""
    gaps_s = np.diff(t_ns) * 1e-9
    return float(np.median(gaps_s)) if len(gaps_s) else float("nan")
