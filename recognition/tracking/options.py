"""The options of the tracked method."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from recognition.observed import DetectorModel
from rigcal.errors import OptionError


@dataclass(frozen=True, slots=True)
class FollowOptions:
    """How workers and objects are followed: lengths in metres, times in seconds, angles by way of the detector's.

    The figures, unless they say another source: means of two simulated rigs of three cameras at 15 and four at 60
    instants a second, in front of which four workers cross, seen by a detector that errs by limbs, exchanges left and
    right, loses people for a second and finds false ones; 14 simulated objects with 3 px noise; and the shared
    multi-person capture. Most values matter little, which is why one set serves every rig.

    Raises:
        OptionError: where a value is negative or infinite, or an evidence below 1.
    """

    detector: DetectorModel = field(default_factory=DetectorModel)
    claim_sigmas: float = 5.0
    """How far the joints of a detection may be, on average, from those of the track that claims it. The athlete of the
    shared capture is placed by MoveNet from two cameras in 90 of 100 frames at 3, beside a false worker, in 97 at 4, in
    100 at 5 and 6; crowds of eight, and OpenPose, are alike from 3 to 6."""
    group_sigmas: float = 3.0
    """How far the joints of two detections that no track claimed may be from each other's epipolar lines. Crowds of
    eight and the simulated rigs are alike from 2 to 4. A claim from farther away gives way to a group, and a hint is
    not claimed from there: in nine rendered sequences (eight of validation, the demo) 0.3 % of the claims of the worker
    whom a track follows are farther, 17 % of those of another, and 52 % of those of nobody. At 2 instead, 13 of 2352
    sights of workers are lost and 9 false ones come."""
    thing_sigmas: float = 4.0
    """The same two for objects, which have one point. 14 objects are alike from 3 to 6."""
    confident_m: float = 0.25
    """A worker predicted with a larger standard deviation across a camera's rays claims nothing there, and is looked
    for among those whom the remaining detections place. Precision 0.975 at 0.15, 0.986 at 0.25 and 0.4."""
    keep_s: float = 2.5
    """How long a track that two cameras do not see, one of them for sure, keeps its identity: an occlusion of two
    seconds, and some."""
    candidate_keep_s: float = 0.2
    """The same before it has one; 0.05 to 0.5 s are alike."""
    carry_s: float = 0.5
    """How long what is not seen is still told, where it is predicted to be. Parts right 93.1 % at 0.1 s, 93.8 at 0.25,
    94.0 at 0.5 and 1; mean error of joints 47.9, 49.3, 50.1 mm."""
    max_sigma_m: float = 0.15
    """Points with a larger standard deviation along each axis are not told. Parts right 93.4 % at 0.1 m, 94.0 at 0.15,
    94.2 at 0.25; mean error of joints 49.2, 50.1, 50.7 mm."""
    start_worker: int = 34
    """Evidence for a new worker: the sum over joints of (cameras - 1), added over successive instants. A body of which
    four cameras see two thirds of the joints starts at the first instant, one that two see at the second. Recall 0.985
    at 17, 0.983 at 34, 0.980 at 68; none makes a false worker of MoveNet's detections."""
    start_object: int = 6
    """Evidence for a new object: (cameras - 1), added over successive instants; two for four cameras, six for two.
    Recall 0.997 at 3, 0.990 at 6, 0.976 at 12, of 6.7 s; none makes a false object."""
    worker_jump_m: float = 0.5
    """How far a worker may be found from where it was predicted, without a gap in time; 0.3 to 0.8 m are alike."""
    object_jump_m: float = 0.2
    """The same for objects; 0.1 to 0.5 m are alike."""
    search_m_per_s: float = 1.2
    """What both grow by while it is not seen: a walking worker; 0.6 to 2 m/s are alike."""
    search_most_m: float = 2.5
    """What they grow to."""
    apart_m: float = 0.4
    """A new worker whose joints are nearer than this to another's, on average, is that one, found twice; of two tracks
    within half of it one ends. Precision 0.971 at 0.2 m, 0.986 at 0.4 and 0.6."""
    object_apart_m: float = 0.12
    """The same for objects of one class; 0.25 m is alike."""
    worn: tuple[str, ...] = ("hard_hat",)
    """Classes that are found by the heads of the workers who wear them. Recall of hats 0.997, with one identity each;
    by the paper's method, epipolar lines alone, 0.899 with 13 exchanges in ten seconds."""

    def __post_init__(self) -> None:
        for name in (
            "claim_sigmas", "group_sigmas", "thing_sigmas", "confident_m", "keep_s", "candidate_keep_s", "carry_s",
            "max_sigma_m", "worker_jump_m", "object_jump_m", "search_m_per_s", "search_most_m", "apart_m",
            "object_apart_m",
        ):  # fmt: skip
            if not 0 <= getattr(self, name) < np.inf:
                raise OptionError(name, expected="a number not below 0", got=getattr(self, name))
        for name in ("start_worker", "start_object"):
            if getattr(self, name) < 1:
                raise OptionError(name, expected="a count of 1 or more", got=getattr(self, name))
