"""Who is who across the views once the clocks are about right: tracklets joined into people, people into tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from rigcal.geometry import Floats, Ints
from rigcal.sync.content.people.keypoints import JOINTS
from rigcal.sync.content.people.pairs import ViewPair
from rigcal.sync.content.people.tracklets import Tracklet
from rigcal.sync.content.people.views import PeopleView, slots
from rigcal.sync.content.tracks import PointTracks

LEAST_NEARNESS = 0.3
"""Mean nearness over their common time above which two tracklets may be one person; the best match is joined first, so
that this decides only about people whom no other view shows."""
LEAST_COMMON_S = 0.5
"""Common time below which tracklets are not compared."""
_PART_S = 0.5
"""Time between two people who use the same indices one after the other: no interpolation reaches from one to the
next."""


def joined_people(
    views: Sequence[PeopleView], pairs: Mapping[tuple[int, int], ViewPair], offsets: Mapping[int, int]
) -> list[frozenset[tuple[int, int]]]:
    """Tracklets of all views that show one person, as (view, tracklet) pairs; those that no other view confirms are
    left out.

    The clearest match is joined first; one that would put a person in two places of a view at once is refused.

    Args:
        views: (V,) views.
        pairs: the pairs of views with offsets.
        offsets: of the views, in steps.
    """
    matches = [match for pair in combinations(sorted(offsets), 2) for match in _matches(views, pairs, pair, offsets)]
    person: dict[tuple[int, int], frozenset[tuple[int, int]]] = {}
    busy = {member: _instants(views[member[0]], member[1]) for _, *both in matches for member in both}
    for _, one, two in sorted(matches, key=lambda match: -match[0]):
        first, second = (person.get(member, frozenset({member})) for member in (one, two))
        if first is second or _clash(first, second, busy):
            continue
        person.update(dict.fromkeys(first | second, first | second))
    return sorted(set(person.values()), key=sorted)


def point_tracks(
    camera_ids: Sequence[str],
    people: Sequence[frozenset[tuple[int, int]]],
    seen: Sequence[Sequence[Tracklet]],
    times_s: Floats,
    offset_s: Mapping[int, float],
) -> list[PointTracks]:
    """The people's joints as points that have the same index in every camera.

    An index may serve one person after another; never two at a time.

    Args:
        camera_ids: (V,) of all views.
        people: as :func:`joined_people` gives them.
        seen: (V,) tracklets of each view.
        times_s: (F, V) stamps; NaN where the view has no such frame.
        offset_s: of the views that are wanted.
    """
    ends = [_span_s(members, seen, offset_s) for members in people]
    index = slots(np.array([first for first, _ in ends]), np.array([last + _PART_S for _, last in ends]))
    count = JOINTS * (max(index, default=-1) + 1)
    tracks = []
    for view in offset_s:
        points_px = np.full((len(times_s), count // JOINTS, JOINTS, 2), np.nan)
        for slot, members in zip(index, people, strict=True):
            for tracklet in (seen[v][k] for v, k in members if v == view):
                points_px[tracklet.frame, slot] = tracklet.points_px
        there = np.flatnonzero(np.isfinite(times_s[:, view]))
        order = there[np.argsort(times_s[there, view], kind="stable")]
        flat = points_px[order].reshape(len(order), count, 2)
        tracks.append(PointTracks(camera_ids[view], times_s[order, view], flat))
    return tracks


def _matches(
    views: Sequence[PeopleView],
    pairs: Mapping[tuple[int, int], ViewPair],
    pair: tuple[int, int],
    offsets: Mapping[int, int],
) -> list[tuple[float, tuple[int, int], tuple[int, int]]]:
    """Total nearness and the two tracklets of every two that may be one person."""
    if pair not in pairs:
        return []
    here, there = pairs[pair].overlap(offsets[pair[1]] - offsets[pair[0]])
    owner_a, owner_b = views[pair[0]].tracklet[:, here], views[pair[1]].tracklet[:, there]
    size_b = int(owner_b.max(initial=-1)) + 2
    code = (owner_a[:, None] + 1) * size_b + owner_b[None] + 1
    near = np.bincount(code.ravel(), pairs[pair].nearness(here, there).ravel())
    common = np.bincount(code.ravel(), minlength=len(near))
    enough = (near >= LEAST_NEARNESS * common) & (common * views[0].step_s >= LEAST_COMMON_S)
    found = [(int(c), *divmod(int(c), size_b)) for c in np.flatnonzero(enough)]
    return [(float(near[c]), (pair[0], a - 1), (pair[1], b - 1)) for c, a, b in found if a and b]


def _instants(view: PeopleView, tracklet: int) -> Ints:
    return np.flatnonzero((view.tracklet == tracklet).any(axis=0))


def _clash(
    first: frozenset[tuple[int, int]], second: frozenset[tuple[int, int]], busy: Mapping[tuple[int, int], Ints]
) -> bool:
    """Whether two people are in one view at the same time."""
    return any(
        len(np.intersect1d(busy[one], busy[two], assume_unique=True)) > 0
        for one in first
        for two in second
        if one[0] == two[0]
    )


def _span_s(
    members: frozenset[tuple[int, int]], seen: Sequence[Sequence[Tracklet]], offset_s: Mapping[int, float]
) -> tuple[float, float]:
    """First and last rig time of a person."""
    spans = [seen[v][k].t_s[[0, -1]] + offset_s[v] for v, k in members if v in offset_s]
    return float(np.min(spans)), float(np.max(spans))
