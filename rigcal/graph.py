"""From pairs to a chain: each camera's best path to the reference, and what the loops of the graph say.

Cameras are nodes, solved pairs are edges, weighted by the variance that a pair adds to the place of a point at the
boards' distance (:attr:`rigcal.pairwise.PairPose.point_variance_m2`). The tree of shortest paths from the reference
(Dijkstra) is the best spanning tree for poses relative to it: no other path to a camera adds less variance.

A pair outside the tree closes a loop: carried around it, a point should come back to where it was. A pair whose loops
stay far open is wrong and must not carry the chain; where one loop is all there is, its least certain pair is taken for
the culprit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from rigcal.errors import NotConnectedError
from rigcal.geometry import Pose
from rigcal.pairwise import PairPose, Pairs

OPEN_SHARE = 0.05
"""Gap of a loop over the boards' distance at which one of its pairs is wrong: lenses calibrated from a few small boards
leave loops of four webcams open by 0.008 at most."""

_Edges = Mapping[tuple[int, int], PairPose]


@dataclass(frozen=True, slots=True)
class Loop:
    """A pair outside the tree, held against the way through the tree."""

    first: int
    """Index of one camera."""
    second: int
    """Index of the other camera."""
    path: tuple[int, ...]
    """Cameras from ``first`` to ``second`` through the tree."""
    gap_m: float
    """How far apart the two ways put a point at the boards' distance, in metres."""
    gap_share: float
    """The gap over the boards' distance."""


@dataclass(frozen=True, slots=True)
class Chain:
    """The tree of pairs that joins every camera to the reference."""

    cam_from_rig: tuple[Pose, ...]
    """Pose of each camera, composed along its path."""
    paths: tuple[tuple[int, ...], ...]
    """Per camera the indices from the reference to itself."""
    links: tuple[PairPose | None, ...]
    """Per camera the last pair of its path, ``second`` being the camera; None for the reference."""
    loops: tuple[Loop, ...]
    """What closes: every other pair that was believed."""
    doubted: tuple[PairPose, ...]
    """Pairs that contradict the others, and so carry nothing."""

    @property
    def weakest(self) -> PairPose | None:
        """The pair of the tree that adds most to the place of a point; None for a rig of one camera."""
        links = [link for link in self.links if link is not None]
        return max(links, key=lambda link: link.point_variance_m2, default=None)


def chain_to_reference(camera_ids: Sequence[str], pairs: Pairs, *, needed_views: int) -> Chain:
    """Join every camera to the first one.

    Raises:
        NotConnectedError: naming the groups that no pair joins and the capture that would.
    """
    _require_connected(camera_ids, pairs, needed_views)
    count, believed, doubted = len(camera_ids), list(pairs.solved), list[PairPose]()
    while True:
        chain = _tree(count, believed, doubted)
        worst = max(chain.loops, key=lambda loop: loop.gap_share, default=None)
        if worst is None or worst.gap_share <= OPEN_SHARE:
            return chain
        culprit = _culprit(count, believed, worst)
        believed.remove(culprit)
        doubted.append(culprit)


def _tree(count: int, pairs: Sequence[PairPose], doubted: Sequence[PairPose]) -> Chain:
    edges = {(p.first, p.second): p for pair in pairs for p in (pair, pair.inverse())}
    weights = np.zeros((count, count))
    for (first, second), pair in edges.items():
        weights[first, second] = max(pair.point_variance_m2, 1e-30)  # 0 would mean no edge
    _, before = dijkstra(csr_array(weights), directed=True, indices=[0], return_predecessors=True)
    paths = tuple(_path_to(camera, before[0].tolist()) for camera in range(count))
    poses = tuple(_carried(edges, path) for path in paths)
    links = tuple(edges[path[-2], path[-1]] if len(path) > 1 else None for path in paths)
    in_tree = {frozenset(path[-2:]) for path in paths if len(path) > 1}
    loops = tuple(_loop(edges, paths, pair) for pair in pairs if frozenset((pair.first, pair.second)) not in in_tree)
    return Chain(poses, paths, links, loops, tuple(doubted))


def _path_to(camera: int, before: list[int]) -> tuple[int, ...]:
    path = [camera]
    while path[-1] != 0:
        path.append(before[path[-1]])
    return tuple(reversed(path))


def _carried(edges: _Edges, path: Sequence[int]) -> Pose:
    """Pose of the last camera of a path relative to the first."""
    pose = Pose.identity()
    for link in pairwise(path):
        pose = edges[link].second_from_first @ pose
    return pose


def _loop(edges: _Edges, paths: Sequence[tuple[int, ...]], pair: PairPose) -> Loop:
    """The pair held against the way between its cameras through the tree."""
    up, down = paths[pair.first], paths[pair.second]
    shared = sum(1 for a, b in zip(up, down, strict=False) if a == b)
    path = (*reversed(up[shared - 1 :]), *down[shared:])
    apart = pair.second_from_first @ _carried(edges, path).inverse()
    # a point straight ahead at the boards' distance, in the second camera
    point = np.array([0.0, 0.0, pair.board_distance_m])
    gap_m = float(np.linalg.norm(apart.apply(point) - point))
    return Loop(pair.first, pair.second, path, gap_m, gap_m / pair.board_distance_m)


def _culprit(count: int, pairs: Sequence[PairPose], loop: Loop) -> PairPose:
    """Of the pairs of a loop, the one without which the others close best; if all are as good, the least certain."""
    around = {frozenset(link) for link in (*pairwise(loop.path), (loop.first, loop.second))}
    members = [pair for pair in pairs if frozenset((pair.first, pair.second)) in around]

    def left_open(pair: PairPose) -> tuple[float, float]:
        chain = _tree(count, [other for other in pairs if other is not pair], ())
        worst = max((other.gap_share for other in chain.loops), default=0.0)
        return max(worst, OPEN_SHARE), -pair.point_variance_m2

    return min(members, key=left_open)


def _require_connected(camera_ids: Sequence[str], pairs: Pairs, needed_views: int) -> None:
    count = len(camera_ids)
    adjacency = np.zeros((count, count))
    for pair in pairs.solved:
        adjacency[pair.first, pair.second] = 1
    groups, label = connected_components(csr_array(adjacency), directed=False)
    if groups == 1:
        return
    members = [np.flatnonzero(label == group).tolist() for group in dict.fromkeys(label.tolist())]
    near, far = min(
        ((a, b) for a in members[0] for group in members[1:] for b in group),
        key=lambda ab: (abs(ab[0] - ab[1]), ab),
    )
    raise NotConnectedError(
        [[camera_ids[i] for i in group] for group in members],
        needed=needed_views,
        bridge=(camera_ids[near], camera_ids[far]),
        unexplained={(camera_ids[a], camera_ids[b]): views for (a, b), views in pairs.unexplained.items()},
    )
