"""Rotations and two-bone limbs.

A limb is two bones with a hinge between them (elbow, knee). Where its end shall be and where the hinge points to fix
it; the hinge then bends one way only, because the direction in which the lower bone folds is taken from the hinge.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

EXACT_REACH = 0.97
"""Part of a limb's length up to which it reaches exactly; a soft limit yields from there, so that it never snaps."""
_FULL = 0.9995
"""Part of a limb's length that it reaches at the most; straighter, the hinge would have no direction."""
_FOLDED_RAD = math.radians(28.0)
"""Angle between the two bones when a limb is folded as far as it goes."""


def yaw_matrix(yaw_rad: float) -> Floats:
    """(3, 3) rotation about the world's z."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turn(yaw_rad: float, pitch_rad: float, roll_rad: float) -> Floats:
    """(3, 3) rotation: ``roll`` about x (towards the right), then ``pitch`` about y (forward), then ``yaw`` about z."""
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def about(axis: Floats, angle_rad: float) -> Floats:
    """(3, 3) rotation about a unit vector (Rodrigues)."""
    x, y, z = axis.tolist()
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    k = 1.0 - c
    return np.array(
        [
            [c + x * x * k, x * y * k - z * s, x * z * k + y * s],
            [y * x * k + z * s, c + y * y * k, y * z * k - x * s],
            [z * x * k - y * s, z * y * k + x * s, c + z * z * k],
        ]
    )


def rotation_vector(rotation: Floats) -> Floats:
    """(3,) axis times angle of a rotation of less than half a turn."""
    r = rotation
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine = math.sqrt(float(axis @ axis))
    if sine < 1e-12:
        return np.zeros(3)
    return axis * (math.atan2(sine, float(r[0, 0] + r[1, 1] + r[2, 2]) - 1.0) / sine)


def turned_by(vector: Floats) -> Floats:
    """(3, 3) the rotation of a rotation vector."""
    angle = math.sqrt(float(vector @ vector))
    return np.eye(3) if angle < 1e-12 else about(vector / angle, angle)


def between(first: Floats, second: Floats, share: float) -> Floats:
    """(3, 3) the rotation at ``share`` of the way from one rotation to another, less than half a turn apart."""
    return first @ turned_by(share * rotation_vector(first.T @ second))


def wrapped(angle_rad: float) -> float:
    """The angle within half a turn of zero."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def smooth(share: float) -> float:
    """0 to 1 with level ends, of a share that is clipped to 0 to 1."""
    s = min(max(share, 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


def unit(vector: Floats) -> Floats:
    """The vector at length one."""
    return vector / math.sqrt(float(vector @ vector))


def cross(first: Floats, second: Floats) -> Floats:
    """(3,) vector product; ``numpy.cross`` takes more than ten times as long for one vector."""
    a, b, c = first.tolist()
    x, y, z = second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def _frame(direction: Floats, across: Floats, axis: Floats) -> Floats:
    """(3, 3) matrix of three columns."""
    return np.array([direction, across, axis]).T


def eased(distance_m: float, length_m: float) -> float:
    """The distance at which a limb of this length is held that reaches for something at a distance.

    The same up to ``EXACT_REACH`` of the length, from there less and less up to the whole length.
    """
    start, full = EXACT_REACH * length_m, _FULL * length_m
    if distance_m <= start:
        return distance_m
    return start + (full - start) * -math.expm1(-(distance_m - start) / (full - start))


def two_bone(root: Floats, target: Floats, lengths: tuple[float, float], pole: Floats) -> tuple[Floats, Floats, Floats]:
    """Hinge (3,), end (3,) and the unit vector (3,) to which the hinge points, of a limb that reaches for a target.

    Args:
        root: (3,) where the upper bone begins.
        target: (3,) where the end shall be; too far or too near it is approached along the line from the root.
        lengths: Metres of the upper and the lower bone.
        pole: (3,) rough direction of the hinge from the line root to end; must not lie along it.
    """
    upper, lower = lengths
    along = target - root
    distance = math.sqrt(float(along @ along)) + 1e-12
    along = along / distance
    full = (upper + lower) * _FULL
    near = math.sqrt(upper**2 + lower**2 - 2 * upper * lower * math.cos(_FOLDED_RAD))
    distance = min(max(distance, near), full)
    side = pole - float(pole @ along) * along
    side = unit(side)
    foot = (upper**2 - lower**2 + distance**2) / (2 * distance)
    height = math.sqrt(max(upper**2 - foot**2, 0.0))
    return root + foot * along + height * side, root + distance * along, side


def limb_rotations(
    rest_direction: Floats, rest_fold: Floats, points: tuple[Floats, Floats, Floats], side: Floats
) -> tuple[Floats, Floats]:
    """Rotations (3, 3) of the upper and the lower bone.

    Args:
        rest_direction: (3,) unit vector along the straight limb at rest.
        rest_fold: (3,) unit vector across it, to where the lower bone folds.
        points: Root, hinge and end, each (3,).
        side: (3,) the unit vector to which the hinge points, as of :func:`two_bone`.
    """
    root, hinge, end = points
    rest = _frame(rest_direction, rest_fold, cross(rest_direction, rest_fold))
    axis = unit(cross(side, end - root))
    rotations = []
    for start, stop in ((root, hinge), (hinge, end)):
        direction = unit(stop - start)
        rotations.append(_frame(direction, cross(axis, direction), axis) @ rest.T)
    return rotations[0], rotations[1]
