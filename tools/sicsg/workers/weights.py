"""Which bones move a point of the rest pose, and how much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.skeleton import BONES, PARENT
from tools.sicsg.workers.body_shape import Figure

Floats = NDArray[np.float64]
INFLUENCES = 4
"""Most bones that move one vertex."""


def skin_weights(figure: Figure, points_m: Floats, still: tuple[str, ...] = ()) -> Floats:
    """(N, B) weights of rest-pose points; they sum to 1.

    The body is shared out from the trunk to the limbs: along the trunk by height, at shoulders by which of torso and
    arm is nearer, at hips, elbows, knees, wrists and ankles by the plane across the joint, each with a soft border.

    Args:
        figure: the body.
        points_m: (N, 3) in the rest pose, on the body or its clothes.
        still: bones that pass their share on to their parent: a sleeve does not follow the hand.
    """
    weights = np.zeros((len(points_m), len(BONES)))
    weights[:, 0] = 1.0
    _share_trunk(weights, figure, points_m)
    for side, name in enumerate(("left", "right")):
        _share_arm(weights, figure, points_m, side, name)
    _share_legs(weights, figure, points_m)
    for bone in still:
        index = BONES.index(bone)
        weights[:, PARENT[index]] += weights[:, index]
        weights[:, index] = 0.0
    return weights


def strongest(weights: Floats) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """(N, 4) largest weights, made to sum to 1, and their bones, the strongest first."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    kept = np.take_along_axis(weights, bones, axis=1)
    kept = np.where(kept < 0.01, 0.0, kept)
    return (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32), bones.astype(np.int32)


def _step(value: Floats, half_width: float) -> Floats:
    """0 below ``-half_width``, 1 above ``half_width``, smooth between."""
    t = np.clip(0.5 + 0.5 * value / half_width, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def _give(weights: Floats, giver: str, taker: str, share: Floats) -> None:
    """Pass this share (N,) of one bone's weight to another."""
    moved = weights[:, BONES.index(giver)] * share
    weights[:, BONES.index(giver)] -= moved
    weights[:, BONES.index(taker)] += moved


def _share_trunk(weights: Floats, figure: Figure, points: Floats) -> None:
    scale = figure.scale
    for giver, taker, half in (("pelvis", "spine", 0.08), ("spine", "chest", 0.08), ("chest", "neck", 0.035)):
        _give(weights, giver, taker, _step(points[:, 2] - figure.joint(taker)[2], half * scale))
    nearer = figure.neck.distance(points) - figure.head.distance(points)
    _give(weights, "neck", "head", _step(nearer, 0.02 * scale))


def _share_arm(weights: Floats, figure: Figure, points: Floats, side: int, name: str) -> None:
    scale, axis = figure.scale, figure.arm_axis(side)
    trunk = np.minimum(figure.torso.distance(points), figure.yokes[side].distance(points))
    nearer = trunk - figure.arms[side].distance(points)
    share = _step(nearer + 0.005 * scale, 0.045 * scale) * _step(points[:, 1] * np.sign(axis[1]), 0.05 * scale)
    for bone in ("pelvis", "spine", "chest", "neck"):
        _give(weights, bone, f"{name}_upper_arm", share)
    for giver, taker, half in (("upper_arm", "forearm", 0.05), ("forearm", "hand", 0.025)):
        beyond = (points - figure.joint(f"{name}_{taker}")) @ axis
        _give(weights, f"{name}_{giver}", f"{name}_{taker}", _step(beyond, half * scale))


def _share_legs(weights: Floats, figure: Figure, points: Floats) -> None:
    scale, hip = figure.scale, figure.joint("left_thigh")
    below_hip = hip[2] - points[:, 2] + 0.15 * points[:, 0]
    for bone in ("pelvis", "spine"):
        _give(weights, bone, "left_thigh", _step(below_hip, 0.10 * scale))
    _give(weights, "left_thigh", "right_thigh", _step(-points[:, 1], 0.01 * scale))
    for name in ("left", "right"):
        for giver, taker, half in (("thigh", "shin", 0.06), ("shin", "foot", 0.03)):
            below = figure.joint(f"{name}_{taker}")[2] - points[:, 2]
            _give(weights, f"{name}_{giver}", f"{name}_{taker}", _step(below, half * scale))
