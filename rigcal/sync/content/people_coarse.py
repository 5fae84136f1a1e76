"""The coarse search: one offset per camera, to a step of the raster, and whether it is clear."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rigcal.rig import Rig
from rigcal.sync.content.people_pairs import ViewPair
from rigcal.sync.content.people_search import PairTable, Profile
from rigcal.sync.content.people_verdict import search_problem
from rigcal.sync.content.people_views import PeopleView, busiest

STEP_S = 0.05
"""Raster of the search. On the shared captures all searches find the right step; 0.033 s does no better."""
SEARCHED_S = 20.0
"""The busiest stretch of a recording, which the search looks at."""
_LEAST_BASELINE_M = 1e-3


@dataclass(frozen=True, slots=True)
class Coarse:
    """What the search found of V views."""

    reference: int
    steps: Mapping[int, int]
    """Offset of each view that has people in common with others, in steps; the reference's is 0."""
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


def search(rig: Rig, views: Sequence[PeopleView], search_s: float) -> Coarse:
    """Compare every two views at every lag, and find what explains all of them.

    Args:
        rig: the rig.
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
    return Coarse(reference, steps, profiles, problems)


def _reference(rig: Rig, table: PairTable, views: int) -> int:
    """The rig's reference where it sees people together with another camera, else the first camera that does."""
    preferred = rig.camera_ids.index(rig.reference)
    return next((v for v in (preferred, *range(views)) if len(table.linked(v)) > 1), preferred)


def _absence(view: PeopleView) -> str:
    """Why a view without common people has no offset."""
    if not view.instants:
        return "nobody was followed in this camera for a quarter of a second"
    return "too few common frames: no other camera sees people at the same time"
