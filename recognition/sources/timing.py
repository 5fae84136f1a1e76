"""Which frames of a capture make an instant, and when each was taken: in rig time, to the nanosecond.

Frames are grouped by :mod:`rigcal.instants`, after the clock models, nearest within half a frame and one to one. A
frame that is left over is an instant of its camera alone: it is recorded, and says nothing in 3D. The common time of
an instant is the mean of the times of its frames.

Decision: instants are put into an order in which the frames of every camera follow one another in time, which that
of the common times is not always (a camera with twice the rate of the others may have a frame before a common time
whose own frame is earlier still). A recording's times must not run backwards, nor a video's frames be exchanged.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rigcal.captures import Capture, CaptureCamera
from rigcal.geometry import Bools, Floats, Ints, freeze
from rigcal.instants import find_instants
from rigcal.rig import ClockModel
from rigcal.stamps import FrameStamps, frame_stamps, same_epoch

STAMPED = ("timestamps.csv", "file times")
"""The rules by which each frame has a time of its own."""


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """The instants of a capture, as some of its cameras took part in them."""

    rule: str
    """How they were found: ``timestamps.csv``, ``file times``, ``frame numbers`` or ``none``."""
    number: Ints
    """(I,) number of each instant among those of the whole capture, from 0."""
    frame_idx: Ints
    """(I, V) index of each camera's frame, -1 where it has none."""
    frame_t_ns: Ints
    """(I, V) rig time of each frame; where the rule knows no times, that of the instant."""
    t_ns: Ints
    """(I,) common time: the mean of the times of the frames."""

    def __post_init__(self) -> None:
        count, shape = len(self.number), self.frame_idx.shape
        freeze(self, np.int64, number=(count,), t_ns=(count,), frame_idx=(count, None), frame_t_ns=shape)

    @property
    def seen(self) -> Bools:
        """(I, V) which cameras took part."""
        return np.asarray(self.frame_idx >= 0)

    @property
    def spread_s(self) -> Floats:
        """(S,) time between the first and the last frame of each instant that two cameras or more took part in."""
        shared = self.seen.sum(axis=1) > 1
        latest = np.where(self.seen, self.frame_t_ns, self.frame_t_ns.min(initial=0)).max(axis=1)
        earliest = np.where(self.seen, self.frame_t_ns, self.frame_t_ns.max(initial=0)).min(axis=1)
        return np.asarray((latest - earliest)[shared] * 1e-9)


@dataclass(frozen=True, slots=True)
class CaptureClocks:
    """The stamps of a capture, and the clock models that they are read by."""

    stamps: FrameStamps | None
    used: Mapping[str, ClockModel]
    """The clock of each camera of the capture that has one, and stamps which it can be applied to."""
    elsewhere: frozenset[str]
    """Cameras whose clock was measured in another epoch than that of the stamps, and is left out."""


def capture_clocks(capture: Capture, clocks: Mapping[str, ClockModel | None]) -> CaptureClocks:
    """The clock models that apply to a capture's stamps; ``clocks`` are by the capture's camera identifiers."""
    stamps = frame_stamps(capture)
    if stamps is None or not stamps.shared:
        return CaptureClocks(stamps, {}, frozenset())
    known = {c: clock for c, clock in clocks.items() if clock is not None}
    times_s = {camera.id: t_s for camera, t_s in zip(capture.cameras, stamps.times_s, strict=True)}
    elsewhere = frozenset(c for c, clock in known.items() if not same_epoch(times_s[c], clock))
    return CaptureClocks(stamps, {c: clock for c, clock in known.items() if c not in elsewhere}, elsewhere)


