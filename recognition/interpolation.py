"""Detections moved to an instant's common time, for cameras that are not triggered together.

Frames of one instant are up to half a frame apart, in which a walking worker moves 25 mm at 30 fps and 150 mm at
5 fps. Between two frames of its own camera a detection moves almost straight, so that each joint and each box is
interpolated linearly at the common time, before the views are associated. A detection without a partner in the
neighbouring frame stays where it was seen, and so does a joint that jumps.

The common time lies between a frame and its neighbour, so that independent noise is averaged, never amplified. A
parabola through three frames follows better without noise and worse with it (walkers at 15 fps: 0.0 mm instead of 0.6
without, 12.2 instead of 10.9 with 3 px).

Decision: an option, off by default. Median error of the joints of simulated walkers with 1 px noise, cameras up to
half a frame late: 5.0 mm as they are and 3.7 interpolated at 30 fps, 6.5 and 3.8 at 15 fps, 14.4 and 5.5 at 5 fps; of
two people seen by OpenPose at 30 fps 3.2 and 2.6. It hurts where joints are wrong, not noisy, for it spreads them to
the frames around: of people who stand still, with 10 % of the joints some 80 px off, 5.5 and 6.1 mm at 30 fps, 5.5 and
8.2 at 5 fps.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from recognition.association import match
from recognition.observations import Instant, ViewDetections
from rigcal.geometry import Floats, Ints

MAX_GAP_S = 0.25
"""Frames of a camera further apart than this are no neighbours: a leg swings forward in half a second."""
BODY_M = 1.75
"""What the diagonal of a whole body's joints stands for."""
MAX_SPEED_M_PER_S = 6.0
"""Of a person, as the mean of the joints; a sprinter on a site."""
MAX_JOINT_SPEED_M_PER_S = 12.0
"""Of one joint: a wrist or a foot moves at about twice the speed of its body."""
MAX_SIZES_PER_S = 10.0
"""Of an object, in diagonals of its box: a hard hat on a walking head does 4."""
MAX_SIZE_RATIO = 1.5
"""Of the diagonals of one detection in two neighbouring frames."""
NOISE_PX = 10.0
"""What a detector may add to any distance."""


class Seen(NamedTuple):
    """What a camera saw in one of its frames."""

    t_ns: int
    """Rig time of the frame."""
    detections: ViewDetections


def at_time(t_ns: int, before: Seen | None, now: Seen, after: Seen | None) -> ViewDetections:
    """The detections of a frame, where they were at another time.

    Args:
        t_ns: The time.
        before: What the camera saw in the frame before; None where there is none.
        now: The frame.
        after: The frame after it.

    Returns:
        The detections of ``now`` in their order, with their scores; only positions differ.
    """
    other = after if t_ns > now.t_ns else before
    if t_ns == now.t_ns or other is None:
        return now.detections
    gap_s = abs(other.t_ns - now.t_ns) * 1e-9
    if not 0 < gap_s <= MAX_GAP_S:
        return now.detections
    part = (t_ns - now.t_ns) / (other.t_ns - now.t_ns)
    xyxy, keypoints_px = _objects(now.detections, other.detections, part, gap_s)
    return replace(
        now.detections,
        people_px=_people_px(now.detections, other.detections, part, gap_s),
        object_xyxy=xyxy,
        object_keypoints_px=keypoints_px,
    )


def in_common_time(instants: Iterable[Instant]) -> Iterator[Instant]:
    """Instants with the detections of each camera at the common time, :attr:`Instant.common`.

    An instant leaves when the next frame of each camera that needs one is there: one instant late where every camera
    takes part in each, and at most :data:`MAX_GAP_S` late. Each camera's frames come in order of time.
    """
    waiting: deque[Instant] = deque()
    before: dict[int, Seen] = {}
    for instant in instants:
        waiting.append(instant)
        while len(waiting) > 1 and _settled(waiting):
            yield _in_common_time(waiting, before)
    while waiting:
        yield _in_common_time(waiting, before)


def _settled(waiting: Sequence[Instant]) -> bool:
    """Whether the next frame of each camera of the first instant is known, or too late to matter."""
    frame_set, latest = waiting[0].frame_set, waiting[-1].frame_set
    if latest.t_ns - frame_set.t_ns > MAX_GAP_S * 1e9:
        return True
    return all(
        t_ns is None or t_ns >= frame_set.t_ns or _after(waiting, view) is not None
        for view, t_ns in enumerate(frame_set.times_ns)
    )


def _after(waiting: Sequence[Instant], view: int) -> Seen | None:
    """The camera's next frame after the first instant."""
    return next((seen for instant in islice(waiting, 1, None) if (seen := _seen(instant, view))), None)


