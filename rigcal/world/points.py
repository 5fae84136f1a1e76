"""The world from named points whose places were measured: triangulated, then aligned rigidly.

The alignment is that of Umeyama (Least-squares estimation of transformation parameters between two point patterns,
PAMI 1991): equations 39 and 41 without scale. The scale of equation 42 is not applied but told: it is a check of the
board's size that no image can make.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigcal.errors import WorldPointError
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig
from rigcal.world.frame import Residual, World, check_above_floor
from rigcal.world.rays import triangulate

MIN_POINTS = 3
_LINE = 0.03
"""Spread of the points across their longest direction, as a share of it, below which they lie on a line."""
_SURE_M = 0.01
"""Residual that careful measuring with a tape leaves; below it nothing is refused."""
_WORSE = 5.0
"""A point's distance from where the others put it, over their own residual, from which it is refused."""
_MOST_M = 0.05
"""Residual of all points together from which no world is made of them."""


def world_from_points(
    rig: Rig, points_m: Mapping[str, Floats], pixels: Mapping[str, Mapping[str, Floats]], *, where: object
) -> World:
    """Align the rig with measured points.

    Args:
        rig: The rig.
        points_m: Place (3,) of each point in the world, z up, the floor at 0.
        pixels: By point and camera (2,) pixels.
        where: The table of pixels, for messages.

    Raises:
        WorldPointError: for a point without a place or with contradicting pixels, fewer than three points or points on
            one line, a point that contradicts the others, or a table of another handedness.
        BelowFloorError: where a camera would lie below the floor.
    """
    if missing := [name for name in pixels if name not in points_m]:
        raise WorldPointError(
            f"point {', '.join(missing)} has pixels but no place in the world",
            where=where,
            expected=f"one of {', '.join(points_m)}",
            got=", ".join(missing),
            do_next="add its line to --points, or mend its name in --pixels",
        )
    names = [name for name in points_m if name in pixels]
    in_world = np.array([points_m[name] for name in names]).reshape(-1, 3)
    _check_spread(names, in_world, where)
    seen = [triangulate(rig, name, pixels[name], where=where) for name in names]
    in_rig = np.array([point.in_rig for point in seen])
    world_from_rig = align(in_rig, in_world)
    off_m = np.linalg.norm(world_from_rig.apply(in_rig) - in_world, axis=1)
    scale = _scale(in_rig, in_world, world_from_rig)
    _check_agreement(names, in_rig, in_world, scale, where)
    tilt, height, scale_sigma = _sigmas(in_world, off_m)
    world = World(
        "points",
        world_from_rig,
        tilt,
        height,
        tuple(Residual(name, float(off)) for name, off in zip(names, off_m, strict=True)),
        100 * (scale - 1),
        100 * scale_sigma,
    )
    check_above_floor(
        world, rig, do_next="check the points' places: z_m upwards from the floor, x_m and y_m as seen from above"
    )
    return world


def align(source: Floats, target: Floats) -> Pose:
    """The rigid ``target_from_source`` with the least squared distance between points (n, 3)."""
    centre_s, centre_t = source.mean(axis=0), target.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - centre_t).T @ (source - centre_s))
    S = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    rotation = U @ S @ Vt
    return Pose(rotation, centre_t - rotation @ centre_s)


def _scale(source: Floats, target: Floats, target_from_source: Pose) -> float:
    """Lengths among the target points over those among the source points (Umeyama, equation 42)."""
    s, t = source - source.mean(axis=0), target - target.mean(axis=0)
    return float((t * (s @ target_from_source.rotation.T)).sum() / (s**2).sum())


def _check_spread(names: list[str], in_world: Floats, where: object) -> None:
    spread = np.linalg.svd(in_world - in_world.mean(axis=0), compute_uv=False) if len(names) >= MIN_POINTS else None
    if spread is None or spread[1] <= _LINE * spread[0]:
        raise WorldPointError(
            "these points do not determine a world",
            where=where,
            expected=f"{MIN_POINTS} or more points that do not lie on a line, each with pixels in two cameras",
            got=f"{len(names)} points ({', '.join(names)})" + ("" if spread is None else " on one line"),
            do_next="measure another point, a few metres to the side of the others",
        )


