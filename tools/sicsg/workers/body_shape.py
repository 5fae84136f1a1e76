"""The shape of a naked body in the rest pose, part by part, as distances.

Radii are those of a man of 1.77 m with a girth of 1, in metres; they follow the body's height, girth and shoulders.
They are drawn by eye, around the joints of ``skeleton.rest_joints``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.skeleton import BONES, Body, crown, rest_coco, rest_joints
from tools.sicsg.workers.fields import FORWARD, UP, Capsule, Ellipsoid, Loft, Shape, Solid

Floats = NDArray[np.float64]
_AVERAGE_HEIGHT_M = 1.77

# Place (0 hip, 1 shoulder), then radii to the front, to the back, to the side.
_TORSO_MALE = np.array([
    (-0.20, 0.070, 0.090, 0.120), (-0.04, 0.098, 0.122, 0.168), (0.10, 0.104, 0.108, 0.162),
    (0.28, 0.108, 0.086, 0.146), (0.45, 0.112, 0.090, 0.150), (0.68, 0.118, 0.106, 0.165),
    (0.85, 0.098, 0.108, 0.168), (0.97, 0.066, 0.085, 0.130), (1.06, 0.050, 0.064, 0.080),
])  # fmt: skip
_TORSO_FEMALE = np.array([
    (-0.20, 0.072, 0.098, 0.128), (-0.04, 0.100, 0.134, 0.184), (0.10, 0.100, 0.112, 0.172),
    (0.28, 0.096, 0.082, 0.142), (0.45, 0.102, 0.086, 0.144), (0.66, 0.132, 0.098, 0.154),
    (0.85, 0.094, 0.100, 0.156), (0.97, 0.064, 0.080, 0.122), (1.06, 0.048, 0.060, 0.074),
])  # fmt: skip
# Place (0 shoulder, 1 elbow, 2 wrist) and the same radii; the palm side is "side".
_ARM = np.array([
    (-0.14, 0.040, 0.042, 0.036), (0.00, 0.053, 0.055, 0.051), (0.25, 0.053, 0.055, 0.051),
    (0.55, 0.049, 0.047, 0.044), (0.85, 0.041, 0.041, 0.039), (1.00, 0.041, 0.041, 0.039),
    (1.25, 0.046, 0.044, 0.041), (1.55, 0.041, 0.038, 0.034), (1.85, 0.032, 0.031, 0.026),
    (2.00, 0.031, 0.030, 0.023), (2.15, 0.030, 0.029, 0.021),
])  # fmt: skip
# Place (0 hip, 1 knee, 2 ankle) and the same radii.
_LEG = np.array([
    (-0.20, 0.060, 0.070, 0.060), (0.00, 0.084, 0.095, 0.082), (0.15, 0.086, 0.094, 0.088),
    (0.40, 0.082, 0.084, 0.080), (0.75, 0.067, 0.065, 0.064), (1.00, 0.062, 0.056, 0.057),
    (1.10, 0.056, 0.058, 0.056), (1.35, 0.052, 0.070, 0.059), (1.60, 0.045, 0.058, 0.050),
    (1.88, 0.037, 0.042, 0.038), (2.05, 0.038, 0.042, 0.038),
])  # fmt: skip
# Height above the joint of the head, and the same radii.
_FACE = np.array([
    (-0.046, 0.076, 0.015, 0.024), (-0.034, 0.089, 0.030, 0.038), (-0.015, 0.092, 0.050, 0.052),
    (0.010, 0.095, 0.066, 0.059), (0.040, 0.097, 0.080, 0.068), (0.066, 0.096, 0.090, 0.073),
    (0.082, 0.099, 0.094, 0.0745), (0.102, 0.103, 0.096, 0.075), (0.122, 0.097, 0.094, 0.072),
    (0.140, 0.080, 0.085, 0.060),
])  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """The parts of one body, in the rest pose, in the world's frame."""

    body: Body
    joints_m: Floats
    """(B, 3) of :func:`rest_joints`."""
    scale: float
    """Height relative to a man of 1.77 m."""
    torso: Loft
    """Pelvis to the base of the neck."""
    yokes: tuple[Capsule, Capsule]
    """Left and right slope from the neck to the shoulder."""
    neck: Capsule
    head: Solid
    arms: tuple[Loft, Loft]
    """Left and right, shoulder to wrist."""
    hands: tuple[Solid, Solid]
    legs: tuple[Loft, Loft]
    """Left and right, hip to ankle."""
    feet: tuple[Solid, Solid]
    """In boots."""

    def joint(self, bone: str) -> Floats:
        """(3,) where the bone turns."""
        return np.asarray(self.joints_m[BONES.index(bone)])

    def arm_axis(self, side: int) -> Floats:
        """(3,) unit vector from the left (0) or right (1) shoulder to the wrist."""
        name = ("left", "right")[side]
        axis = self.joint(f"{name}_hand") - self.joint(f"{name}_upper_arm")
        return np.asarray(axis / np.linalg.norm(axis))


