"""The demo's story: 30 seconds of window installation with all four violations, one after the other or together.

Two workers carry a large window; one lets go of it for a while, later they set it down. A third works on a step ladder
that the fourth holds, but for some seconds. The fourth takes the hat off and puts it on again. At the end two stand on
the platform at once. Times are approximate; ``violations.timeline`` has them exactly.
"""

from __future__ import annotations

import math

import numpy as np

from tools.sicsg.scene import LightKind, Scene
from tools.sicsg.skeleton import body
from tools.sicsg.story.fillers import lying_about
from tools.sicsg.story.stage import Stage, StageFullError, upright
from tools.sicsg.story.vignettes import hats_on
from tools.sicsg.story.write import MAX_THINGS, Cameras, light_of, room_of
from tools.sicsg.violations import timeline
from tools.sicsg.workers.stations import carry_height_m, carry_stations, climb_base, hold_station, mount_base

DURATION_S = 30.0
WINDOW_ALONE_S, WINDOW_DOWN_S = (6.0, 12.0), 14.0
LADDER_LEFT_S, LADDER_DOWN_S = (9.0, 14.0), 17.5
HAT_OFF_S = (20.0, 24.0)
PLATFORM_S = (19.5, 22.5, 26.5)
_MOUNT_S = 3.0
"""The first mounts; the second mounts; the second has had enough."""
_LADDER_AT, _LADDER_YAW = (1.5, 1.1), math.pi / 2
_WINDOW_AT, _WINDOW_YAW = (-0.6, 1.0), 0.0
_PLATFORM_AT, _PLATFORM_YAW = (-1.0, -1.3), 0.3
_LARGE_ROOM_M = 7.5


def write_shift(seed: int, light_kind: LightKind, cameras: Cameras) -> Scene:
    """The scene; ``seed`` draws room, people, clothes and variants from what validation may use."""
    for attempt in range(60):
        rng = np.random.default_rng((seed, attempt))
        place = room_of("validation", rng)
        if min(place.size_m[:2]) < _LARGE_ROOM_M:
            continue
        stage = Stage(rng, "validation", place, DURATION_S)
        if not all(stage.is_free(x, y, 1.2) for x, y in (_LADDER_AT, _WINDOW_AT, _PLATFORM_AT)):
            continue
        for x, y in (_LADDER_AT, _WINDOW_AT, _PLATFORM_AT):
            stage.block(x, y, 1.4)
        _window_and_platform(stage)
        _ladder_and_hat(stage)
        lying_about(stage, MAX_THINGS - len(stage.things))
        scene = Scene(
            seed=seed, split="validation", story="shift", duration_s=DURATION_S, room=place,
            light=light_of("validation", rng, place, light_kind), things=tuple(stage.things),
            workers=tuple(stage.workers), cameras=cameras(rng, place), violations=(),
        )  # fmt: skip
        return scene.model_copy(update={"violations": timeline(scene)})
    raise StageFullError


