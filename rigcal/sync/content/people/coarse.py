"""The coarse search: one offset per camera, to a step of the raster, and whether it is clear."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rigcal.rig import Rig
from rigcal.sync.content.people.pairs import ViewPair
from rigcal.sync.content.people.search import PairTable, Profile
from rigcal.sync.content.people.tracklets import Tracklet
from rigcal.sync.content.people.verdict import search_problem
from rigcal.sync.content.people.views import PeopleView, busiest, people_view

STEP_S = 0.05
"""Raster of the search. On the shared captures all searches find the right step; 0.033 s does no better."""
SEARCHED_S = 20.0
"""The busiest stretch of a recording, which the search looks at."""
_SHARPENED_S = 0.1  # either way: two steps of the search
_LEAST_STEP_S = 0.008  # frames of 120 fps
_LEAST_BASELINE_M = 1e-3


@dataclass(frozen=True, slots=True)
class Coarse:
    """What the search found of V views."""

    reference: int
    steps: Mapping[int, int]
    """Offset of each view that has people in common with others, in steps; the reference's is 0."""
    offset_s: Mapping[int, float]
    """The same to a part of a frame: where most joints fit."""
    profiles: Mapping[int, Profile]
    """Of the same views but the reference."""
    problems: Mapping[int, str]
    """Of every view: why its offset is not clear; empty where it is."""

    @property
    def clear(self) -> tuple[int, ...]:
        """Views whose offset is clear, the reference first; empty where no other's is."""
        others = tuple(view for view in self.profiles if not self.problems[view])
        return (self.reference, *others) if others else ()


def view_pairs(rig: Rig, views: Sequence[PeopleView]) -> dict[tuple[int, int], ViewPair]:
    """Every two views between which there is a baseline and in both of which there are people."""
    centres = [mounted.cam_from_rig.inverse().translation_m for mounted in rig.cameras]
    return {
        (a, b): ViewPair(views[a], views[b], centres[b] - centres[a])
        for a, b in combinations(range(len(views)), 2)
        if np.linalg.norm(centres[b] - centres[a]) > _LEAST_BASELINE_M and views[a].instants and views[b].instants
    }


def search(rig: Rig, seen: Sequence[Sequence[Tracklet]], views: Sequence[PeopleView], search_s: float) -> Coarse:
    """Compare every two views at every lag, and find what explains all of them.

    Args:
        rig: the rig.
        seen: (V,) tracklets of each view.
        views: (V,) its views, on a raster of :data:`STEP_S`.
        search_s: largest lag between two views.
    """
    lags = np.arange(-round(search_s / STEP_S), round(search_s / STEP_S) + 1)
    pairs = view_pairs(rig, busiest(views, SEARCHED_S))
    table = PairTable({pair: compared.curve(lags) for pair, compared in pairs.items()}, lags)
    reference = _reference(rig, table, len(views))
    linked = table.linked(reference)
    steps = table.best(linked, reference)
    profiles = {view: table.profile(view, steps, reference) for view in linked if view != reference}
    problems = {view: _absence(views[view]) for view in range(len(views))}
    for view, profile in profiles.items():
        problems[view] = search_problem(profile, STEP_S, steps[view] * STEP_S, search_s)
    problems[reference] = "" if profiles else problems[reference]
    return Coarse(reference, steps, _sharpened(rig, seen, steps, reference), profiles, problems)


def _sharpened(
    rig: Rig, seen: Sequence[Sequence[Tracklet]], steps: Mapping[int, int], reference: int
) -> dict[int, float]:
    """Offsets on a raster as fine as the frames, near those of the search, and the tops of parabolas there."""
    start_s = {view: step * STEP_S for view, step in steps.items()}
    if len(steps) < 2:
        return start_s
    spacing_s = min(float(np.median(np.diff(tracklet.t_s))) for view in steps for tracklet in seen[view])
    step_s = max(spacing_s, _LEAST_STEP_S)
    views = [
        people_view(mounted, seen[view] if view in steps else (), step_s, start_s.get(view, 0.0))
        for view, mounted in enumerate(rig.cameras)
    ]
    lags = np.arange(-round(_SHARPENED_S / step_s) - 1, round(_SHARPENED_S / step_s) + 2)
    pairs = view_pairs(rig, busiest(views, SEARCHED_S))
    table = PairTable({pair: compared.curve(lags) for pair, compared in pairs.items()}, lags)
    best = table.best(tuple(steps), reference)
    for view in set(steps) - {reference}:
        start_s[view] += step_s * table.top(view, best)
    return start_s


def _reference(rig: Rig, table: PairTable, views: int) -> int:
    """The rig's reference where it sees people together with another camera, else the first camera that does."""
    preferred = rig.camera_ids.index(rig.reference)
    return next((v for v in (preferred, *range(views)) if len(table.linked(v)) > 1), preferred)


def _absence(view: PeopleView) -> str:
    """Why a view without common people has no offset."""
    if not view.instants:
        return "nobody was followed in this camera for a quarter of a second"
    return "too few common frames: no other camera sees people at the same time"
