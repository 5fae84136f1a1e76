"""The tracklets of a view as directions in the rig frame, on a raster of time: what pairs of views compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Bools, Floats, Ints
from rigcal.rig import RigCamera
from rigcal.sync.content.people.tracklets import MAX_GAP_S, Tracklet, person_sizes

Singles: TypeAlias = NDArray[np.float32]
COMPARED = np.array([0, *range(5, 17)])
"""The joints that the search compares: eyes and ears say what the nose says."""


@dataclass(frozen=True, slots=True, eq=False)
class PeopleView:
    """The people of one view at T instants of its camera's clock, ``(first + k) * step_s``.

    A slot holds tracklets one after the other, so that there are about as many slots as people at any instant.
    """

    direction: Singles
    """(3, P, T, 13) unit directions in the rig frame of the compared joints, a row of instants for each of P slots; NaN
    where not seen."""
    size_rad: Singles
    """(P, T) how large the person appears; NaN where nobody is in the slot."""
    tracklet: Ints
    """(P, T) index of the tracklet in the slot; -1 where nobody is."""
    first: int
    """Number of the first instant."""
    step_s: float
    """Time from one instant to the next."""

    @property
    def instants(self) -> int:
        """T, the number of instants."""
        return int(self.tracklet.shape[1])

    @property
    def people(self) -> Bools:
        """(P, T) whether somebody is in the slot."""
        return np.asarray(self.tracklet >= 0)

    def between(self, first: int, end: int) -> PeopleView:
        """The same view from instant number ``first`` up to ``end``."""
        start = min(max(first - self.first, 0), self.instants)
        stop = max(start, min(end - self.first, self.instants))
        columns = slice(start, stop)
        kept = self.direction[:, :, columns], self.size_rad[:, columns], self.tracklet[:, columns]
        return PeopleView(*kept, self.first + start, self.step_s)


def people_view(mounted: RigCamera, seen: Sequence[Tracklet], step_s: float, offset_s: float = 0.0) -> PeopleView:
    """Resample the tracklets of a view linearly, between frames that are at most a short gap apart.

    Args:
        mounted: the camera.
        seen: its tracklets.
        step_s: raster of time.
        offset_s: what to add to the camera's stamps first.
    """
    ends = offset_s + np.array([(tracklet.t_s[0], tracklet.t_s[-1]) for tracklet in seen]).reshape(-1, 2)
    first = np.ceil(ends[:, 0] / step_s - 1e-6).astype(np.int64)
    end = np.maximum(np.floor(ends[:, 1] / step_s + 1e-6).astype(np.int64) + 1, first)
    slot = slots(first, end)
    begin, stop = (int(first.min()), int(end.max())) if len(seen) else (0, 0)
    rows = max(slot, default=-1) + 1
    direction = np.full((3, rows, stop - begin, len(COMPARED)), np.nan, dtype=np.float32)
    size_rad = np.full((rows, stop - begin), np.nan, dtype=np.float32)
    owner = np.full((rows, stop - begin), -1, dtype=np.int64)
    for index, (tracklet, row) in enumerate(zip(seen, slot, strict=True)):
        xy = _resampled(mounted, tracklet, np.arange(first[index], end[index]) * step_s - offset_s)
        columns = slice(first[index] - begin, end[index] - begin)
        direction[:, row, columns] = _directions(mounted, xy)
        somebody = np.isfinite(xy).any(axis=(1, 2))
        size = np.nanmedian(person_sizes(mounted.camera.undistort(tracklet.points_px)))
        size_rad[row, columns] = np.where(somebody, size, np.nan)
        owner[row, columns] = np.where(somebody, index, -1)
    return PeopleView(direction, size_rad, owner, begin, step_s)


def busiest(views: Sequence[PeopleView], span_s: float) -> list[PeopleView]:
    """The same views, cut to the stretch of at most ``span_s`` with the most people in them."""
    first, end = min(view.first for view in views), max(view.first + view.instants for view in views)
    people = np.zeros(max(end - first, 0) + 1)
    for view in views:
        people[view.first - first + 1 : view.first - first + 1 + view.instants] += view.people.sum(axis=0)
    length = round(span_s / views[0].step_s)
    if length >= end - first:
        return list(views)
    before = np.cumsum(people)
    start = first + int(np.argmax(before[length:] - before[:-length]))
    return [view.between(start, start + length) for view in views]


def _resampled(mounted: RigCamera, tracklet: Tracklet, t_s: Floats) -> Floats:
    """Normalised coordinates (T, 13, 2) at instants (T,) within a tracklet."""
    xy = mounted.camera.undistort(tracklet.points_px[:, COMPARED])
    after = np.clip(np.searchsorted(tracklet.t_s, t_s), 1, len(tracklet.t_s) - 1)
    gap_s = tracklet.t_s[after] - tracklet.t_s[after - 1]
    share = np.clip((t_s - tracklet.t_s[after - 1]) / gap_s, 0.0, 1.0)[:, None, None]
    before = xy[after - 1]
    inner = before + share * (xy[after] - before)
    between = np.where(share < 1e-6, before, np.where(share > 1 - 1e-6, xy[after], inner))
    between[gap_s > MAX_GAP_S] = np.nan
    return np.asarray(between)


def _directions(mounted: RigCamera, xy: Floats) -> Floats:
    """Unit directions (3, T, 13) in the rig frame of normalised coordinates (T, 13, 2)."""
    rays = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1) @ mounted.cam_from_rig.rotation
    return np.moveaxis(rays / np.linalg.norm(rays, axis=-1, keepdims=True), -1, 0)


def slots(first: Ints | Floats, end: Ints | Floats) -> list[int]:
    """The slot of each interval from ``first`` (N,) up to ``end`` (N,): the lowest that is free again."""
    free: list[float] = []
    slot = [0] * len(first)
    for index in np.argsort(first, kind="stable"):
        row = next((row for row, until in enumerate(free) if until <= first[index]), len(free))
        if row == len(free):
            free.append(0.0)
        free[row], slot[index] = float(end[index]), row
    return slot
