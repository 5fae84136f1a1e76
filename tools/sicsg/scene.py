"""The scene file: everything that makes a scene, by name and number; readable, comparable, renderable again.

World: z up, metres, floor at z = 0, origin at the middle of the floor. Times are seconds of true time from the scene's
start. Rotations are quaternions w x y z. A file is JSON of :class:`Scene`; unknown entries are refused.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field
from scipy.spatial.transform import Rotation, Slerp

from tools.sicsg.assets import Split

Floats = NDArray[np.float64]
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
LightKind = Literal["indoor", "backlight", "overexposed", "dusk"]
ViolationKind = Literal["no_hat", "ladder", "window", "platform"]
Verb = Literal["stand", "walk", "crouch", "climb", "hold", "carry", "mount", "work"]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Lamp(_Strict):
    """A rectangular lamp that shines downwards."""

    position_m: Vector3
    size_m: tuple[float, float]
    power: float
    """Strength relative to a lamp that gives a white wall at 2 m the radiance 1."""
    colour: Vector3
    """Linear RGB, the brightest channel 1."""


class Light(_Strict):
    """A light rig."""

    name: str
    kind: LightKind
    lamps: tuple[Lamp, ...]
    sun_direction: Vector3
    """Unit vector from the scene towards the sun."""
    sun: float
    """Radiance of a white surface that faces the sun; 0: no sun."""
    sky: float
    """Radiance of the sky through windows."""
    ambient: Vector3
    """Radiance from everywhere, for the fast path, which follows no second bounce."""
    exposure_ev: float
    """What the rig asks of the cameras beyond a well exposed picture; 2: over-exposed by two stops."""


class Opening(_Strict):
    """A window or a door in a wall."""

    wall: Literal["-x", "+x", "-y", "+y"]
    centre_m: tuple[float, float]
    """Along the wall (y or x of the world) and above the floor."""
    size_m: tuple[float, float]
    glazed: bool


class Prop(_Strict):
    """Something that belongs to no category: a pillar, stacked boards, a pipe, a cable drum."""

    kind: str
    variant: str
    position_m: Vector3
    yaw_rad: float


class Room(_Strict):
    """A room around the origin; x from -size/2 to +size/2, y likewise."""

    name: str
    size_m: Vector3
    wall_texture: str
    floor_texture: str
    ceiling_texture: str
    wall_colour: Vector3
    floor_colour: Vector3
    openings: tuple[Opening, ...]
    props: tuple[Prop, ...]


class Keyframe(_Strict):
    """Where a thing is at a time."""

    t_s: float
    position_m: Vector3
    quat_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Attachment(_Strict):
    """While it lasts, the thing follows a worker: a hat on the head, or anything in a hand."""

    start_s: float
    end_s: float
    worker: str
    bone: Literal["head", "left_hand", "right_hand"]


class Thing(_Strict):
    """An object of the catalogue."""

    id: str
    category: str
    variant: str
    path: Annotated[tuple[Keyframe, ...], Field(min_length=1)]
    """Poses, interpolated between and held before the first and after the last."""
    attached: tuple[Attachment, ...] = ()

    def pose(self, t_s: float) -> Floats:
        """(4, 4) ``world_from_mesh`` along the path."""
        times = np.array([key.t_s for key in self.path])
        t = float(np.clip(t_s, times[0], times[-1]))
        matrix = np.eye(4)
        quats = np.array([key.quat_wxyz for key in self.path])[:, [1, 2, 3, 0]]
        if len(times) == 1:
            matrix[:3, :3] = Rotation.from_quat(quats[0]).as_matrix()
        else:
            matrix[:3, :3] = Slerp(times, Rotation.from_quat(quats))(t).as_matrix()
        positions = np.array([key.position_m for key in self.path])
        matrix[:3, 3] = [np.interp(t, times, positions[:, axis]) for axis in range(3)]
        return matrix

    def holder(self, t_s: float) -> Attachment | None:
        """Who carries it at this time."""
        return next((a for a in self.attached if a.start_s <= t_s < a.end_s), None)


class Action(_Strict):
    """What a worker does from ``start_s`` to ``end_s``. Which entries a verb reads:

    stand   at_m, yaw_rad, look_m (where the head turns to)
    walk    path_m: ground points, passed at constant speed, turning smoothly
    crouch  at_m, yaw_rad, look_m: squatting, hands at the floor before the feet
    climb   thing (ladder or step ladder), height_m: (from, to) height of the soles; equal: works up there
    hold    thing (ladder or step ladder), side (left, right, front as seen by the climber): both hands on its rails
    carry   thing (a window), side (left, right: one of two carriers; alone): follows its path, hands on it
    mount   thing (platform or scaffold), at_m: a point on its deck, height_m: as of climb; equal: stands there
    work    at_m, yaw_rad, look_m: standing, one hand moving about the point look_m (a wall, a tool)
    """

    verb: Verb
    start_s: float
    end_s: float
    at_m: Vector3 | None = None
    yaw_rad: float | None = None
    look_m: Vector3 | None = None
    path_m: tuple[Vector3, ...] = ()
    thing: str | None = None
    height_m: tuple[float, float] | None = None
    side: Literal["left", "right", "front", "alone"] | None = None


class Worker(_Strict):
    """A worker, by the names of their body, clothes and way of moving."""

    id: str
    body: str
    clothes: str
    motion: str
    actions: Annotated[tuple[Action, ...], Field(min_length=1)]
    """One after the other, without gaps: each starts where and when the one before ends."""


class SceneCamera(_Strict):
    """A camera with its true calibration, its clock and its sensor."""

    id: str
    size_wh: tuple[int, int]
    model: str = "opencv5"
    coefficients: dict[str, float]
    quat_wxyz: Quaternion
    """Of ``cam_from_world``: x_cam = R x_world + translation."""
    translation_m: Vector3
    fps: float
    phase_s: float = 0.0
    """True time of its first frame's mid-exposure."""
    exposure_s: float = 0.008
    gain: float = 1.0
    """Noise: 1 is a good sensor in a well lit room."""
    ev: float = 0.0
    """Exposure beyond what the light rig asks for."""
    quality: int = 90
    """Of the JPEG; videos have their own bit rate."""
    clock_offset_s: float = 0.0
    """What to add to its stamps at true time 0 to have true time."""
    clock_drift_ppm: float = 0.0


