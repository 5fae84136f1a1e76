"""Who is who from frame to frame in one view: detections without identity, linked into tracklets.

Frame by frame, the open tracklets and the new detections are assigned one to one at the least total distance
(Hungarian method). The distance is the median over the joints that both show, in units of the person's size, so that
one gate serves the near and the far, and one swapped or wild joint does not part a person from herself. A tracklet
stays open through a short gap, over which its gate widens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from rigcal.geometry import Bools, Floats, Ints, freeze
from rigcal.sync.content.people.keypoints import JOINTS

GATE = 0.2
"""Median distance of the joints, over the person's size, beyond which two detections are two people: a runner at
6 m/s moves 0.2 m, a ninth of her size, between frames of 30 fps."""
GATE_PER_S = 1.5
"""How much the gate widens with each second of a gap: people walk at about their own height in a second."""
MAX_GAP_S = 0.4
"""Longest gap that is bridged; over longer ones another person may have come."""
MIN_FRAMES, MIN_SPAN_S = 5, 0.25
"""A shorter tracklet is not used: false detections rarely last so long."""
MIN_JOINTS = 4
"""Joints that a detection must show, and share with another, to be compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracklet:
    """One person in one view, for as long as she was followed."""

    t_s: Floats
    """(L,) stamps of the frames, ascending, by the camera's own clock."""
    frame: Ints
    """(L,) numbers of the frames."""
    points_px: Floats
    """(L, 17, 2) distorted pixels; NaN where a joint was not seen."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, t_s=(None,))
        freeze(self, np.int64, frame=(len(self.t_s),))
        freeze(self, np.float64, points_px=(len(self.t_s), JOINTS, 2))


def tracklets(frame: Ints, points_px: Floats, t_s: Floats) -> tuple[Tracklet, ...]:
    """Link the detections of one view.

    Args:
        frame: (N,) frame number of each detection, in any order.
        points_px: (N, 17, 2) its joints; NaN where not seen.
        t_s: (F,) stamp of each frame by the camera's clock; NaN where the view has no such frame: its detections
            are not used.

    Returns:
        The tracklets that are long enough, in the order in which they began. No detection is in two.
    """
    enough = np.isfinite(points_px[..., 0]).sum(axis=1) >= MIN_JOINTS
    usable = np.flatnonzero(enough & np.isfinite(t_s[frame]))
    order = usable[np.argsort(t_s[frame[usable]], kind="stable")]
    sizes = person_sizes(points_px)
    members = _linked(order, t_s[frame], points_px, sizes)
    long = [rows for rows in members if _long_enough(t_s[frame[rows]])]
    return tuple(Tracklet(t_s[frame[rows]], frame[rows], points_px[rows]) for rows in map(np.array, long))


def person_sizes(points: Floats) -> Floats:
    """(...,) diagonal of the box that holds the joints (..., 17, 2); NaN where none is seen."""
    seen = np.isfinite(points).all(axis=-1, keepdims=True)
    low = np.where(seen, points, np.inf).min(axis=-2)
    high = np.where(seen, points, -np.inf).max(axis=-2)
    size = np.hypot(*np.moveaxis(np.where(high >= low, high - low, np.nan), -1, 0))
    return np.asarray(size)


def _long_enough(t_s: Floats) -> bool:
    return len(t_s) >= MIN_FRAMES and bool(t_s[-1] - t_s[0] >= MIN_SPAN_S)


def _linked(order: Ints, stamp_s: Floats, points_px: Floats, sizes: Floats) -> list[list[int]]:
    """Rows of the detections in each tracklet; ``order`` holds the usable rows by ascending stamp."""
    done: list[list[int]] = []
    still_open: list[list[int]] = []
    starts = np.flatnonzero(np.diff(stamp_s[order], prepend=-np.inf) > 0)
    for rows in np.split(order, starts[1:]) if len(order) else []:
        now_s = stamp_s[rows[0]]
        closed: Bools = np.array([now_s - stamp_s[members[-1]] > MAX_GAP_S for members in still_open], dtype=bool)
        done += [members for members, over in zip(still_open, closed, strict=True) if over]
        still_open = [members for members, over in zip(still_open, closed, strict=True) if not over]
        last = np.array([members[-1] for members in still_open], dtype=np.int64)
        taken = set()
        for old, new in _matched(last, rows, now_s - stamp_s[last], points_px, sizes):
            still_open[old].append(int(rows[new]))
            taken.add(new)
        still_open += [[int(row)] for new, row in enumerate(rows) if new not in taken]
    return sorted(done + still_open, key=lambda members: members[0])


def _matched(last: Ints, new: Ints, gap_s: Floats, points_px: Floats, sizes: Floats) -> list[tuple[int, int]]:
    """Which of the rows ``last`` goes on in which of the rows ``new``, within the gate."""
    if not len(last) or not len(new):
        return []
    apart = np.linalg.norm(points_px[last][:, None] - points_px[new][None], axis=-1)
    shared = np.isfinite(apart).sum(axis=-1)
    middle = _median(apart, shared)
    relative = middle / np.sqrt(sizes[last][:, None] * sizes[new][None])
    gate = GATE + GATE_PER_S * gap_s[:, None]
    cost = np.where((shared >= MIN_JOINTS) & (relative < gate), relative / gate, 2.0)
    rows, columns = linear_sum_assignment(cost)
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if cost[r, c] < 1]


def _median(values: Floats, known: Ints) -> Floats:
    """The lower median (...,) of the ``known`` values that are not NaN of each row (..., 17)."""
    middle = np.maximum(known - 1, 0) // 2
    return np.take_along_axis(np.sort(values, axis=-1), middle[..., None], axis=-1)[..., 0]
