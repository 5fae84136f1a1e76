"""What the lenses of a rig see of a world, exactly and whatever hides it, at all instants."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rigcal.geometry import Bools, Floats, Ints
from rigcal.rig import Rig
from tools.sicsg.catalog import canonical_order, category
from tools.study.world import World

_FOLDED = 1e-6
"""Lens polynomials fold what is far outside the image back into it; the inverse then finds another ray than this."""
_KEPT = 48
"""Worlds whose pictures are kept, since most errors leave them as they are."""


@dataclass(frozen=True, slots=True, eq=False)
class Exact:
    """F instants and V cameras; pixels are NaN where the lens does not see the point."""

    frame: Ints
    """(F, V) the instant whose truth says what is hidden."""
    size_wh: Ints
    """(V, 2)"""
    joints_px: Floats
    """(F, V, W, 17, 2)"""
    whole_xyxy: Floats
    """(F, V, T, 4) boxes of the objects as if nothing hid them."""
    middles_px: Floats
    """(F, V, T, 2) middles of the objects."""
    shown_xyxy: Floats
    """(F, V, T, 4) boxes of what shows; NaN where nothing does."""
    keypoints_px: Floats
    """(F, V, T, 4, 2)"""
    learned_px: Floats
    """(F, V, T, 4, 2) the same in the order in which networks learn them; NaN where one is not before the lens."""

    def inside(self, px: Floats) -> Bools:
        """(F, V, ...) whether pixels (F, V, ..., 2) are in the image."""
        size = self.size_wh.reshape(1, -1, *(1,) * (px.ndim - 3), 2)
        return np.asarray(((px > -0.5) & (px < size - 0.5)).all(axis=-1))


@lru_cache(maxsize=_KEPT)
def exact_views(world: World, late_s: tuple[float, ...]) -> Exact:
    """What the cameras see.

    Args:
        world: The sequence.
        late_s: (V,) how much later than its stamp each camera's picture was taken.
    """
    t_s = world.truth.t_s[:, None] + np.array(late_s)
    frame = world.frame_at(t_s)
    joints_m, corners_m, keypoints_m = world.at(t_s)
    _, then_m, _ = world.at(world.truth.t_s[frame])
    corners, middles, then, keypoints, joints = (
        _pixels(world.rig, points)
        for points in (corners_m, corners_m.mean(axis=-2), then_m.mean(axis=-2), keypoints_m, joints_m)
    )
    shown = world.object_xyxy[frame, np.arange(len(late_s))] + np.tile(middles - then, 2)
    sizes = np.array([entry.camera.size_wh for entry in world.rig.cameras])
    whole = np.concatenate([np.fmin.reduce(corners, axis=-2), np.fmax.reduce(corners, axis=-2)], axis=-1)
    return Exact(frame, sizes, joints, whole, middles, shown, keypoints, _learned(world, keypoints))


def _pixels(rig: Rig, points_m: Floats) -> Floats:
    """(F, V, ..., 2) of points (F, V, ..., 3) in the world."""
    if rig.world_from_rig is None:
        raise ValueError(f"{rig.site}: the rig has no world frame; render it again")
    points, result = rig.world_from_rig.inverse().apply(points_m), np.zeros((*points_m.shape[:-1], 2))
    for view, entry in enumerate(rig.cameras):
        in_cam = entry.cam_from_rig.apply(points[:, view])
        px = np.asarray(entry.camera.project(in_cam))
        with np.errstate(invalid="ignore", divide="ignore"):
            direct = in_cam[..., :2] / in_cam[..., 2:]
            unfolded = (np.abs(entry.camera.undistort(px) - direct) < _FOLDED).all(axis=-1) & (in_cam[..., 2] > 0)
        result[:, view] = np.where(unfolded[..., None], px, np.nan)
    return result


def _learned(world: World, keypoints_px: Floats) -> Floats:
    result = np.full(keypoints_px.shape, np.nan)
    for thing, name in enumerate(world.classes):
        count = len(category(name).keypoints)
        if not count:
            continue
        known = np.isfinite(keypoints_px[:, :, thing, :count]).all(axis=(-1, -2))
        for frame, view in np.argwhere(known).tolist():
            points = keypoints_px[frame, view, thing, :count]
            result[frame, view, thing, :count] = points[list(canonical_order(name, points))]
    return result
