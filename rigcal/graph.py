"""From pairs to a chain: each camera's best path to the reference.

Cameras are nodes, solved pairs are edges, weighted by the variance that a pair adds to the place of a point at the
boards' distance (:attr:`rigcal.pairwise.PairPose.point_variance_m2`). The tree of shortest paths from the reference
(Dijkstra) is the best spanning tree for poses relative to it: no other path to a camera adds less variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from rigcal.errors import NotConnectedError
from rigcal.geometry import Pose
from rigcal.pairwise import PairPose


@dataclass(frozen=True, slots=True)
class Chain:
    """The tree of pairs that joins every camera to the reference."""

    cam_from_rig: tuple[Pose, ...]
    """Pose of each camera, composed along its path."""
    paths: tuple[tuple[int, ...], ...]
    """Per camera the indices from the reference to itself."""
    links: tuple[PairPose | None, ...]
    """Per camera the last pair of its path, ``second`` being the camera; None for the reference."""


def chain_to_reference(camera_ids: Sequence[str], pairs: Sequence[PairPose], *, needed_views: int) -> Chain:
    """Join every camera to the first one.

    Raises:
        NotConnectedError: naming the groups that no pair joins and the capture that would.
    """
    count = len(camera_ids)
    _require_connected(camera_ids, pairs, needed_views)
    edges = {(p.first, p.second): p for pair in pairs for p in (pair, pair.inverse())}
    weights = csr_array(_weights(edges, count))
    _, before = dijkstra(weights, directed=True, indices=[0], return_predecessors=True)
    paths = tuple(_path_to(camera, before[0].tolist()) for camera in range(count))
    poses = []
    for path in paths:
        pose = Pose.identity()
        for link in pairwise(path):
            pose = edges[link].second_from_first @ pose
        poses.append(pose)
    links = tuple(edges[path[-2], path[-1]] if len(path) > 1 else None for path in paths)
    return Chain(tuple(poses), paths, links)


def _path_to(camera: int, before: list[int]) -> tuple[int, ...]:
    path = [camera]
    while path[-1] != 0:
        path.append(before[path[-1]])
    return tuple(reversed(path))


def _weights(edges: dict[tuple[int, int], PairPose], count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    weights = np.zeros((count, count))
    for (first, second), pair in edges.items():
        weights[first, second] = max(pair.point_variance_m2, 1e-30)  # 0 would mean no edge
    return weights


def _require_connected(camera_ids: Sequence[str], pairs: Sequence[PairPose], needed_views: int) -> None:
    count = len(camera_ids)
    adjacency = np.zeros((count, count))
    for pair in pairs:
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
    )
