"""How near tracked workers are to a known truth: PCP3D, MPJPE, recall, precision, identity switches, IDF1.

Every figure is of the truth's instants; what was tracked at others is passed over. A worker and a track *agree* at an
instant where the mean distance of the joints that both have is at most :data:`AGREE_M`. Each figure has the pairs that
its own source gives it:

- **PCP3D**, the percentage of correct parts (Belagiannis et al., "3D Pictorial Structures for Multiple Human Pose
  Estimation", CVPR 2014): a part from s to e is correct where ``(|s - s'| + |e - e'|) / 2 <= alpha |s - e|``, alpha
  0.5, as for the data sets Shelf and Campus. Each worker is given, instant by instant, the track that has most of the
  parts right, by whatever identity. A part that the truth does not know is not counted; one that the track does not
  know is wrong, and without a track all are. The figure of a worker is over all its instants, and the mean over
  workers is the figure of a data set (a worker of few instants weighs as much as another).
- **Correspondences** over time after Bernardin and Stiefelhagen ("Evaluating Multiple Object Tracking Performance: The
  CLEAR MOT Metrics", 2008): a worker keeps its track as long as the two agree, the others are matched one to one at
  the least total distance. Of them are recall, precision, MPJPE (mean over the joints of all pairs), the joints found
  (known to the truth and within :data:`FOUND_M` in the worker's track), identity switches (a worker's track is another
  than its last) and MOTA.
- **IDF1** after Ristani et al. ("Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking", 2016):
  workers and tracks are paired one to one for the whole time so that they agree at the most instants.

The parts are the ten of Shelf and Campus in COCO-17 joints: upper and lower arms and legs; the torso, from the middle
of the shoulders to the middle of the hips (there: from the neck); the head, from the middle of the shoulders to the
middle of the ears (there: from neck to crown, which COCO-17 does not have).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.optimize import linear_sum_assignment

from recognition.association import match
from recognition.poses import Poses
from rigcal.geometry import Bools, Floats, Ints, freeze

ALPHA = 0.5
"""Share of a part's length by which its ends may be wrong, on average."""
AGREE_M = 0.5
"""Mean distance of the shared joints up to which a track may be a worker; the limit that is usual for recall."""
FOUND_M = 0.15
"""Distance up to which a joint counts as found."""
PARTS = (
    ("upper arms", (5,), (7,)), ("upper arms", (6,), (8,)), ("lower arms", (7,), (9,)), ("lower arms", (8,), (10,)),
    ("upper legs", (11,), (13,)), ("upper legs", (12,), (14,)), ("lower legs", (13,), (15,)),
    ("lower legs", (14,), (16,)), ("torso", (5, 6), (11, 12)), ("head", (5, 6), (3, 4)),
)  # fmt: skip
"""Name of each part, and the joints whose middles are its two ends."""


PROTOCOL: Mapping[str, str] = MappingProxyType(
    {
        "PCP3D": f"parts with (|s - s'| + |e - e'|) / 2 <= {ALPHA:g} |s - e|, over the ten parts of COCO-17 that the "
        "truth knows; each worker, instant by instant, with the track that has most of them right; mean over workers "
        "(Belagiannis et al. 2014)",
        "recall, precision, MPJPE, switches, MOTA": f"workers and tracks matched over time, up to {AGREE_M:g} m of "
        "mean distance (CLEAR MOT, Bernardin and Stiefelhagen 2008); MPJPE over the joints of all pairs, not aligned",
        "IDF1": "workers and tracks paired one to one for the whole time (Ristani et al. 2016)",
    }
)
"""What each figure is, in a sentence for those who read it."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Where workers are, at the instants at which it is known: G rows."""

    frame: Ints
    """(G,) number of the instant."""
    person: Ints
    """(G,) which worker."""
    joints_m: Floats
    """(G, 17, 3) in the frame of the poses that are scored; NaN where not known."""

    def __post_init__(self) -> None:
        count = len(self.frame)
        freeze(self, np.int64, frame=(count,), person=(count,))
        freeze(self, np.float64, joints_m=(count, 17, 3))

    @classmethod
    def of(cls, joints_m: Floats) -> Truth:
        """From the joints (F, W, 17, 3) of W workers at the instants 0 to F - 1; rows that are all NaN: not there."""
        frame, person = np.nonzero(np.isfinite(joints_m).any(axis=(2, 3)))
        return cls(frame, person, joints_m[frame, person])


@dataclass(frozen=True, slots=True)
class PersonScore:
    """One worker of the truth."""

    person: int
    instants: int
    """At how many the truth has it."""
    pcp3d: float
    """Share of correct parts, 0..1; NaN where the truth has no whole part."""
    recall: float
    """Share of its instants at which it has a track."""
    mpjpe_m: float
    """Mean distance of its tracks' joints; NaN where it has none."""
    switches: int
    """How often its track was another than its last."""


