"""What else is on a site: workers who do harmless things, objects that lie about."""

from __future__ import annotations

import numpy as np

from tools.sicsg.catalog import leaning_pose, wall_distance_m
from tools.sicsg.scene import Attachment, Keyframe
from tools.sicsg.story.stage import Stage, StageFullError, keyframe_of_matrix, upright
from tools.sicsg.story.vignettes import hats_on

_ALWAYS = 1e6
_TOOLS = ("drill", "toolbox", "bucket", "small_window")
_LYING = (
    "toolbox", "cone", "bucket", "saw_horse", "barrel", "wheelbarrow", "scaffold", "cone", "toolbox", "step_ladder",
    "platform", "drill", "hard_hat",
)  # fmt: skip


def busy(stage: Stage, *, hatted: bool = True) -> None:
    """A worker who walks, works, crouches or stands, perhaps with a tool in the hand."""
    rng = stage.rng
    at = stage.spot(0.45)
    script = stage.script(at, float(rng.uniform(-np.pi, np.pi)))
    tool = str(rng.choice(_TOOLS)) if rng.random() < 0.5 else None
    while script.t_s < stage.duration_s:
        verb = str(rng.choice(["stand", "walk", "walk", "crouch", "work"]))
        until = min(script.t_s + float(rng.uniform(1.5, 4.0)), stage.duration_s)
        if verb == "walk":
            goal = stage.near(script.at, (0.8, 3.0), 0.35)
            if stage.clear_way(script.at, goal):
                script.walk(goal, pace_m_per_s=float(rng.uniform(0.8, 1.5)))
                continue
            verb = "stand"
        angle, up = script.yaw_rad + float(rng.uniform(-0.8, 0.8)), float(rng.uniform(0.9, 1.9))
        look = (script.at[0] + 0.55 * np.cos(angle), script.at[1] + 0.55 * np.sin(angle), up)
        script.still(verb, until, look_m=look if verb == "work" else None)
    if script.t_s > stage.duration_s:
        script.duration_s = script.t_s
    stage.enter(script)
    if hatted:
        hats_on(stage, script.worker)
    if tool is not None:
        variant, _ = stage.item(tool)
        held = Attachment(start_s=-_ALWAYS, end_s=_ALWAYS, worker=script.worker, bone="right_hand")
        stage.put(tool, variant, (Keyframe(t_s=0.0, position_m=(0.0, 0.0, -9.0)),), (held,))


def lying_about(stage: Stage, count: int) -> None:
    """Objects that stand or lie around, as many as there is space for; some against the walls."""
    for _ in range(count):
        try:
            if stage.rng.random() < 0.3:
                _against_wall(stage)
            else:
                _on_floor(stage)
        except StageFullError:
            return


def _on_floor(stage: Stage) -> None:
    category = str(stage.rng.choice(_LYING))
    variant, what = stage.item(category)
    reach, stage.reach_m = stage.reach_m, stage.reach_m + 1.2
    try:
        x, y = stage.spot(max(what.size_m[0], what.size_m[1]) / 2 + 0.1)
    finally:
        stage.reach_m = reach
    turn = float(stage.rng.uniform(-np.pi, np.pi))
    low = -float(what.mesh.vertices_m[:, 2].min())
    stage.put(category, variant, (upright(x, y, turn, low),))


def _against_wall(stage: Stage) -> None:
    category = str(stage.rng.choice(["large_window", "small_window", "ladder"]))
    variant, what = stage.item(category)
    x, y, yaw = stage.wall(what.size_m[1] + 0.1)
    lean = float(np.deg2rad(stage.rng.uniform(6, 14)))
    away = wall_distance_m(what, lean) + 0.01
    foot = np.array([x + away * np.cos(yaw), y + away * np.sin(yaw), 0.0])
    stage.put(category, variant, (keyframe_of_matrix(leaning_pose(what, foot, yaw, lean)),))
