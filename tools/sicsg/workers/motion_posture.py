"""From a posture to bones: the trunk stands over the feet, legs and arms reach for where they belong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.skeleton import BONES, bone_matrices
from tools.sicsg.workers.gait import Footing, Instant
from tools.sicsg.workers.ik import (
    about,
    between,
    eased,
    limb_rotations,
    rotation_vector,
    turn,
    turned_by,
    two_bone,
    unit,
    yaw_matrix,
)
from tools.sicsg.workers.motion_rig import SIDES, SIGN, Rig, joint, rest_arm_direction

Floats = NDArray[np.float64]

_STRETCH = 0.993
"""Part of a leg's length that the trunk leaves it at the most: the knee stays bent by some degrees."""
_TIPTOE_RAD = (0.55, 1.15)
"""How far a heel rises so that the trunk need not sink, and how far it may rise in all."""
_BLEND_M = 0.008
"""Width over which the limits of the two legs pass into one another."""
_UP = np.array([0.0, 0.0, 1.0])
_ARM_FOLD = np.array([1.0, 0.0, 0.0])
"""To where the forearm folds at rest."""
_ARM_AHEAD = turn(0.0, -0.7, 0.0)
"""An upper arm half raised forward, from which no pose of an arm is half a turn away: between poses one goes by it."""


class Trunk(NamedTuple):
    """The trunk: where the pelvis is and how the back bends. Metres and radians."""

    x: float
    y: float
    z: float
    """Height of the pelvis that is wished; the legs may allow less."""
    yaw: float
    pitch: float = 0.0
    """Of the pelvis, forward."""
    roll: float = 0.0
    bend: float = 0.0
    """Of the chest against the pelvis, forward."""
    side: float = 0.0
    twist: float = 0.0
    hips: float = 0.0
    """Turn of the pelvis against ``yaw``."""
    gaze_yaw: float = 0.0
    """Of the head against ``yaw``."""
    gaze_pitch: float = 0.0
    """Of the head against the horizon, down positive."""
    tilt: float = 0.0
    heel_left: float = 0.0
    """Pitch of the left foot about its ball."""
    heel_right: float = 0.0
    splay: float = 0.12
    """How far the knees point outwards."""


class Reach(NamedTuple):
    """What a hand does."""

    palm: Floats
    """(3,) in the world."""
    pole: Floats
    """(3,) to where the elbow points, in the world."""
    thing: str = ""
    """Id of what it holds there."""
    pronation: float = 0.0
    """Turn of the hand about the forearm, palm down positive."""


@dataclass(frozen=True, slots=True, eq=False)
class Upper:
    """The trunk's upper end, from which arms are thought."""

    rig: Rig
    yaw: float
    heading: Floats
    """(3, 3) upright frame of the chest: x ahead, y left, z up."""
    shoulders: Floats
    """(2, 3)."""
    hips: Floats
    """(3,) the pelvis."""
    crown: Floats
    """(3,) the top of the head."""
    now: Instant

    def from_shoulder(self, side: int, ahead: float, out: float, up: float) -> Floats:
        """(3,) point beside a shoulder, in body heights; ``out`` points away from the body."""
        return self.shoulders[side] + self.heading @ (self.rig.height * np.array([ahead, SIGN[side] * out, up]))

    def direction(self, side: int, ahead: float, out: float, up: float) -> Floats:
        """(3,) vector in the chest's upright frame, ``out`` away from the body."""
        return self.heading @ np.array([ahead, SIGN[side] * out, up])


Hands = Callable[[Upper], tuple[Reach, Reach]]


def mixed(first: Trunk, second: Trunk, share: float) -> Trunk:
    """Between two trunks, whose angles are told apart by whole turns."""
    return Trunk(*(a + (b - a) * share for a, b in zip(first, second, strict=True)))


def yielding(upper: Upper, side: int, reach: Reach) -> Reach:
    """The reach, but where it is too far for the arm, which then never snaps straight."""
    way = reach.palm - upper.shoulders[side]
    distance = math.sqrt(float(way @ way))
    held = eased(distance, sum(upper.rig.arm))
    return reach if held == distance else reach._replace(palm=upper.shoulders[side] + way * (held / distance))


