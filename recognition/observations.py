"""The values that flow through the runtime, from pixels to tracks; all immutable.

Workers are COCO-17 skeletons. A joint that is not known is NaN, never 0. ``V`` is the number of the rig's
cameras, in rig order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Floats, Ints, freeze

JOINTS = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle",
    "right_ankle",
)  # fmt: skip
"""COCO-17 joint names, in order."""

LIMBS = (
    (0, 1), (0, 2), (1, 3), (2, 4), (5, 6), (5, 7), (7, 9), (6, 8), (8, 10), (5, 11), (6, 12), (11, 12), (11, 13),
    (13, 15), (12, 14), (14, 16),
)  # fmt: skip
"""Pairs of joints that a skeleton's lines join."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewDetections:
    """What one camera saw at one instant, in distorted pixels at the rig's image size."""

    people_px: Floats
    """(P, 17, 2) joints of P people; NaN where a joint was not detected."""
    people_score: Floats
    """(P, 17) score of each joint, 0..1; 0 where it was not detected."""
    object_class: tuple[str, ...]
    """(K,) class of each object."""
    object_xyxy: Floats
    """(K, 4) boxes: left, top, right, bottom."""
    object_score: Floats
    """(K,) scores, 0..1."""
    object_keypoints_px: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))
    """(K, 4, 2) up to four keypoints of each object, in one of the orders that its class has, which differs between
    views (:mod:`recognition.keypoints`); NaN where one was not detected. Without it: none was."""
    hints: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(H,) which of the people, ascending, scored too little to count alone: they count only together with what another
    camera saw. Without it: none."""

    def __post_init__(self) -> None:
        people, objects = len(self.people_px), len(self.object_class)
        if len(self.object_keypoints_px) == 0:
            object.__setattr__(self, "object_keypoints_px", np.full((objects, 4, 2), np.nan))
        for name in ("people_px", "people_score", "object_xyxy", "object_score", "object_keypoints_px"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))  # as a replay reads them back
        freeze(self, np.float64, people_px=(people, 17, 2), people_score=(people, 17))
        freeze(self, np.float64, object_xyxy=(objects, 4), object_score=(objects,))
        freeze(self, np.float64, object_keypoints_px=(objects, 4, 2))
        freeze(self, np.int64, hints=(None,))
        if len(self.hints) and np.isin(np.arange(people), self.hints).sum() < len(self.hints):
            raise ValueError(f"hints: expected some of the {people} people, each once, got {self.hints.tolist()}")

    @classmethod
    def empty(cls) -> ViewDetections:
        """Nothing seen."""
        return cls(np.zeros((0, 17, 2)), np.zeros((0, 17)), (), np.zeros((0, 4)), np.zeros(0))

    @property
    def counted(self) -> Ints:
        """(P - H,) which of the people are no hints, ascending."""
        return np.delete(np.arange(len(self.people_px)), self.hints)

    @property
    def object_px(self) -> Floats:
        """(K, 2) centres of the boxes."""
        return np.asarray((self.object_xyxy[:, :2] + self.object_xyxy[:, 2:]) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class ViewFrame:
    """One camera's frame of a frame set."""

    frame_idx: int
    """Index of the frame within its camera's stream."""
    t_ns: int
    """Capture time in rig time, nanoseconds."""
    image_bgr: NDArray[np.uint8]
    """(H, W, 3) decoded image."""
    encoded: bytes | None = None
    """The camera's own bytes for this frame, where they can be recorded as they are."""
    encoding: str = ""
    """``h264`` (Annex B), ``jpeg`` or ``png``: the form of ``encoded``."""


@dataclass(frozen=True, slots=True)
class FrameSet:
    """The frames of one instant, one per camera at the most."""

    index: int
    """Number of the instant, from 0."""
    t_ns: int
    """The instant's common time: rig time in nanoseconds."""
    views: tuple[ViewFrame | None, ...]
    """(V,) frames in rig order; None where a camera has none."""
    times_ns: tuple[int | None, ...] = ()
    """(V,) rig time of what each camera saw, None where it took no part. Without it: the times of the frames, or the
    common one for every camera where nobody has a frame, as with detections alone."""

    def __post_init__(self) -> None:
        if not self.times_ns:
            own = tuple(None if view is None else view.t_ns for view in self.views)
            known = own if any(t_ns is not None for t_ns in own) else (self.t_ns,) * len(own)
            object.__setattr__(self, "times_ns", known)

    @property
    def cameras(self) -> int:
        """How many cameras took part."""
        return sum(t_ns is not None for t_ns in self.times_ns)