def _window_and_platform(stage: Stage) -> None:
    variant, what = stage.item("large_window")
    (x, y), turn = _WINDOW_AT, _WINDOW_YAW
    high = min(carry_height_m(what, body("0000")), 0.5)
    lowered = WINDOW_DOWN_S + 1.2
    path = (
        upright(x, y - 0.7, turn, high), upright(x, y - 0.7, turn, high, 1.0), upright(x, y, turn, high, 2.6),
        upright(x, y, turn, high, WINDOW_DOWN_S), upright(x, y, turn, 0.0, lowered),
    )  # fmt: skip
    window = stage.put("large_window", variant, path)
    platform_variant, deck_item = stage.item("platform")
    platform = stage.put("platform", platform_variant, (upright(*_PLATFORM_AT, _PLATFORM_YAW),))
    deck = deck_item.deck_m @ platform.pose(0.0)[:3, :3].T + platform.pose(0.0)[:3, 3]
    middle, top = deck.mean(axis=0), float(deck[:, 2].mean())
    edges = (deck[1] - deck[0], deck[2] - deck[1])
    long = max(edges, key=np.linalg.norm)
    step = long / np.linalg.norm(long) * max(np.linalg.norm(long) / 2 - 0.28, 0.2)

    for side, until, spot, mounts, leaves in (
        ("left", None, middle + step, PLATFORM_S[0], None),
        ("right", WINDOW_ALONE_S, middle - step, PLATFORM_S[1], PLATFORM_S[2]),
    ):
        (px, py, _), yaw = carry_stations(what, window.pose(0.0), side)
        script = stage.script((float(px), float(py)), yaw)
        (ex, ey, _), end_yaw = carry_stations(what, window.pose(lowered), side)
        at = (float(ex), float(ey))
        if until is not None:
            aside = (at[0] + 0.9, at[1] - 0.5)
            script.use("carry", window.id, until[0], at, end_yaw, side=side).walk(aside)
            script.still("stand", until[1] - script.walk_time(at), look_m=(x, y, 1.2)).walk(at)
        script.use("carry", window.id, lowered + 0.3, at, end_yaw, side=side)
        (bx, by, _), base_yaw = mount_base(deck_item, platform.pose(0.0), spot)
        base = (float(bx), float(by))
        script.walk(*_around(script.at, base))
        script.still("stand", max(mounts - _MOUNT_S, script.t_s), yaw_rad=base_yaw)
        on = {"at_m": tuple(float(v) for v in spot)}
        script.use("mount", platform.id, script.t_s + _MOUNT_S, base, base_yaw, height_m=(0.0, top), **on)
        script.use("mount", platform.id, leaves or DURATION_S, base, base_yaw, height_m=(top, top), **on)
        if leaves is not None:
            script.use("mount", platform.id, leaves + _MOUNT_S, base, base_yaw, height_m=(top, 0.0), **on)
        stage.enter(script)
        hats_on(stage, script.worker)


def _around(start: tuple[float, float], end: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """A way that goes round the middle of the window."""
    side = 1.2 if start[0] > _WINDOW_AT[0] else -1.2
    return ((_WINDOW_AT[0] + side, start[1] - 0.6), end)


def _ladder_and_hat(stage: Stage) -> None:
    variant, what = stage.item("step_ladder")
    ladder = stage.put("step_ladder", variant, (upright(*_LADDER_AT, _LADDER_YAW),))
    pose = ladder.pose(0.0)
    heights = what.steps_m[:, :, 2].mean(axis=1)
    height = float(heights[np.abs(heights - 0.85).argmin()])
    climbing_s = height / 0.45
    (bx, by, _), yaw = climb_base(what, pose)
    base = (float(bx), float(by))
    climber = stage.script(base, yaw).still("stand", 3.0, yaw_rad=yaw)
    climber.use("climb", ladder.id, 3.0 + climbing_s, base, yaw, height_m=(0.0, height))
    climber.use("climb", ladder.id, LADDER_DOWN_S - climbing_s, base, yaw, height_m=(height, height))
    climber.use("climb", ladder.id, LADDER_DOWN_S, base, yaw, height_m=(height, 0.0))
    climber.still("work", DURATION_S, look_m=(base[0] + 0.4 * math.cos(yaw), base[1] + 0.4 * math.sin(yaw), 1.3))
    stage.enter(climber)
    hats_on(stage, climber.worker)
    (hx, hy, _), hold_yaw = hold_station(what, pose, "left")
    at = (float(hx), float(hy))
    outward = np.array(at) - _LADDER_AT
    aside = tuple((np.array(at) + outward / np.linalg.norm(outward) * 0.8).tolist())
    holder = stage.script(at, hold_yaw).use("hold", ladder.id, LADDER_LEFT_S[0], at, hold_yaw, side="left").walk(aside)
    holder.still("crouch", LADDER_LEFT_S[1] - holder.walk_time(at)).walk(at)
    holder.use("hold", ladder.id, LADDER_DOWN_S + 0.5, at, hold_yaw, side="left").walk(aside)
    holder.still("stand", DURATION_S, look_m=(0.0, 0.0, 1.5))
    stage.enter(holder)
    hats_on(stage, holder.worker, (HAT_OFF_S,))