def _seen(instant: Instant, view: int) -> Seen | None:
    t_ns = instant.frame_set.times_ns[view]
    return None if t_ns is None else Seen(t_ns, instant.views[view])


def _in_common_time(waiting: deque[Instant], before: dict[int, Seen]) -> Instant:
    """The first of the instants that wait, moved; it waits no more, and ``before`` becomes what it saw."""
    instant, common = waiting[0], list(waiting[0].views)
    for view in range(len(common)):
        now = _seen(instant, view)
        if now is not None:
            common[view] = at_time(instant.frame_set.t_ns, before.get(view), now, _after(waiting, view))
            before[view] = now
    waiting.popleft()
    return replace(instant, common=tuple(common))


def _people_px(now: ViewDetections, other: ViewDetections, part: float, gap_s: float) -> Floats:
    """(P, 17, 2) joints on the way to where the same person's are in the other frame."""
    size_px = _sizes_px(now.people_px)
    mine, theirs = _same_people(now.people_px, other.people_px, size_px, gap_s)
    step_px = other.people_px[theirs] - now.people_px[mine]
    limit_px = NOISE_PX + MAX_JOINT_SPEED_M_PER_S * gap_s * size_px[mine] / BODY_M
    steady = np.linalg.norm(step_px, axis=-1) <= limit_px[:, None]
    moved_px = now.people_px.copy()
    moved_px[mine] += np.where(steady[..., None], part * step_px, 0.0)
    return moved_px


def _same_people(first_px: Floats, second_px: Floats, size_px: Floats, gap_s: float) -> tuple[Ints, Ints]:
    """Rows of the people (P, 17, 2) and (Q, 17, 2) of two frames who are the same, by the distance of their joints."""
    distance_px = np.linalg.norm(first_px[:, None] - second_px[None, :], axis=-1)
    shared = np.isfinite(distance_px)
    mean_px = np.where(shared, distance_px, 0.0).sum(axis=-1) / np.maximum(shared.sum(axis=-1), 1)
    limit_px = NOISE_PX + MAX_SPEED_M_PER_S * gap_s * size_px / BODY_M
    both = np.where(shared[..., None], first_px[:, None], np.nan), np.where(shared[..., None], second_px[None], np.nan)
    near = shared.any(axis=-1) & (mean_px <= limit_px[:, None]) & _alike(*map(_sizes_px, both))
    return match(np.where(near, mean_px, np.inf), np.inf)


def _objects(now: ViewDetections, other: ViewDetections, part: float, gap_s: float) -> tuple[Floats, Floats]:
    """(K, 4) boxes on the way to where the same object's are in the other frame, and (K, 4, 2) their keypoints.

    A keypoint that the other frame lacks, or has too far away, moves with the middle of the box.
    """
    size_px, other_px = (
        np.linalg.norm(seen.object_xyxy[:, 2:] - seen.object_xyxy[:, :2], axis=1) for seen in (now, other)
    )
    limit_px = NOISE_PX + MAX_SIZES_PER_S * gap_s * size_px
    distance_px = np.linalg.norm(now.object_px[:, None] - other.object_px[None, :], axis=-1)
    names, others = np.array(now.object_class, dtype=np.str_), np.array(other.object_class, dtype=np.str_)
    near = distance_px <= limit_px[:, None]
    same = near & (names[:, None] == others[None, :]) & _alike(size_px[:, None], other_px[None, :])
    mine, theirs = match(np.where(same, distance_px, np.inf), np.inf)
    moved, keypoints_px = now.object_xyxy.copy(), now.object_keypoints_px.copy()
    moved[mine] += part * (other.object_xyxy[theirs] - moved[mine])
    step_px = other.object_keypoints_px[theirs] - keypoints_px[mine]
    steady = np.linalg.norm(step_px, axis=-1) <= limit_px[mine, None]
    middle_px = (other.object_px[theirs] - now.object_px[mine])[:, None]
    keypoints_px[mine] += part * np.where(steady[..., None], step_px, middle_px)
    return moved, keypoints_px


def _sizes_px(points_px: Floats) -> Floats:
    """(...) diagonals of the boxes around points (..., J, 2); 0 where none is known."""
    known = np.isfinite(points_px)
    least = np.where(known, points_px, np.inf).min(axis=-2)
    most = np.where(known, points_px, -np.inf).max(axis=-2)
    return np.asarray(np.linalg.norm(np.where(most >= least, most - least, 0.0), axis=-1))


def _alike(first_px: Floats, second_px: Floats) -> np.ndarray:
    """Whether two sizes may be of one detection, seen a moment apart."""
    larger, smaller = np.maximum(first_px, second_px), np.minimum(first_px, second_px)
    return np.asarray(larger <= MAX_SIZE_RATIO * smaller + NOISE_PX)