class Violation(_Strict):
    """A violation from ``start_s`` (inclusive) to ``end_s``, as the story has it."""

    kind: ViolationKind
    start_s: float
    end_s: float
    workers: tuple[str, ...]
    things: tuple[str, ...]


class Scene(_Strict):
    """A scene."""

    format: Literal["sicsg.scene"] = "sicsg.scene"
    version: Literal[1] = 1
    seed: int
    split: Split
    story: str
    """Name of the story that it tells."""
    duration_s: float
    room: Room
    light: Light
    things: tuple[Thing, ...]
    workers: tuple[Worker, ...]
    cameras: tuple[SceneCamera, ...]
    violations: tuple[Violation, ...]

    def thing(self, name: str) -> Thing:
        """The thing of this id."""
        return next(thing for thing in self.things if thing.id == name)

    def assets(self) -> set[tuple[str, str]]:
        """Every asset that it is made of, as (kind, name)."""
        used = {("room", self.room.name), ("light", self.light.name)}
        textures = (self.room.wall_texture, self.room.floor_texture, self.room.ceiling_texture)
        used |= {("texture", name) for name in textures}
        used |= {(f"variant/{prop.kind}", prop.variant) for prop in self.room.props}
        used |= {(f"variant/{thing.category}", thing.variant) for thing in self.things}
        for worker in self.workers:
            used |= {("body", worker.body), ("clothes", worker.clothes), ("motion", worker.motion)}
        return used


def read_scene(path: Path) -> Scene:
    """Read a scene file."""
    return Scene.model_validate_json(path.read_text(encoding="utf-8"))


def write_scene(scene: Scene, path: Path) -> None:
    """Write a scene file."""
    path.write_text(scene.model_dump_json(indent=1, exclude_defaults=False) + "\n", encoding="utf-8")