def mixed_reach(upper: Upper, side: int, ends: tuple[Reach, Reach], share: float) -> Reach:
    """Between two reaches of an arm, by its joints' angles: the hand goes on an arc; in between it holds nothing."""
    if share <= 0.0 or share >= 1.0:
        return ends[0] if share <= 0.0 else ends[1]
    direction, fold = rest_arm_direction(side), _ARM_FOLD
    turns, folds = [], []
    for reach in ends:
        above, below, _ = _arm_rotations(upper, side, reach)
        turns.append(above)
        along = above.T @ below @ direction
        folds.append(math.atan2(float(along @ fold), float(along @ direction)))
    middle = upper.heading @ _ARM_AHEAD
    first, second = (rotation_vector(middle.T @ turned) for turned in turns)
    turned = middle @ turned_by(first + (second - first) * share)
    angle = folds[0] + (folds[1] - folds[0]) * share
    lengths = upper.rig.arm
    arm = lengths[0] * direction + lengths[1] * (math.cos(angle) * direction + math.sin(angle) * fold)
    pronation = ends[0].pronation + (ends[1].pronation - ends[0].pronation) * share
    return Reach(upper.shoulders[side] + turned @ arm, turned @ -fold, "", pronation)


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A posture as bones."""

    bones: Floats
    """(B, 4, 4) ``world_from_rest``."""
    palms: tuple[Floats, Floats]
    """Where the palms are, each (3,)."""


def solve(rig: Rig, trunk: Trunk, now: Instant, hands: Hands) -> Solved:
    """Bones of a trunk over the feet at an instant, with the hands where they reach to."""
    rotations = np.tile(np.eye(3), (len(BONES), 1, 1))
    points = np.zeros((len(BONES), 3))
    _spine(trunk, rotations)
    pelvis = np.array([trunk.x, trunk.y, 0.0])
    hips = [rotations[0] @ np.array([0.0, sign * rig.half_hip, -rig.hip_drop]) for sign in SIGN]
    heels = (trunk.heel_left, trunk.heel_right)
    limits = [_leg_limit(rig, foot, heel, pelvis + hip) for foot, heel, hip in zip(now.feet, heels, hips, strict=True)]
    pelvis[2] = _soft_minimum([trunk.z, *limits])
    points[0] = pelvis
    for bone, parent in ((1, 0), (2, 1), (3, 2), (4, 3)):
        points[bone] = points[parent] + rotations[parent] @ (rig.rest[bone] - rig.rest[parent])
    for side in range(2):
        _leg(rig, side, trunk, now.feet[side], heels[side], pelvis + hips[side], points, rotations)
    upper = _upper(rig, now, points, rotations)
    palms = [_arm(rig, side, upper, reach, points, rotations) for side, reach in enumerate(hands(upper))]
    return Solved(bone_matrices(points, rotations, rig.rest), (palms[0], palms[1]))


def _spine(trunk: Trunk, rotations: Floats) -> None:
    rotations[0] = turn(trunk.yaw + trunk.hips, trunk.pitch, trunk.roll)
    half = turn(trunk.twist / 2, trunk.bend / 2, trunk.side / 2)
    rotations[1] = rotations[0] @ half
    rotations[2] = rotations[1] @ half
    rotations[4] = turn(trunk.yaw + trunk.gaze_yaw, trunk.gaze_pitch, trunk.tilt)
    rotations[3] = between(rotations[2], rotations[4], 0.5)


def _soft_minimum(values: list[float]) -> float:
    """Below every value, and smooth."""
    low = min(values)
    return low - _BLEND_M * math.log(sum(math.exp(-(value - low) / _BLEND_M) for value in values))


def _ankle(rig: Rig, foot: Footing, pitch: float) -> Floats:
    """(3,) the ankle of a foot that is tipped about its ball, or about its heel when the toes are up."""
    x, z = rig.ankle
    c, s = math.cos(pitch), math.sin(pitch)
    ahead, up = x * c + z * s, -x * s + z * c + rig.heel * max(-s, 0.0)
    sole = foot.sole
    return np.array([sole.x + ahead * math.cos(sole.yaw), sole.y + ahead * math.sin(sole.yaw), sole.z + up])


def _leg_limit(rig: Rig, foot: Footing, heel: float, hip: Floats) -> float:
    """How high the pelvis can be so that the leg reaches its foot; ``hip`` (3,) is relative to the pelvis' height."""
    length = _STRETCH * sum(rig.leg)
    best = -math.inf
    pitch = foot.pitch + heel
    for tip in (pitch, max(pitch, _TIPTOE_RAD[0])):
        ankle = _ankle(rig, foot, tip)
        room = length**2 - (hip[0] - ankle[0]) ** 2 - (hip[1] - ankle[1]) ** 2
        best = max(best, ankle[2] + math.sqrt(max(room, 0.04 * length**2)) - hip[2])
    return best


