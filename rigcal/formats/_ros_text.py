"""Where cameras are, as ROS has it: transforms, a launch file that publishes them, and a URDF.

Each takes the parent frame's name and ``parent_from_cam`` by camera. In the URDF each camera has a ``_link`` with x
forward, y left, z up, as REP 103 wants of a body, and below it the optical frame, turned by rpy (-pi/2, 0, -pi/2).
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from rigcal.formats._yaml import number_text, quoted
from rigcal.geometry import Floats, Pose

OPTICAL = "_optical_frame"
_LINK = "_link"
_LINK_FROM_OPTICAL = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""Exactly rpy (-pi/2, 0, -pi/2): the camera's z is the link's x, its x the link's -y, its y the link's -z."""
_LAUNCH = '''"""Static transforms of a calibrated camera rig, written by rigcal: run with ros2 launch FILE."""

from launch import LaunchDescription
from launch_ros.actions import Node

PARENT = {parent!r}
CHILDREN = {{  # frame: (x, y, z in metres), (quaternion x, y, z, w); they map points of the child into the parent
{children}}}
NAMES = ("--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw")


def publisher(child, values):
    """A node that publishes one transform."""
    numbers = [text for name, value in zip(NAMES, values) for text in (name, repr(value))]
    arguments = [*numbers, "--frame-id", PARENT, "--child-frame-id", child]
    return Node(package="tf2_ros", executable="static_transform_publisher", arguments=arguments)


def generate_launch_description():
    """One publisher for each camera."""
    return LaunchDescription([publisher(child, (*xyz, *xyzw)) for child, (xyz, xyzw) in CHILDREN.items()])
'''


def tf_static_text(parent_id: str, parent_from_cams: Mapping[str, Pose]) -> str:
    """A ``tf2_msgs/TFMessage`` in YAML."""
    return "transforms:\n" + "".join(_stamped(parent_id, name, pose) for name, pose in parent_from_cams.items())


def _stamped(parent_id: str, camera_id: str, parent_from_cam: Pose) -> str:
    xyz, xyzw = _xyz_and_xyzw(parent_from_cam)
    translation = "".join(f"      {axis}: {number_text(value)}\n" for axis, value in zip("xyz", xyz, strict=True))
    rotation = "".join(f"      {axis}: {number_text(value)}\n" for axis, value in zip("xyzw", xyzw, strict=True))
    return (
        "- header:\n    stamp:\n      sec: 0\n      nanosec: 0\n"
        f"    frame_id: {quoted(parent_id)}\n"
        f"  child_frame_id: {quoted(camera_id + OPTICAL)}\n"
        f"  transform:\n    translation:\n{translation}    rotation:\n{rotation}"
    )


def _xyz_and_xyzw(pose: Pose) -> tuple[tuple[float, ...], tuple[float, ...]]:
    w, *xyz = pose.quat_wxyz.tolist()
    return tuple(pose.translation_m.tolist()), (*xyz, w)


def launch_text(parent_id: str, parent_from_cams: Mapping[str, Pose]) -> str:
    """A ROS 2 launch file that publishes the transforms with ``tf2_ros``."""
    lines = [f"    {camera_id + OPTICAL!r}: {_xyz_and_xyzw(pose)!r},\n" for camera_id, pose in parent_from_cams.items()]
    return _LAUNCH.format(parent=parent_id, children="".join(lines))


def urdf_text(parent_id: str, parent_from_cams: Mapping[str, Pose]) -> str:
    """A URDF of fixed joints."""
    parts = [f'<?xml version="1.0"?>\n<robot name="camera_rig">\n  <link name={quoteattr(parent_id)}/>\n']
    for camera_id, parent_from_cam in parent_from_cams.items():
        link, optical = camera_id + _LINK, camera_id + OPTICAL
        parts += [f"  <link name={quoteattr(name)}/>\n" for name in (link, optical)]
        parts.append(_joint(parent_id, link, parent_from_cam @ _LINK_FROM_OPTICAL.inverse()))
        parts.append(_joint(link, optical, _LINK_FROM_OPTICAL))
    return "".join(parts) + "</robot>\n"


def _joint(parent_id: str, child_id: str, parent_from_child: Pose) -> str:
    xyz, rpy = (" ".join(map(repr, v.tolist())) for v in (parent_from_child.translation_m, _rpy_rad(parent_from_child)))
    return (
        f'  <joint name={quoteattr(child_id + "_joint")} type="fixed">\n'
        f"    <parent link={quoteattr(parent_id)}/>\n"
        f"    <child link={quoteattr(child_id)}/>\n"
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>\n'
        "  </joint>\n"
    )


def _rpy_rad(pose: Pose) -> Floats:
    """(3,) roll, pitch, yaw in radians about the fixed axes x, y, z: ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    The roll is taken from what yaw and pitch leave, so that nothing is lost where the pitch is near 90 degrees and yaw
    and roll cannot be told apart.
    """
    R = pose.rotation
    yaw, pitch = np.arctan2(R[1, 0], R[0, 0]), np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    rolled = Rotation.from_euler("ZY", [yaw, pitch]).as_matrix().T @ R
    return np.array([np.arctan2(rolled[2, 1], rolled[1, 1]), pitch, yaw])