def _check_agreement(names: list[str], in_rig: Floats, in_world: Floats, scale: float, where: object) -> None:
    """Refuse a point that contradicts the others, and points that do not fit the rig at all."""
    mirrored = in_world * [1, -1, 1]
    rms = _rms(in_rig, in_world)
    if rms > _WORSE * max(_rms(in_rig, mirrored), _SURE_M):
        raise WorldPointError(
            "the points are mirrored",
            where=where,
            expected="x_m, y_m, z_m right-handed: seen from above, y is to the left of x",
            got=f"{1e3 * rms:.0f} mm off as given, {1e3 * _rms(in_rig, mirrored):.0f} mm with y_m negated",
            do_next="change the sign of y_m in --points",
        )
    alone, rest = _off_the_others(in_rig, in_world)
    worst = int(np.argmax(alone / np.maximum(rest, _SURE_M)))
    if len(names) > MIN_POINTS and alone[worst] > _WORSE * max(rest[worst], _SURE_M):
        raise WorldPointError(
            f"point {names[worst]} contradicts the others",
            where=where,
            expected=f"within {1e3 * _WORSE * max(rest[worst], _SURE_M):.0f} mm of where the other points put it",
            got=f"{1e3 * alone[worst]:.0f} mm off; the others agree within {1e3 * rest[worst]:.0f} mm",
            do_next=f"check the place and the pixels of {names[worst]}, or remove it",
        )
    if rms > _MOST_M:
        off = np.linalg.norm(align(in_rig, in_world).apply(in_rig) - in_world, axis=1)
        raise WorldPointError(
            "the points do not fit the rig",
            where=where,
            expected=f"{1e3 * _MOST_M:.0f} mm or less (root mean square)",
            got=f"{1e3 * rms:.0f} mm, point {names[int(off.argmax())]} the worst with {1e3 * off.max():.0f} mm; "
            f"measured lengths are {100 * (scale - 1):+.1f} % longer than the rig's",
            do_next="where lengths differ, calibrate again with the board's measured size; else check the points",
        )


def _rms(in_rig: Floats, in_world: Floats) -> float:
    return float(np.sqrt(((align(in_rig, in_world).apply(in_rig) - in_world) ** 2).sum(axis=1).mean()))


def _off_the_others(in_rig: Floats, in_world: Floats) -> tuple[Floats, Floats]:
    """(n,) distance of each point from where the others put it, and (n,) their root mean square among themselves."""
    alone, rest = [], []
    for k in range(len(in_rig)):
        others = np.arange(len(in_rig)) != k
        alone.append(float(np.linalg.norm(align(in_rig[others], in_world[others]).apply(in_rig[k]) - in_world[k])))
        rest.append(_rms(in_rig[others], in_world[others]))
    return np.array(alone), np.array(rest)


def _sigmas(in_world: Floats, off_m: Floats) -> tuple[float, float, float]:
    """One sigma of the tilt (degrees), of the floor's height at the origin (m) and of the scale, from the residuals."""
    x = in_world - in_world.mean(axis=0)
    variance = float((off_m**2).sum()) / (3 * len(x) - 6)
    turning = np.linalg.inv((x**2).sum() * np.eye(3) - x.T @ x)  # inverse of the sum of [x]^T [x]
    at_origin = np.cross(-in_world.mean(axis=0), [0.0, 0.0, 1.0])  # height there by a turn about the points' middle
    height = variance / len(x) + variance * float(at_origin @ turning @ at_origin)
    tilt = variance * (turning[0, 0] + turning[1, 1])
    return float(np.rad2deg(np.sqrt(tilt))), float(np.sqrt(height)), float(np.sqrt(variance / (x**2).sum()))
