"""A tree of named frames, as ROS's tf and Foxglove have it: each child's pose in its parent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rigcal.formats._entries import Entry
from rigcal.geometry import Pose
from rigcal.rig import Rig

WORLD_FRAME = "world"
RIG_FRAME = "rig"


def common_frame_id(rig: Rig) -> str:
    """The name of the frame that the cameras hang on: ``world`` where the rig has one, else ``rig``."""
    return RIG_FRAME if rig.world_from_rig is None else WORLD_FRAME


def transform_entry(parent_id: Entry, child_id: Entry, transform: Entry) -> tuple[str, tuple[str, Pose]]:
    """The child, and its parent with ``parent_from_child``, from tf's translation x y z and rotation x y z w."""
    translation, rotation = transform["translation"], transform["rotation"]
    xyzw = Entry(rotation.file, rotation.name, [rotation[axis].number() for axis in "xyzw"]).quaternion()
    pose = Pose.from_quat_wxyz(xyzw[[3, 0, 1, 2]], [translation[axis].number() for axis in "xyz"])
    return child_id.text(), (parent_id.text(), pose)


@dataclass(frozen=True, slots=True)
class FrameTree:
    """Frames that hang on other frames."""

    transforms: Entry
    """Where they stand, for errors to name."""
    parent_from_child: Mapping[str, tuple[str, Pose]]
    """By the child's name: its parent's name, and the transform."""

    def __contains__(self, frame_id: str) -> bool:
        return frame_id in self.parent_from_child or any(p == frame_id for p, _ in self.parent_from_child.values())

    def root_from(self, frame_id: str) -> tuple[str, Pose]:
        """The root that a frame hangs on, and the transform to it.

        Raises:
            FormatError: where the frames form a ring.
        """
        root_from_frame, seen = Pose.identity(), {frame_id}
        while frame_id in self.parent_from_child:
            frame_id, parent_from_frame = self.parent_from_child[frame_id]
            if frame_id in seen:
                raise self.transforms.error("a tree of frames", f"a ring through {frame_id}")
            seen.add(frame_id)
            root_from_frame = parent_from_frame @ root_from_frame
        return frame_id, root_from_frame

    def cams_from_root(self, frame_ids: Sequence[tuple[str, str]]) -> list[Pose]:
        """Poses of cameras from their one root; a single camera needs no transform.

        Args:
            frame_ids: the name and the frame of each camera.

        Raises:
            FormatError: where a camera's frame is absent, or the cameras hang on several roots.
        """
        absent = [frame_id for _, frame_id in frame_ids if frame_id not in self]
        if absent and len(frame_ids) == 1:
            return [Pose.identity()]
        if absent:
            raise self.transforms.error("a transform for every camera's frame", "none for " + ", ".join(absent))
        placed = [(camera_id, *self.root_from(frame_id)) for camera_id, frame_id in frame_ids]
        roots = {root: camera_id for camera_id, root, _ in placed}
        if len(roots) > 1:
            named = ", ".join(f"{camera_id} on {root}" for root, camera_id in roots.items())
            raise self.transforms.error("every camera on one root frame", named)
        return [root_from_cam.inverse() for _, _, root_from_cam in placed]