@dataclass(frozen=True, slots=True)
class Instant:
    """One instant, ready for 3D."""

    frame_set: FrameSet
    views: tuple[ViewDetections, ...]
    """(V,) what each camera saw, where it was at the camera's own time."""
    common: tuple[ViewDetections, ...] = ()
    """(V,) the same detections, where they were at the common time; without it: ``views`` as they are."""

    def __post_init__(self) -> None:
        if not self.common:
            object.__setattr__(self, "common", self.views)


@dataclass(frozen=True, slots=True, eq=False)
class People3D:
    """Workers of one instant, triangulated, without identity."""

    joints_m: Floats
    """(M, 17, 3) joints in the rig frame; NaN where fewer than two cameras gave the joint."""
    views: Ints
    """(M, 17) how many cameras gave each joint."""
    error_px: Floats
    """(M, 17) root-mean-square reprojection error in undistorted pixels; NaN where the joint is."""
    members: Ints
    """(M, V) index of the detection in each view, -1 where none."""

    def __post_init__(self) -> None:
        count = len(self.joints_m)
        freeze(self, np.float64, joints_m=(count, 17, 3), error_px=(count, 17))
        freeze(self, np.int64, views=(count, 17), members=(count, None))


@dataclass(frozen=True, slots=True, eq=False)
class Objects3D:
    """Objects of one instant: the paper's weak pose, the triangulated centre of the boxes."""

    classes: tuple[str, ...]
    """(K,) classes."""
    centre_m: Floats
    """(K, 3) in the rig frame; NaN where fewer than two cameras saw it."""
    views: Ints
    """(K,) how many cameras saw it."""
    error_px: Floats
    """(K,) root-mean-square reprojection error in undistorted pixels."""
    members: Ints
    """(K, V) index of the detection in each view, -1 where none."""

    def __post_init__(self) -> None:
        count = len(self.classes)
        freeze(self, np.float64, centre_m=(count, 3), error_px=(count,))
        freeze(self, np.int64, views=(count,), members=(count, None))


@dataclass(frozen=True, slots=True, eq=False)
class WorkerTrack:
    """A worker with an identity, at one instant."""

    track_id: int
    joints_m: Floats
    """(17, 3) in the rig frame; NaN: not known at this instant."""
    views: Ints
    """(17,) how many cameras gave each joint; 0 for one that is carried from what was seen before."""
    members: Ints
    """(V,) index of its detection in each view, -1 where none."""
    covariance_m2: Floats = field(default_factory=lambda: np.full((17, 3, 3), np.nan))
    """(17, 3, 3) covariance of each joint; NaN where the joint is, or where the method states none."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectTrack:
    """An object with an identity, at one instant."""

    track_id: int
    object_class: str
    centre_m: Floats
    """(3,) in the rig frame."""
    views: int
    """How many cameras saw it; 0 where it is carried from what was seen before."""
    members: Ints
    """(V,) index of its detection in each view, -1 where none."""
    covariance_m2: Floats = field(default_factory=lambda: np.full((3, 3), np.nan))
    """(3, 3) covariance of the centre; NaN where the method states none."""
    keypoints_m: Floats = field(default_factory=lambda: np.full((4, 3), np.nan))
    """(4, 3) keypoints in the rig frame, in one of the orders that the class has, the same as long as the object is
    followed (:mod:`recognition.keypoints`); NaN where not known, or where the cameras disagree."""
    size_m: tuple[float, float] = (math.nan, math.nan)
    """Width and height of its boxes at its depth, the mean of the cameras that saw it now; NaN where none did."""
    keypoint_covariance_m2: Floats = field(default_factory=lambda: np.full((4, 3, 3), np.nan))
    """(4, 3, 3) covariance of each keypoint; NaN where the keypoint is."""


Status = Literal["MONITORED", "DEGRADED", "NOT MONITORED"]
"""Whether an empty scene means that nobody is there: with every camera, with some of them, or not at all."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything known in 3D at one instant."""

    index: int
    t_ns: int
    workers: tuple[WorkerTrack, ...]
    objects: tuple[ObjectTrack, ...]
    status: Status = "MONITORED"
    """``NOT MONITORED``: nothing can be told of this instant, and the absence of workers means nothing."""
    reason: str = ""
    """Why it is not ``MONITORED``, in words; empty where it is."""
    cameras: int | None = None
    """How many cameras took part; None where nobody counted."""
