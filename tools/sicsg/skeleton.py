"""A worker's bones and joints.

Rest pose: standing upright on the floor, facing +x, left is +y, z up, arms hanging ``REST_ARM_RAD`` away from the
vertical, palms towards the body. All bones have the world's axes at rest, so that a pose is a rotation per bone:
``p_world = R_bone (p_rest - joint_rest) + joint_posed``. The 17 joints are COCO's, in its order; those of the limbs are
the joints of bones, the face's are fixed in the bone ``head``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.assets import asset_rng

Floats = NDArray[np.float64]

BONES = (
    "pelvis", "spine", "chest", "neck", "head",
    "left_upper_arm", "left_forearm", "left_hand", "right_upper_arm", "right_forearm", "right_hand",
    "left_thigh", "left_shin", "left_foot", "right_thigh", "right_shin", "right_foot",
)  # fmt: skip
"""Names of the bones, parents before children; ``left_hand`` turns about the wrist, ``left_foot`` about the ankle."""
PARENT = (-1, 0, 1, 2, 3, 2, 5, 6, 2, 8, 9, 0, 11, 12, 0, 14, 15)
"""Index of each bone's parent."""
REST_ARM_RAD = np.deg2rad(35.0)
JOINTS = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle",
    "right_ankle",
)  # fmt: skip
_BONE_OF_JOINT = {
    **dict.fromkeys(("nose", "left_eye", "right_eye", "left_ear", "right_ear"), "head"),
    "left_shoulder": "left_upper_arm", "right_shoulder": "right_upper_arm",
    "left_elbow": "left_forearm", "right_elbow": "right_forearm",
    "left_wrist": "left_hand", "right_wrist": "right_hand",
    "left_hip": "left_thigh", "right_hip": "right_thigh",
    "left_knee": "left_shin", "right_knee": "right_shin",
    "left_ankle": "left_foot", "right_ankle": "right_foot",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Body:
    """Proportions of a worker; from an asset's name by :func:`body`."""

    height_m: float
    girth: float
    """Thickness of torso and limbs relative to the average, .85 to 1.3."""
    shoulders: float
    """Width of the shoulders relative to the average, .9 to 1.12."""
    legs: float
    """Length of the legs relative to the average, .95 to 1.05; the torso makes up for it."""
    arms: float
    """Length of the arms relative to the average, .95 to 1.05."""
    female: bool


def body(name: str) -> Body:
    """The body of this asset name."""
    rng = asset_rng("body", name)
    female = bool(rng.random() < 0.3)
    height = float(np.clip(rng.normal(1.66 if female else 1.77, 0.065), 1.50, 1.98))
    girth, shoulders = (
        float(np.clip(rng.normal(1.02, 0.09), 0.85, 1.3)),
        float(np.clip(rng.normal(1.0, 0.045), 0.9, 1.12)),
    )
    legs, arms = (float(np.clip(rng.normal(1.0, 0.02), 0.95, 1.05)) for _ in range(2))
    return Body(height, girth, shoulders * (0.94 if female else 1.0), legs, arms, female)


def rest_joints(body: Body) -> Floats:
    """(B, 3) where each bone of the rest pose turns, metres; the soles (with boots) are at z = 0.

    Segment lengths follow Winter, Biomechanics and Motor Control of Human Movement, table 4.1 and figure 4.1
    (fractions of the body height), shared out by ``legs`` and ``arms``.
    """
    h = body.height_m
    ankle, knee, hip = 0.045 * h, 0.285 * h, 0.53 * h
    knee, hip = ankle + (knee - ankle) * body.legs, ankle + (hip - ankle) * body.legs
    shoulder, neck, head = 0.818 * h, 0.85 * h, 0.895 * h
    half_hip, half_shoulder = 0.050 * h, 0.112 * h * body.shoulders
    upper, fore = 0.172 * h * body.arms, 0.150 * h * body.arms
    side, down = np.sin(REST_ARM_RAD), np.cos(REST_ARM_RAD)
    points = {
        "pelvis": (0, 0, hip + 0.02 * h), "spine": (-0.005, 0, hip + 0.09 * h), "chest": (-0.005, 0, hip + 0.17 * h),
        "neck": (-0.01, 0, neck), "head": (0.0, 0, head),
    }  # fmt: skip
    for name, sign in (("left", 1.0), ("right", -1.0)):
        y = sign * half_shoulder
        points[f"{name}_upper_arm"] = (0, y, shoulder)
        points[f"{name}_forearm"] = (0, y + sign * upper * side, shoulder - upper * down)
        points[f"{name}_hand"] = (0, y + sign * (upper + fore) * side, shoulder - (upper + fore) * down)
        points[f"{name}_thigh"] = (0, sign * half_hip, hip)
        points[f"{name}_shin"] = (0, sign * half_hip, knee)
        points[f"{name}_foot"] = (-0.01, sign * half_hip, ankle)
    return np.array([points[name] for name in BONES], dtype=np.float64)


def rest_coco(body: Body) -> Floats:
    """(17, 3) the COCO joints of the rest pose."""
    bones = rest_joints(body)
    h, (x, _, z) = body.height_m, bones[BONES.index("head")]
    face = {
        "nose": (x + 0.062 * h, 0.0, z + 0.028 * h), "left_eye": (x + 0.052 * h, 0.018 * h, z + 0.046 * h),
        "right_eye": (x + 0.052 * h, -0.018 * h, z + 0.046 * h), "left_ear": (x + 0.0, 0.043 * h, z + 0.036 * h),
        "right_ear": (x + 0.0, -0.043 * h, z + 0.036 * h),
    }  # fmt: skip
    return np.array([face[j] if j in face else bones[BONES.index(_BONE_OF_JOINT[j])] for j in JOINTS], dtype=np.float64)


def crown(body: Body) -> Floats:
    """(3,) the top of the head at rest, where a hard hat's origin lies when it is worn."""
    x, _, z = rest_joints(body)[BONES.index("head")]
    return np.array([x, 0.0, z + 0.105 * body.height_m])


def bone_matrices(joints_posed_m: Floats, rotations: Floats, joints_rest_m: Floats) -> Floats:
    """(B, 4, 4) ``world_from_rest`` of each bone, from where its joint is (B, 3) and its rotation (B, 3, 3)."""
    matrices = np.tile(np.eye(4), (len(BONES), 1, 1))
    matrices[:, :3, :3] = rotations
    matrices[:, :3, 3] = joints_posed_m - np.einsum("bij,bj->bi", rotations, joints_rest_m)
    return matrices


def coco_joints(body: Body, bones: Floats) -> Floats:
    """(17, 3) COCO joints in the world, of bone matrices (B, 4, 4) as :func:`bone_matrices` gives them."""
    rest = rest_coco(body)
    owner = [BONES.index(_BONE_OF_JOINT[joint]) for joint in JOINTS]
    chosen = bones[owner]
    return np.einsum("jab,jb->ja", chosen[:, :3, :3], rest) + chosen[:, :3, 3]