def figure(body: Body) -> Figure:
    """The parts of this body."""
    joints = rest_joints(body)
    scale = body.height_m / _AVERAGE_HEIGHT_M
    wide = scale * body.girth
    hip, shoulder = joints[BONES.index("left_thigh")], joints[BONES.index("left_upper_arm")]
    neck, head = joints[BONES.index("neck")], joints[BONES.index("head")]
    yokes, arms, hands, legs, feet = [], [], [], [], []
    for name, sign in (("left", 1.0), ("right", -1.0)):
        at = {part: joints[BONES.index(f"{name}_{part}")] for part in ("upper_arm", "forearm", "hand")}
        collar_m = neck + scale * np.array([0.0, 0.045 * sign, -0.01])
        shoulder_m = at["upper_arm"] + scale * np.array([-0.005, -0.03 * sign, 0.008])
        yokes.append(Capsule(collar_m, shoulder_m, 0.046 * wide, 0.044 * wide))
        arms.append(_limb(at["upper_arm"], at["forearm"], at["hand"], _ARM, scale * _thinner(body)))
        hands.append(_hand(at["hand"], at["hand"] - at["upper_arm"], sign, scale))
        thigh, shin, foot = (joints[BONES.index(f"{name}_{part}")] for part in ("thigh", "shin", "foot"))
        legs.append(_limb(thigh, shin, foot, _LEG, scale * _thinner(body)))
        feet.append(_foot(foot, scale))
    neck_radius = 0.056 * scale * _thinner(body) * (0.88 if body.female else 1.0)
    neck_bar = Capsule(neck - [0.012, 0, 0.06 * scale], head + [0.002, 0, 0.02 * scale], neck_radius, neck_radius)
    return Figure(
        body, joints, scale, _torso(body, hip, shoulder), (yokes[0], yokes[1]), neck_bar, _head(body),
        (arms[0], arms[1]), (hands[0], hands[1]), (legs[0], legs[1]), (feet[0], feet[1]),
    )  # fmt: skip


def _thinner(body: Body) -> float:
    """How much thicker limbs are than average: they grow less with the girth than the belly does."""
    return (1 + 0.7 * (body.girth - 1)) * (0.95 if body.female else 1.0)


def _torso(body: Body, hip: Floats, shoulder: Floats) -> Loft:
    """Pelvis to neck; a large girth is mostly belly."""
    knots = (_TORSO_FEMALE if body.female else _TORSO_MALE).copy()
    scale, place = body.height_m / _AVERAGE_HEIGHT_M, knots[:, 0].copy()
    knots[:, 1:] *= scale * (1 + 0.8 * (body.girth - 1))
    belly = np.exp(-(((place - 0.28) / 0.25) ** 2))
    knots[:, 1] += scale * 0.22 * (body.girth - 1) * belly
    chest = np.clip((place - 0.3) / 0.4, 0, 1)
    knots[:, 3] *= 1 + chest * (body.shoulders - 1)
    knots[:, 0] = place * (shoulder[2] - hip[2])
    return Loft((-0.003, 0, hip[2]), UP, FORWARD, knots, power=2.3)


def _limb(root: Floats, middle: Floats, end: Floats, table: Floats, scale: float) -> Loft:
    """A limb that is straight at rest, of a table over its two bones."""
    first, second = np.linalg.norm(middle - root), np.linalg.norm(end - middle)
    knots = table.copy()
    knots[:, 1:] *= scale
    knots[:, 0] = np.where(table[:, 0] < 1, table[:, 0] * first, first + (table[:, 0] - 1) * second)
    axis = (end - root) / np.linalg.norm(end - root)
    front = FORWARD - (FORWARD @ axis) * axis
    return Loft(root, axis, front / np.linalg.norm(front), knots)


