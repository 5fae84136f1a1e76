"""Which cameras stayed where they were: the largest set that still agrees, and whether another is as good.

Nothing outside the rig says which camera moved; only poses between cameras can be compared. So the cameras that stayed
are taken to be the most that agree with each other pair by pair (the largest clique of the graph of agreement), and all
others moved. Of several largest sets the one with the least misfit is best; those that fit nearly as well cannot be
told from it, and with two cameras never can.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

AS_GOOD = 20.0
"""Squared distances that differ by less leave a choice open: a likelihood ratio of e^10."""


@dataclass(frozen=True, slots=True)
class Stayed:
    """The cameras that stayed."""

    best: tuple[str, ...]
    """In rig order."""
    as_good: tuple[tuple[str, ...], ...]
    """Other sets as large that fit as well."""


def find_stayed(
    ids: Sequence[str], agree: Callable[[str, str], bool], misfit: Callable[[Sequence[str]], float]
) -> Stayed:
    """Find the cameras that stayed.

    Args:
        ids: Two or more cameras in rig order.
        agree: Whether the pose between two cameras is what it was.
        misfit: Squared Mahalanobis distance of a set that is taken to have stayed.
    """
    friends: dict[str, set[str]] = {camera_id: set() for camera_id in ids}
    for one, two in combinations(ids, 2):
        if agree(one, two):
            friends[one].add(two)
            friends[two].add(one)
    cliques = [tuple(sorted(clique, key=ids.index)) for clique in _maximal_cliques(friends)]
    largest = [clique for clique in cliques if len(clique) == max(map(len, cliques))]
    fits = sorted((misfit(clique), [ids.index(c) for c in clique], clique) for clique in largest)
    least, _, best = fits[0]
    return Stayed(best, tuple(clique for fit, _, clique in fits[1:] if fit <= least + AS_GOOD))


def _maximal_cliques(friends: Mapping[str, set[str]]) -> Iterator[set[str]]:
    """Bron and Kerbosch, Finding all cliques of an undirected graph, 1973, with a pivot."""

    def extend(clique: set[str], candidates: set[str], done: set[str]) -> Iterator[set[str]]:
        if not candidates and not done:
            yield clique
            return
        pivot = max(sorted(candidates | done), key=lambda node: len(friends[node] & candidates))
        for node in sorted(candidates - friends[pivot]):
            yield from extend(clique | {node}, candidates & friends[node], done & friends[node])
            candidates = candidates - {node}
            done = done | {node}

    yield from extend(set(), set(friends), set())
