"""Where cameras stand, their lenses and sensors.

``semicircle`` is the paper's rig: cameras on a semi-circle about the scene, 2 m high, 3 to 10 m away. It opens towards
the wall with the installation opening, so that the front camera, the first, looks at it. ``anywhere`` gives training
more to see.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.camera import Camera
from rigcal.geometry import Pose
from tools.sicsg.rooms import installation, prop_bounds
from tools.sicsg.rooms.walls import Wall
from tools.sicsg.scene import Room, SceneCamera

Floats = NDArray[np.float64]
Rng = np.random.Generator
Range = tuple[float, float]

ACTION_M = 2.8
"""Half the side of the square in which workers move: no camera below ``OVERHEAD_M`` stands there."""
OVERHEAD_M = 2.5
_MARGIN_M, _SIGHT_M, _TRIES = 0.3, 0.5, 400
_LOOK_M = np.array([0.0, 0.0, 1.1])
_CLOCK_OFFSET_S, _CLOCK_DRIFT_PPM = 0.25, 40.0


@dataclass(frozen=True, slots=True)
class Sensors:
    """From what the sensors' settings are drawn, each camera by itself."""

    exposure_s: Range = (1 / 250, 1 / 40)
    gain: Range = (0.6, 3.0)
    ev: Range = (-0.4, 0.4)
    quality: tuple[int, int] = (55, 95)
    """Of the JPEG."""


STEADY = Sensors((0.008, 0.008), (1.0, 1.0), (0.0, 0.0), (90, 90))
"""Sensors that are all alike."""


def semicircle(
    rng: Rng,
    size_wh: tuple[int, int],
    room: Room,
    *,
    count: int = 4,
    fps: float = 10.0,
    clocks: bool = False,
    sensors: Sensors = Sensors(),
) -> tuple[SceneCamera, ...]:
    """Cameras on a semi-circle about the middle of the room, the front one first; all look at it.

    Args:
        rng: what they are drawn from.
        size_wh: of the images in pixels.
        room: they stand inside it, beside its props, with a free sight 1 m wide.
        count: how many.
        fps: images a second.
        clocks: whether their clocks go wrong, but for the first.
        sensors: how their settings vary.

    Raises:
        ValueError: where props leave no free place.
    """
    outward = Wall.of(room, installation(room).wall).outward
    front = math.atan2(-outward[1], -outward[0]) + rng.uniform(-0.35, 0.35)
    angles = np.linspace(-1.3, 1.3, count) if count > 1 else np.zeros(1)
    radius = rng.uniform(3.5, 10.0)
    found = []
    for angle in angles[np.argsort(np.abs(angles), kind="stable")]:
        for attempt in range(_TRIES):
            at = front + angle + rng.normal(0, 0.06 + 0.3 * attempt / _TRIES)
            position = _on_circle(room, at, radius * rng.uniform(0.9, 1.1), rng.uniform(1.9, 2.15), rng)
            if _is_free(room, position):
                break
        else:
            raise ValueError(_full(room, f"{math.degrees(front + angle):.0f} degrees"))
        look, roll = _LOOK_M + rng.normal(0, 0.08, 3), rng.normal(0, 0.01)
        found.append((_looking_at(position, look, roll), _lens(rng, size_wh, (60.0, 85.0))))
    return _cameras(rng, found, fps, clocks, sensors)


def anywhere(
    rng: Rng,
    size_wh: tuple[int, int],
    room: Room,
    *,
    count: int = 4,
    fps: float = 10.0,
    clocks: bool = False,
    sensors: Sensors = Sensors(),
) -> tuple[SceneCamera, ...]:
    """Cameras 0.8 to 3.5 m high, 2 to 11 m away, that look about the middle of the room; arguments as above."""
    half = np.array(room.size_m[:2]) / 2 - _MARGIN_M
    found = []
    for number in range(count):
        for _ in range(_TRIES):
            height = min(rng.uniform(0.8, 3.5), room.size_m[2] - 0.35)
            position = np.array([*rng.uniform(-half, half), height])
            if 2.0 <= np.linalg.norm(position - _LOOK_M) <= 11.0 and _is_free(room, position):
                break
        else:
            raise ValueError(_full(room, f"camera {number}"))
        look = _LOOK_M + rng.normal(0, (0.7, 0.7, 0.3))
        found.append((_looking_at(position, look, rng.normal(0, 0.04)), _lens(rng, size_wh, (45.0, 95.0))))
    return _cameras(rng, found, fps, clocks, sensors)


def _full(room: Room, where: str) -> str:
    return (
        f"room {room.name}: no free place for a camera at {where} in {_TRIES} tries among {len(room.props)} props; "
        "take another room or fewer cameras"
    )


