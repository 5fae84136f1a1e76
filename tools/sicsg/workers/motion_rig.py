"""A body's lengths and points as motion needs them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.skeleton import BONES, REST_ARM_RAD, Body, body, crown, rest_joints

Floats = NDArray[np.float64]
SIDES = ("left", "right")
"""Order of pairs everywhere; index 0 lies towards +y of the worker."""
SIGN = (1.0, -1.0)
"""Of y, by side."""
_BALL, _HEEL, _PALM = 0.075, 0.115, 0.05
"""Fractions of the body height: ankle to ball of the foot, ball to heel (along the foot), wrist to palm."""


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """What follows from a body once and for all. Lengths in metres."""

    body: Body
    rest: Floats
    """(B, 3) joints at rest."""
    arm: tuple[float, float]
    """Lengths of upper arm, and forearm with the hand as far as the palm."""
    forearm: float
    leg: tuple[float, float]
    """Lengths of thigh and shin."""
    ankle: tuple[float, float]
    """x and z of the ankle from the ball of the foot, on a flat foot."""
    heel: float
    """From the ball back to the heel."""
    half_hip: float
    pelvis: float
    """Height of the pelvis at rest."""
    hip_drop: float
    """Height of the pelvis over the hips."""
    crown_over_head: float
    """Height of the crown over the joint of the head."""

    @property
    def height(self) -> float:
        """Body height."""
        return self.body.height_m


def joint(name: str) -> int:
    """Index of a bone."""
    return BONES.index(name)


def rest_arm_direction(side: int) -> Floats:
    """(3,) unit vector along the hanging arm at rest, shoulder to knuckles."""
    return np.array([0.0, SIGN[side] * np.sin(REST_ARM_RAD), -np.cos(REST_ARM_RAD)])


@lru_cache(maxsize=512)
def rig(name: str) -> Rig:
    """The rig of the body of this asset name."""
    shape = body(name)
    rest = rest_joints(shape)
    h = shape.height_m

    def length(one: str, two: str) -> float:
        return float(np.linalg.norm(rest[joint(two)] - rest[joint(one)]))

    forearm = length("left_forearm", "left_hand")
    return Rig(
        body=shape,
        rest=rest,
        arm=(length("left_upper_arm", "left_forearm"), forearm + _PALM * h),
        forearm=forearm,
        leg=(length("left_thigh", "left_shin"), length("left_shin", "left_foot")),
        ankle=(-_BALL * h, float(rest[joint("left_foot"), 2])),
        heel=_HEEL * h,
        half_hip=float(rest[joint("left_thigh"), 1]),
        pelvis=float(rest[0, 2]),
        hip_drop=float(rest[0, 2] - rest[joint("left_thigh"), 2]),
        crown_over_head=float(crown(shape)[2] - rest[joint("head"), 2]),
    )
