"""The world from a plumb line: a hanging line gives the vertical, and one known height the floor.

The points along the line are named ``top``, ``bottom`` and, between them, as one likes; points on the floor are named
``floor``, ``floor2`` and so on. The world's origin is the floor below the reference camera, x is to the right of its
image and y ahead of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigcal.errors import WorldPointError
from rigcal.geometry import Floats
from rigcal.rig import Rig
from rigcal.world.frame import Residual, World, centre_of, check_above_floor, world_at
from rigcal.world.rays import SeenPoint, triangulate

_BENT_M = 0.02
"""Distance of a point from the line from which the line does not hang straight."""


def world_from_plumb_line(
    rig: Rig, pixels: Mapping[str, Mapping[str, Floats]], camera_height_m: tuple[str, float] | None, *, where: object
) -> World:
    """Find the vertical and the floor.

    Args:
        rig: The rig.
        pixels: By point and camera (2,) pixels.
        camera_height_m: A camera and its height above the floor, where no point lies on the floor.
        where: The table, for messages.

    Raises:
        WorldPointError: for a line without ``top`` or ``bottom``, a line that is bent, contradicting pixels, or a floor
            given twice or not at all.
        BelowFloorError: where a camera would lie below the floor.
    """
    floor_names = [name for name in pixels if name.startswith("floor")]
    _check_names(pixels, floor_names, camera_height_m, where)
    seen = {name: triangulate(rig, name, found, where=where) for name, found in pixels.items()}
    line = [point for name, point in seen.items() if name not in floor_names]
    up, off_m = _direction(line, where)
    ends = seen["top"].covariance + seen["bottom"].covariance
    length_m = float(np.linalg.norm(seen["top"].in_rig - seen["bottom"].in_rig))
    across = np.eye(3) - np.outer(up, up)
    tilt = float(np.sqrt(np.trace(across @ ends @ across))) / length_m
    reference = rig.camera(rig.reference).cam_from_rig
    centre = centre_of(reference)
    floor = [seen[name] for name in floor_names]
    height_m, height_sigma_m = _height(rig, up, centre, tilt, floor, camera_height_m)
    world = World(
        "plumb line",
        world_at(up, centre - height_m * up, _ahead(reference.rotation, up)),
        float(np.rad2deg(tilt)),
        height_sigma_m,
        tuple(Residual(point.name, off) for point, off in zip(line, off_m, strict=True)),
    )
    check_above_floor(world, rig, do_next="check which point is top and which bottom, and the height of the floor")
    return world


def _check_names(
    pixels: Mapping[str, object], floor: Sequence[str], camera_height_m: tuple[str, float] | None, where: object
) -> None:
    if missing := [name for name in ("top", "bottom") if name not in pixels]:
        raise WorldPointError(
            f"the plumb line has no point {' and no point '.join(missing)}",
            where=where,
            expected="points top and bottom, each with its pixel in two or more cameras",
            got=", ".join(pixels) or "no points",
            do_next="name the line's upper end top and its lower end bottom",
        )
    if bool(floor) == bool(camera_height_m):
        raise WorldPointError(
            "the floor is given twice" if floor else "nothing says where the floor is",
            where=where,
            expected="a point named floor in the table, or --height CAMERA:LENGTH; a line tells directions only",
            got=f"point {', '.join(floor)} and --height" if floor else "neither",
            do_next="leave one of the two out"
            if floor
            else "add the pixels of a point on the floor, named floor, or "
            "the height of one camera above it, as in --height cam0:2.41m",
        )


def _direction(line: Sequence[SeenPoint], where: object) -> tuple[Floats, list[float]]:
    """Unit vector (3,) up along the line, and each point's distance from it."""
    points = np.array([point.in_rig for point in line])
    middle = points.mean(axis=0)
    direction = np.linalg.svd(points - middle)[2][0]
    names = [point.name for point in line]
    upwards = points[names.index("top")] - points[names.index("bottom")]
    direction = direction * np.sign(direction @ upwards)
    off = [float(np.linalg.norm(np.cross(point - middle, direction))) for point in points]
    worst = int(np.argmax(off))
    if off[worst] > _BENT_M:
        raise WorldPointError(
            "the plumb line is not straight",
            where=where,
            expected=f"every point within {1e3 * _BENT_M:.0f} mm of one line",
            got=f"{names[worst]} is {1e3 * off[worst]:.0f} mm off",
            do_next=f"check the pixels of {names[worst]}; let the line hang still, free of anything",
        )
    return direction, off


def _ahead(cam_from_rig: Floats, up: Floats) -> Floats:
    """Where the world's x points: to the right of the reference's image, or for a camera on its side as y demands."""
    right, forward = cam_from_rig[0], cam_from_rig[2]
    level = abs(right @ up) < abs(forward @ up) or abs(right @ up) < 0.7
    return right if level else np.cross(forward, up)


def _height(
    rig: Rig,
    up: Floats,
    centre: Floats,
    tilt_rad: float,
    floor: Sequence[SeenPoint],
    camera_height_m: tuple[str, float] | None,
) -> tuple[float, float]:
    """Height of the reference above the floor and its one sigma, in metres."""
    if camera_height_m is not None:
        camera_id, height = camera_height_m
        away = centre - centre_of(rig.camera(camera_id).cam_from_rig)
        return height + float(away @ up), tilt_rad * float(np.linalg.norm(away))
    points = np.array([point.in_rig for point in floor])
    spread = np.mean([up @ point.covariance @ up for point in floor]) / len(floor)
    away = centre - points.mean(axis=0)
    level = away - (away @ up) * up
    return float(away @ up), float(np.sqrt(spread + (tilt_rad * np.linalg.norm(level)) ** 2))
