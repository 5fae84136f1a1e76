"""Groups of detections that no track claimed, given to tracks that claimed nothing, to candidates, or to nobody yet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recognition.association.leftovers import Leftovers
from recognition.association.paper import match
from recognition.tracking.population import Population
from rigcal.geometry import Bools, Floats, Ints

_CANDIDATES_LAST_M = 10.0
"""Added to the distance of candidates, so that identities choose first."""
_HELD = 10.0
"""By what the distance of a group is divided that has a detection which the track would claim."""


@dataclass(frozen=True, slots=True)
class Search:
    """How far a track may be found from where it was predicted, and which are one found twice."""

    jump_m: float
    speed_m_per_s: float
    most_m: float
    apart_m: float

    def reach_m(self, gap_s: Floats) -> Floats:
        """(T,) after gaps (T,)."""
        return np.minimum(self.jump_m + self.speed_m_per_s * gap_s, self.most_m)


def met(
    tracks: Population,
    members: Ints,
    held: Ints,
    groups: Leftovers,
    label: Ints,
    lost: Bools,
    search: Search,
    t_ns: int,
) -> tuple[Population, Ints]:
    """Tracks and the new ones, and the members (T, V) of both.

    Args:
        tracks: Predicted.
        members: (T, V) what they claimed.
        held: (T, V) what they would claim if it is nobody else's: where they do not know their place, or what lies far
            from it. A group that has it is theirs if they claimed nothing; what no group has they keep.
        groups: Of what was not claimed.
        label: (G,) classes of the groups.
        lost: (T,) whose prediction is worth little: found, they start again from where they are.
        search: Distances.
        t_ns: Rig time.
    """
    if not len(groups.members):
        return tracks, np.maximum(members, held)
    waiting = np.flatnonzero((members < 0).all(axis=1))
    grouped = np.zeros(max(held.max(initial=-1), groups.members.max()) + 2, dtype=np.bool_)
    grouped[groups.members] = True
    members = np.where((members < 0) & ~grouped[held], held, members)
    taken = np.zeros(len(groups.members), dtype=np.bool_)
    if len(waiting):
        apart_m = distances_m(tracks.rows(waiting), groups.place_m)
        reach_m = search.reach_m(np.asarray((t_ns - tracks.placed_ns[waiting]) * 1e-9))
        theirs = ((held[waiting, None] == groups.members) & (groups.members >= 0)).any(axis=2)
        able = ((apart_m < reach_m[:, None]) | theirs) & (tracks.label[waiting, None] == label)
        apart_m = np.where(theirs, apart_m / _HELD, apart_m)
        apart_m += _CANDIDATES_LAST_M * (tracks.track_id[waiting, None] == 0)
        rows, columns = match(np.where(able, apart_m, np.inf), np.inf)
        members[waiting[rows]] = groups.members[columns]
        taken[columns] = True
        again = lost[waiting[rows]]
        if again.any():
            tracks = tracks.anew(waiting[rows][again], groups.place_m[columns[again]])
    fresh = np.flatnonzero(~taken)
    if len(fresh):
        there = tracks.rows((members >= 0).any(axis=1) & (tracks.track_id > 0))
        near = (distances_m(there, groups.place_m[fresh]) < search.apart_m) & (there.label[:, None] == label[fresh])
        fresh = fresh[~near.any(axis=0)]
        tracks = tracks.joined(Population.at(groups.place_m[fresh], label[fresh]))
        members = np.concatenate([members, groups.members[fresh]])
    return tracks, members


def distances_m(tracks: Population, place_m: Floats) -> Floats:
    """(T, G) mean distance of the points that tracks and places (G, J, 3) share; of their middles where none is."""
    own = tracks.place_m
    there: Bools = np.asarray(np.isfinite(place_m[..., 0]))
    place_m = np.where(there[..., None], place_m, 0.0)
    between = own[:, None] - place_m
    both = tracks.known[:, None] & there
    count = both.sum(axis=-1)
    mean_m = (np.sqrt((between * between).sum(axis=-1)) * both).sum(axis=-1) / np.maximum(count, 1)
    if count.all():
        return np.asarray(mean_m)
    middles = _middle(own, tracks.known)[:, None] - _middle(place_m, there)
    return np.asarray(np.where(count > 0, mean_m, np.sqrt((middles * middles).sum(axis=-1))))


def _middle(place_m: Floats, known: Bools) -> Floats:
    return np.asarray((place_m * known[..., None]).sum(axis=1) / np.maximum(known.sum(axis=1), 1)[:, None])