def _heel_rise(rig: Rig, foot: Footing, pitch: float, hip: Floats) -> float:
    """The pitch, or the smallest above it at which the leg reaches the ankle."""
    length = _STRETCH * sum(rig.leg)
    sole = foot.sole
    dx, dy = hip[0] - sole.x, hip[1] - sole.y
    ahead = dx * math.cos(sole.yaw) + dy * math.sin(sole.yaw)
    aside = -dx * math.sin(sole.yaw) + dy * math.cos(sole.yaw)
    up = hip[2] - sole.z
    x, z = rig.ankle
    radius, far = math.hypot(x, z), math.hypot(ahead, up)
    ankle = math.atan2(z, x)
    wanted = (ahead**2 + up**2 + aside**2 + radius**2 - length**2) / (2 * radius * far)
    if math.cos(ankle - pitch - math.atan2(up, ahead)) >= wanted:
        return pitch
    needed = ankle - math.atan2(up, ahead) - math.acos(min(max(wanted, -1.0), 1.0))
    return min(max(needed, pitch), _TIPTOE_RAD[1])


def _leg(
    rig: Rig, side: int, trunk: Trunk, foot: Footing, heel: float, hip: Floats, points: Floats, rotations: Floats
) -> None:
    thigh = joint(f"{SIDES[side]}_thigh")
    pitch = _heel_rise(rig, foot, foot.pitch + heel, hip)
    ankle = _ankle(rig, foot, pitch)
    facing = trunk.yaw + 0.6 * min(max(foot.sole.yaw - trunk.yaw, -1.2), 1.2) + SIGN[side] * trunk.splay
    pole = np.array([math.cos(facing), math.sin(facing), 0.25])
    knee, end, across = two_bone(hip, ankle, rig.leg, pole)
    points[thigh], points[thigh + 1], points[thigh + 2] = hip, knee, end
    upper, lower = limb_rotations(-_UP, np.array([-1.0, 0.0, 0.0]), (hip, knee, end), across)
    rest = rig.rest[thigh + 2] - rig.rest[thigh + 1]
    rotations[thigh] = upper
    rotations[thigh + 1] = lower @ turn(0.0, math.atan(-rest[0] / rest[2]), 0.0)
    rotations[thigh + 2] = turn(foot.sole.yaw, pitch, 0.0)


def _upper(rig: Rig, now: Instant, points: Floats, rotations: Floats) -> Upper:
    chest = rotations[2]
    yaw = math.atan2(chest[1, 0], chest[0, 0]) if chest[0, 0] ** 2 + chest[1, 0] ** 2 > 1e-6 else 0.0
    arms = [joint(f"{side}_upper_arm") for side in SIDES]
    shoulders = points[2] + (rig.rest[arms] - rig.rest[2]) @ chest.T
    crown = points[4] + rotations[4] @ np.array([0.0, 0.0, rig.crown_over_head])
    return Upper(rig, yaw, yaw_matrix(yaw), shoulders, points[0], crown, now)


def _arm_rotations(upper: Upper, side: int, reach: Reach) -> tuple[Floats, Floats, tuple[Floats, Floats]]:
    """Rotations (3, 3) of upper arm and forearm, and elbow and palm."""
    shoulder = upper.shoulders[side]
    elbow, palm, across = two_bone(shoulder, reach.palm, upper.rig.arm, reach.pole)
    first, second = limb_rotations(rest_arm_direction(side), _ARM_FOLD, (shoulder, elbow, palm), across)
    return first, second, (elbow, palm)


def _arm(rig: Rig, side: int, upper: Upper, reach: Reach, points: Floats, rotations: Floats) -> Floats:
    """Place an arm; where its palm is."""
    bone = joint(f"{SIDES[side]}_upper_arm")
    rotations[bone], fore, (elbow, palm) = _arm_rotations(upper, side, reach)
    along = unit(palm - elbow)
    twist = SIGN[side] * reach.pronation
    rotations[bone + 1] = about(along, twist / 2) @ fore
    rotations[bone + 2] = about(along, twist) @ fore
    points[bone], points[bone + 1] = upper.shoulders[side], elbow
    points[bone + 2] = elbow + along * rig.forearm
    return palm