@dataclass(frozen=True, slots=True)
class Scores:
    """What tracks are worth; shares are 0..1, NaN where nothing can be said."""

    people: tuple[PersonScore, ...]
    """By ascending number."""
    pcp3d: float
    """Mean over ``people``, or over those of them that were asked for."""
    pcp3d_parts: Mapping[str, float]
    """Share of each kind of part that is correct, over all workers."""
    mpjpe_m: float
    recall: float
    """Share of the truth's rows that have a track."""
    joints_found: float
    """Share of the truth's joints that are within 15 cm in the worker's track."""
    precision: float
    """Share of the tracks' rows, at instants of the truth, that have a worker. Where the truth leaves out people who
    are there it says nothing."""
    switches: int
    switches_per_worker_minute: float
    idf1: float
    mota: float
    """1 - (rows of the truth without a track + rows of tracks without a worker + switches) / rows of the truth."""


@dataclass(frozen=True, slots=True, eq=False)
class _Meeting:
    """Workers and tracks of one instant."""

    truth: Ints
    """(T,) rows of the truth."""
    poses: Ints
    """(K,) rows of the poses."""
    distance_m: Floats
    """(T, K) mean distance of the shared joints; infinite where none is."""


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Which row of the poses each row of the truth has."""

    pose: Ints
    """(G,) row of the poses, -1 for none."""
    switched: Bools
    """(G,) whether its track is another than the worker's last."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, pose=(None,))
        freeze(self, np.bool_, switched=self.pose.shape)


def score(truth: Truth, poses: Poses, *, period_s: float, scored: Collection[int] | None = None) -> Scores:
    """All figures.

    Args:
        truth: Where the workers were.
        poses: Where they were tracked, in the same frame and with the same numbers of instants.
        period_s: Time between instants of the truth, seconds.
        scored: The workers over whom ``pcp3d`` is averaged, as Shelf leaves out the one who is hardly seen; None: all.

    Raises:
        ValueError: where the truth has no row.
    """
    if len(truth.frame) == 0:
        raise ValueError("truth: expected at least one row, got none")
    poses = _at_instants_of(truth, poses)
    known, correct = correct_parts(truth, poses)
    pairs = correspondences(truth, poses)
    found = pairs.pose >= 0
    error_m = np.full((len(truth.frame), 17), np.nan)
    error_m[found] = np.linalg.norm(poses.joints_m[pairs.pose[found]] - truth.joints_m[found], axis=-1)
    people = tuple(
        PersonScore(
            person=int(person),
            instants=int(own.sum()),
            pcp3d=_share(correct[own].sum(), known[own].sum()),
            recall=_share(found[own].sum(), own.sum()),
            mpjpe_m=_mean(error_m[own]),
            switches=int(pairs.switched[own].sum()),
        )
        for person in np.unique(truth.person)
        for own in [truth.person == person]
    )
    rows, tracked, switches = len(truth.frame), len(poses.frame), int(pairs.switched.sum())
    return Scores(
        people=people,
        pcp3d=_mean(np.array([person.pcp3d for person in people if scored is None or person.person in scored])),
        pcp3d_parts=_by_part(known, correct),
        mpjpe_m=_mean(error_m),
        recall=_share(found.sum(), rows),
        joints_found=_share((error_m <= FOUND_M).sum(), np.isfinite(truth.joints_m).all(axis=-1).sum()),
        precision=_share(found.sum(), tracked),
        switches=switches,
        switches_per_worker_minute=60.0 * switches / (rows * period_s),
        idf1=idf1(truth, poses),
        mota=1.0 - (rows + tracked - 2 * int(found.sum()) + switches) / rows,
    )


def correct_parts(truth: Truth, poses: Poses) -> tuple[Bools, Bools]:
    """Which of the ten parts the truth knows, and which are correct in the track that has most of them right.

    Returns:
        (G, 10) twice, in the order of :data:`PARTS`; what is correct is known.
    """
    truth_m, tracked_m = _ends(truth.joints_m), _ends(poses.joints_m)
    known: Bools = np.asarray(np.isfinite(truth_m).all(axis=(2, 3)))
    length_m = np.linalg.norm(truth_m[:, :, 0] - truth_m[:, :, 1], axis=-1)
    correct = np.zeros(known.shape, dtype=np.bool_)
    for meeting in _meetings(truth, poses):
        if len(meeting.poses):
            off_m = np.linalg.norm(tracked_m[None, meeting.poses] - truth_m[meeting.truth, None], axis=-1).mean(axis=-1)
            right = off_m <= ALPHA * length_m[meeting.truth, None]
            best = right.sum(axis=-1).argmax(axis=1)
            correct[meeting.truth] = right[np.arange(len(best)), best]
    return known, correct