def _head(body: Body) -> Solid:
    """Skull, face, nose, brow and ears; it grows with the root of the height, but lies where the joints are."""
    scale, size = body.height_m / _AVERAGE_HEIGHT_M, np.sqrt(body.height_m / _AVERAGE_HEIGHT_M)
    joint, top, coco = rest_joints(body)[BONES.index("head")], crown(body), rest_coco(body)
    face = _FACE * [scale, size, size, size]
    if body.female:
        face[:4, [1, 3]] *= (0.96, 0.93)
    skull_m = np.array([0.099, 0.0775, 0.098 * scale / size]) * size
    nose, ears = coco[0], coco[3:5]
    skull = Ellipsoid(np.array([joint[0] - 0.002, 0, top[2] - skull_m[2]]), skull_m)
    bridge = Capsule(
        nose + np.array([-0.010, 0, 0.040]) * scale,
        nose + np.array([-0.0105, 0, -0.003]) * scale,
        0.006 * size,
        0.0125 * size,
    )
    brow = [coco[i] + [0.001, 0, 0.017 * scale] for i in (1, 2)]
    parts: list[tuple[Shape, float]] = [
        (skull, 0.0),
        (Loft(joint, UP, FORWARD, face, power=2.2), 0.008),
        (bridge, 0.012),
        (Capsule(brow[0], brow[1], 0.009 * size, 0.009 * size), 0.012),
    ]
    for ear, sign in zip(ears, (1.0, -1.0), strict=True):
        pinna = np.array([0.017, 0.012, 0.031]) * size
        parts.append((Ellipsoid(ear + np.array([-0.010, 0.004 * sign, 0.0]) * size, pinna), 0.003))
    return Solid(tuple(parts))


def _hand(wrist: Floats, along: Floats, sign: float, scale: float) -> Solid:
    """A hand with half closed fingers and a thumb towards the front."""
    axis = along / np.linalg.norm(along)
    inward = np.cross(axis, FORWARD) * sign
    frame = scale * np.stack([axis, FORWARD, inward])

    def place(*steps_m: float) -> Floats:
        return np.asarray(wrist + np.asarray(steps_m) @ frame)

    palm = scale * np.array([
        (-0.01, 0.029, 0.029, 0.020), (0.03, 0.036, 0.034, 0.020), (0.08, 0.043, 0.041, 0.018),
        (0.105, 0.041, 0.039, 0.015),
    ])  # fmt: skip
    parts: list[tuple[Shape, float]] = [(Loft(wrist, axis, FORWARD, palm, power=2.6), 0.0)]
    for across, length in ((0.031, 0.95), (0.010, 1.05), (-0.011, 1.0), (-0.031, 0.8)):
        knuckle = place(0.098, across, 0.002)
        middle = place(0.098 + 0.038 * length, across, 0.016)
        tip = place(0.098 + 0.050 * length, across, 0.016 + 0.032 * length)
        parts += [
            (Capsule(knuckle, middle, 0.0105 * scale, 0.0100 * scale), 0.006),
            (Capsule(middle, tip, 0.0100 * scale, 0.0085 * scale), 0.003),
        ]
    base, bend, tip = place(0.03, 0.028, 0.010), place(0.075, 0.050, 0.024), place(0.108, 0.046, 0.036)
    parts.append((Capsule(base, bend, 0.016 * scale, 0.0125 * scale), 0.012))
    parts.append((Capsule(bend, tip, 0.0125 * scale, 0.0095 * scale), 0.003))
    return Solid(tuple(parts))


def _foot(ankle: Floats, scale: float) -> Solid:
    """A boot with a toe cap; its lowest 3 cm are the sole."""
    heel = np.array([ankle[0] - 0.092 * scale, ankle[1], 0.0])
    profile = scale * np.array([  # radii: "front" is up, "back" is down into the floor, where it is cut
        (0.0, 0.075, 0.04, 0.034), (0.05, 0.098, 0.04, 0.040), (0.11, 0.100, 0.04, 0.040), (0.16, 0.074, 0.04, 0.045),
        (0.21, 0.066, 0.04, 0.050), (0.26, 0.061, 0.04, 0.048), (0.298, 0.046, 0.04, 0.034),
    ])  # fmt: skip
    shaft = scale * np.array([(-0.04, 0.056, 0.056, 0.048), (0.10, 0.056, 0.058, 0.052), (0.16, 0.058, 0.062, 0.056)])
    parts = ((Loft(heel, FORWARD, UP, profile, power=2.6), 0.0), (Loft(ankle, UP, FORWARD, shaft), 0.03))
    return Solid(parts, cuts=((-UP, 0.0),))