def capture_timing(capture: Capture, clocks: CaptureClocks, columns: Sequence[int], *, fps: float) -> Timing:
    """The instants of a capture.

    Args:
        capture: The capture; all of its cameras take part in the grouping.
        clocks: Its stamps and their clock models.
        columns: (V,) which of the capture's cameras each of the rig's is; -1 for one that is left out.
        fps: Frame rate where neither stamps nor videos tell any.

    Raises:
        TimestampsError: where ``timestamps.csv`` contradicts the capture.
    """
    instants = find_instants(capture, clocks.used)
    absent = np.full((len(instants.frame_idx), 1), -1)
    frame_idx = np.hstack([instants.frame_idx, absent])[:, columns]
    number = np.flatnonzero((frame_idx >= 0).any(axis=1))
    frame_idx = frame_idx[number]
    if clocks.stamps is not None and clocks.stamps.shared:
        frame_t_ns, t_ns = _by_stamps(capture, clocks.stamps, clocks.used, columns, frame_idx)
    else:
        t_s = _seconds(instants.t_s[number], frame_idx, columns, capture.cameras, fps)
        t_ns = np.rint(t_s * 1e9).astype(np.int64)
        frame_t_ns = np.repeat(t_ns[:, None], len(columns), axis=1)
    order = _following(t_ns, frame_t_ns, frame_idx)
    return Timing(instants.rule, number[order], frame_idx[order], frame_t_ns[order], t_ns[order])


def _by_stamps(
    capture: Capture,
    stamps: FrameStamps,
    clocks: Mapping[str, ClockModel],
    columns: Sequence[int],
    frame_idx: Ints,
) -> tuple[Ints, Ints]:
    """Rig times (I, V) of the frames, and (I,) their means."""
    frame_t_ns = np.zeros_like(frame_idx)
    for v, column in enumerate(columns):
        if column >= 0:
            own_ns = _in_rig_time(stamps.times_ns[column], clocks.get(capture.cameras[column].id))
            frame_t_ns[:, v] = own_ns[frame_idx[:, v]]
    seen = frame_idx >= 0
    first_ns = np.where(seen, frame_t_ns, np.iinfo(np.int64).max).min(axis=1)
    later_ns = np.where(seen, frame_t_ns - first_ns[:, None], 0)
    t_ns = first_ns + np.rint(later_ns.sum(axis=1) / seen.sum(axis=1)).astype(np.int64)
    return np.where(seen, frame_t_ns, t_ns[:, None]), t_ns


def _in_rig_time(t_cam_ns: Ints, clock: ClockModel | None) -> Ints:
    return t_cam_ns if clock is None else np.array([clock.rig_time_ns(t) for t in t_cam_ns.tolist()], dtype=np.int64)


def _seconds(
    number: Floats, frame_idx: Ints, columns: Sequence[int], cameras: Sequence[CaptureCamera], fps: float
) -> Floats:
    """Times of instants without stamps: those of the first video that is in all of them, else number / frame rate."""
    chosen = [(v, cameras[column]) for v, column in enumerate(columns) if column >= 0]
    for v, camera in chosen:
        if camera.times_s and (frame_idx[:, v] >= 0).all():
            return np.array([camera.times_s[frame] for frame in frame_idx[:, v]])
    rate = next((camera.fps for _, camera in chosen if camera.fps), fps)
    return number / rate


def _following(t_ns: Ints, frame_t_ns: Ints, frame_idx: Ints) -> Ints:
    """(I,) rows by their common time, but none before one that holds an earlier frame of one of its cameras.

    Kahn's topological order with a heap. Stamps that no order can satisfy are left in order of common time.
    """
    seen = frame_idx >= 0
    open_cameras = seen.sum(axis=1)
    after: list[list[int]] = [[] for _ in t_ns]
    for v in range(seen.shape[1]):
        rows = np.flatnonzero(seen[:, v])
        rows = rows[np.lexsort((frame_idx[rows, v], frame_t_ns[rows, v]))]
        open_cameras[rows[:1]] -= 1
        for row, following in pairwise(rows.tolist()):
            after[row].append(following)
    ready = [(int(t_ns[row]), int(row)) for row in np.flatnonzero(open_cameras == 0)]
    heapq.heapify(ready)
    order: list[int] = []
    while ready:
        order.append(heapq.heappop(ready)[1])
        for row in after[order[-1]]:
            open_cameras[row] -= 1
            if open_cameras[row] == 0:
                heapq.heappush(ready, (int(t_ns[row]), row))
    placed = np.array(order, dtype=np.int64)
    left = np.setdiff1d(np.argsort(t_ns, kind="stable"), placed, assume_unique=True)
    return np.concatenate([placed, left])