def correspondences(truth: Truth, poses: Poses) -> Correspondences:
    """Workers and tracks matched over time, each worker keeping its track as long as the two agree."""
    pose = np.full(len(truth.frame), -1)
    switched = np.zeros(len(truth.frame), dtype=np.bool_)
    last: dict[int, int] = {}
    for meeting in _meetings(truth, poses):
        costs_m = np.where(meeting.distance_m <= AGREE_M, meeting.distance_m, np.inf)
        had = np.array([last.get(int(person), -1) for person in truth.person[meeting.truth]], dtype=np.int64)
        kept = had[:, None] == poses.track_id[meeting.poses][None, :]
        rows, columns = match(np.where(kept, costs_m, np.inf), np.inf)
        costs_m[rows], costs_m[:, columns] = np.inf, np.inf
        more_rows, more_columns = match(costs_m, np.inf)
        rows, columns = np.concatenate([rows, more_rows]), np.concatenate([columns, more_columns])
        pose[meeting.truth[rows]] = meeting.poses[columns]
        now = poses.track_id[meeting.poses[columns]]
        switched[meeting.truth[rows]] = (had[rows] >= 0) & (had[rows] != now)
        last.update(zip(truth.person[meeting.truth[rows]].tolist(), now.tolist(), strict=True))
    return Correspondences(pose, switched)


def nearest_m(truth: Truth, poses: Poses) -> Floats:
    """(G,) mean distance of the joints that each worker shares with the track that is nearest; infinite without one."""
    result = np.full(len(truth.frame), np.inf)
    for meeting in _meetings(truth, poses):
        result[meeting.truth] = meeting.distance_m.min(axis=1, initial=np.inf)
    return result


def idf1(truth: Truth, poses: Poses) -> float:
    """Twice the instants at which paired workers and tracks agree, over the rows of both; 0..1."""
    poses = _at_instants_of(truth, poses)
    persons, person = np.unique(truth.person, return_inverse=True)
    tracks, track = np.unique(poses.track_id, return_inverse=True)
    together = np.zeros((len(persons), len(tracks)))
    for meeting in _meetings(truth, poses):
        rows, columns = np.nonzero(meeting.distance_m <= AGREE_M)
        together[person[meeting.truth[rows]], track[meeting.poses[columns]]] += 1
    most = together[linear_sum_assignment(together, maximize=True)].sum()
    return _share(2 * most, len(truth.frame) + len(poses.frame))


def _at_instants_of(truth: Truth, poses: Poses) -> Poses:
    kept = np.isin(poses.frame, truth.frame)
    return Poses(poses.frame[kept], poses.t_ns[kept], poses.track_id[kept], poses.joints_m[kept], poses.views[kept])


def _meetings(truth: Truth, poses: Poses) -> Iterator[_Meeting]:
    """The instants of the truth, in order."""
    by_frame = np.argsort(poses.frame, kind="stable")
    ascending = poses.frame[by_frame]
    for frame in np.unique(truth.frame):
        first, end = np.searchsorted(ascending, (frame, frame + 1))
        here, there = np.flatnonzero(truth.frame == frame), by_frame[first:end]
        yield _Meeting(here, there, _mean_distance_m(truth.joints_m[here], poses.joints_m[there]))


def _mean_distance_m(first_m: Floats, second_m: Floats) -> Floats:
    """(T, K) between skeletons (T, 17, 3) and (K, 17, 3)."""
    distance_m = np.linalg.norm(first_m[:, None] - second_m[None, :], axis=-1)
    shared = np.isfinite(distance_m)
    count = shared.sum(axis=-1)
    total_m = np.where(shared, distance_m, 0.0).sum(axis=-1)
    return np.where(count > 0, total_m / np.maximum(count, 1), np.inf)


def _ends(joints_m: Floats) -> Floats:
    """(N, 10, 2, 3) both ends of each part of skeletons (N, 17, 3)."""
    return np.stack(
        [
            np.stack([joints_m[:, list(start)].mean(axis=1), joints_m[:, list(end)].mean(axis=1)], axis=1)
            for _, start, end in PARTS
        ],
        axis=1,
    )


def _by_part(known: Bools, correct: Bools) -> dict[str, float]:
    names = np.array([name for name, _, _ in PARTS])
    kinds = dict.fromkeys(names.tolist())
    return {kind: _share(correct[:, names == kind].sum(), known[:, names == kind].sum()) for kind in kinds}


def _share(count: float, total: float) -> float:
    return float(count / total) if total else float("nan")


def _mean(values: Floats) -> float:
    """Of those that are known."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
