"""Whose pictures a camera's files hold: exchanged videos or cables show as rays that do not meet.

Each camera's points, seen through the lens and from the place of another, are compared with what the rest saw at the
same time. Files under their own names meet within what calibration and motion leave; exchanged ones miss by degrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from rigcal.geometry import Floats, Ints
from rigcal.rig import Rig
from rigcal.sync.content.tracks import PointTracks

MUCH_BETTER = 5.0
"""How many times nearer the rays must come by an exchange: 16 and more where two of 2-8 simulated cameras were
exchanged; 1.02 at the most where their clocks were up to 0.3 s off instead."""
MEET_DEG = 0.5
"""How near the rays must come by an exchange: with clocks 20 ms off and a board at 1 m/s, 0.01-0.11 degrees."""
FEWEST = 20
"""Points in common below which two cameras say nothing of each other."""


def swapped_cameras(rig: Rig, tracks: Sequence[PointTracks]) -> Mapping[str, str]:
    """Which cameras hold whose pictures; empty where every camera holds its own.

    Args:
        rig: The rig.
        tracks: Labelled points of its cameras, stamps in rig time.

    Returns:
        For each camera whose pictures are another's: that other camera.
    """
    holds = list(range(len(tracks)))
    common = {(a, b): _together(tracks[a], tracks[b]) for a, b in combinations(holds, 2)}
    first = cost = _cost(rig, tracks, common, holds)
    while True:
        trials = [_exchanged(holds, a, b) for a, b in combinations(range(len(holds)), 2)]
        costs = [_cost(rig, tracks, common, trial) for trial in trials]
        if not min(costs, default=cost) < cost:
            break
        holds, cost = trials[int(np.argmin(costs))], min(costs)
    if not cost <= min(MEET_DEG, first / MUCH_BETTER):
        return {}
    ids = [track.camera_id for track in tracks]
    return {ids[k]: ids[held] for k, held in enumerate(holds) if held != k}


def _exchanged(holds: Sequence[int], a: int, b: int) -> list[int]:
    trial = list(holds)
    trial[a], trial[b] = trial[b], trial[a]
    return trial


def _together(first: PointTracks, second: PointTracks) -> tuple[Ints, Ints]:
    """Frames of two cameras that are nearest in time, no further apart than half the second's period."""
    if not len(first.t_s) or len(second.t_s) < 2:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    near = np.clip(np.searchsorted(second.t_s, first.t_s), 1, len(second.t_s) - 1)
    near -= first.t_s - second.t_s[near - 1] < second.t_s[near] - first.t_s
    close = np.abs(second.t_s[near] - first.t_s) <= np.median(np.diff(second.t_s)) / 2
    return np.flatnonzero(close), near[close]


def _cost(
    rig: Rig, tracks: Sequence[PointTracks], common: Mapping[tuple[int, int], tuple[Ints, Ints]], holds: Sequence[int]
) -> float:
    """Mean over pairs of the median miss in degrees, if track k holds camera ``holds[k]``'s pictures."""
    misses = []
    for (a, b), (of_a, of_b) in common.items():
        both = np.isfinite(tracks[a].points_px[of_a]).all(-1) & np.isfinite(tracks[b].points_px[of_b]).all(-1)
        if both.sum() >= FEWEST:
            one, other = tracks[holds[a]].camera_id, tracks[holds[b]].camera_id
            misses.append(_miss_deg(rig, one, other, tracks[a].points_px[of_a][both], tracks[b].points_px[of_b][both]))
    return float(np.mean(misses)) if misses else np.nan


def _miss_deg(rig: Rig, first: str, second: str, first_px: Floats, second_px: Floats) -> float:
    """Median angle between the second's rays and the planes of the first's rays and the baseline."""
    one, two = rig.camera(first), rig.camera(second)
    rig_from_one, rig_from_two = one.cam_from_rig.inverse(), two.cam_from_rig.inverse()
    rays_one = one.camera.rays(first_px) @ rig_from_one.rotation.T
    rays_two = two.camera.rays(second_px) @ rig_from_two.rotation.T
    normals = np.cross(rig_from_two.translation_m - rig_from_one.translation_m, rays_one)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return float(np.rad2deg(np.median(np.arcsin(np.clip(np.abs((normals * rays_two).sum(-1)), 0, 1)))))