def _on_circle(room: Room, angle: float, radius: float, height: float, rng: Rng) -> Floats:
    """(3,) at this distance (metres) in this direction, as far as the room allows and outside the action."""
    direction = np.array([math.cos(angle), math.sin(angle)])
    half = np.array(room.size_m[:2]) / 2 - _MARGIN_M
    furthest = float((half / np.maximum(np.abs(direction), 1e-9)).min())
    nearest = max(3.0, ACTION_M / float(np.abs(direction).max()))
    away = float(np.clip(radius, nearest, furthest * rng.uniform(0.96, 1.0)))
    return np.array([*(away * direction), height])


def _is_free(room: Room, position: Floats) -> bool:
    """Whether a camera there is in nobody's way and in no prop, and sees past all props by 0.5 m."""
    if np.abs(position[:2]).max() < ACTION_M and position[2] < OVERHEAD_M:
        return False
    bounds = prop_bounds(room)
    low, high = bounds[:, 0], bounds[:, 1]
    if ((low - 0.25 < position) & (position < high + 0.25)).all(axis=1).any():
        return False
    ways = np.linspace(position, _LOOK_M, 16)[:-4, None, :]
    over = np.array([_SIGHT_M, _SIGHT_M, 0.1])
    return not ((low - over < ways) & (ways < high + over)).all(axis=2).any()


def _looking_at(position: Floats, target: Floats, roll_rad: float) -> Pose:
    """``cam_from_world`` of a camera that looks at a target; ``roll_rad`` turns it about its axis."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward])
    rotation = Pose.from_rvec((0.0, 0.0, roll_rad), np.zeros(3)).rotation @ level
    return Pose(rotation, -rotation @ position)


def _lens(rng: Rng, size_wh: tuple[int, int], hfov_deg: Range) -> Camera:
    """A lens of the model opencv5 that bends inwards and can be inverted everywhere in the image."""
    while True:
        half = math.radians(rng.uniform(*hfov_deg)) / 2
        k1 = rng.uniform(-0.25, -0.05)
        k2, k3 = k1**2 * rng.uniform(0.5, 1.6), rng.normal(0, 0.004)
        p1, p2 = rng.normal(0, 0.0004, 2)
        focal = size_wh[0] / 2 / (math.tan(half) * _radial(math.tan(half), k1, k2, k3))
        centre = (np.array(size_wh) - 1) / 2 + rng.normal(0, 0.006, 2) * size_wh[0]
        params = [focal, focal * rng.normal(1, 0.0015), *centre, k1, k2, p1, p2, k3]
        camera = Camera("opencv5", size_wh, np.array(params))
        if is_invertible(camera):
            return camera


def _radial(r: float, k1: float, k2: float, k3: float) -> float:
    return 1 + k1 * r**2 + k2 * r**4 + k3 * r**6


def is_invertible(camera: Camera) -> bool:
    """Whether every pixel of an opencv5 camera has one ray: the lens's radius grows to 1.1 of the furthest corner's,
    and the model inverted and applied again comes back to the pixel within 0.01 px.
    """
    width, height = camera.size_wh
    focal, centre = camera.params[:2], camera.params[2:4]
    corners = np.array([(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)], dtype=np.float64)
    needed = 1.1 * float(np.linalg.norm((corners - centre) / focal, axis=1).max())
    k1, k2, k3 = camera.params[[4, 5, 8]]
    r = np.linspace(0, 4, 4001)
    bent = r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)
    falling = np.flatnonzero(np.diff(bent) <= 0)
    if bent[falling[0] if len(falling) else -1] < needed:
        return False
    grid = np.stack(np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 7)), axis=-1).reshape(-1, 2)
    back = camera.project(camera.rays(grid))
    return bool(np.abs(back - grid).max() < 0.01)


def _cameras(
    rng: Rng, found: list[tuple[Pose, Camera]], fps: float, clocks: bool, sensors: Sensors
) -> tuple[SceneCamera, ...]:
    """The cameras with their sensors and clocks; the first one's clock is right."""
    made = []
    for number, (pose, lens) in enumerate(found):
        wrong = clocks and number > 0
        low, high = np.log(sensors.exposure_s)
        made.append(
            SceneCamera(
                id=f"cam{number}",
                size_wh=lens.size_wh,
                model=lens.model,
                coefficients=lens.coefficients,
                quat_wxyz=tuple(pose.quat_wxyz.tolist()),
                translation_m=tuple(pose.translation_m.tolist()),
                fps=fps,
                exposure_s=float(np.exp(rng.uniform(low, high))),
                gain=float(rng.uniform(*sensors.gain)),
                ev=float(rng.uniform(*sensors.ev)),
                quality=int(rng.integers(sensors.quality[0], sensors.quality[1] + 1)),
                clock_offset_s=float(rng.uniform(-_CLOCK_OFFSET_S, _CLOCK_OFFSET_S)) if wrong else 0.0,
                clock_drift_ppm=float(rng.uniform(-_CLOCK_DRIFT_PPM, _CLOCK_DRIFT_PPM)) if wrong else 0.0,
            )
        )
    return tuple(made)
