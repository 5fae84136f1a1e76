"""What options mean that several commands have: cameras, networks, frame rate, poses to write."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from recognition.errors import RecordingError, RigRefusedError
from rigcal.errors import writing

if TYPE_CHECKING:
    from recognition.detectors import Detector
    from recognition.observations import Scene
    from rigcal.rig import Rig
    from rigcal.rigdocument import RigDocument
    from rigcal.site import Site

DEFAULT_FPS = 30.0
"""Frame rate of image folders and detections that hold no times, where --fps and the rig file say nothing."""


class AssociationMethod(StrEnum):
    """How detections become tracks."""

    paper = "paper"
    tracked = "tracked"


def declared_fps(document: RigDocument, site: Site | None) -> float | None:
    """The frame rate that the rig file tells, or the highest of the site file's."""
    known = document.extensions.get("rigcal")
    declared = known.get("fps") if isinstance(known, dict) else None
    if isinstance(declared, (int, float)):
        return float(declared)
    return max((camera.fps for camera in site.cameras if camera.fps), default=None) if site else None


def require_runnable(path: Path, rig: Rig) -> None:
    """Refuse a rig whose gates failed.

    Raises:
        RigRefusedError: where the verdict is RECAPTURE.
    """
    if rig.verdict == "RECAPTURE":
        raise RigRefusedError(
            "this rig file failed its gates, and positions computed with it would be wrong",
            where=path,
            expected="verdict PASS or IMPORTED",
            got=f"verdict {rig.verdict}",
            do_next=f"see what to capture again: rigcal validate {path}",
        )


def require_output(path: Path, *, is_live: bool) -> None:
    """Refuse at the start of a run what would be found out at its end.

    Raises:
        RecordingError: where the recording to be is a folder, or one of live cameras that is there already.
    """
    if path.is_dir():
        raise RecordingError(
            "a folder has the name that the recording is to have",
            where=path,
            expected="the name of a file",
            got="a folder",
            do_next=f"give -o {path / 'NAME.mcap'}",
        )
    if is_live and path.exists():
        raise RecordingError(
            "a recording of this name is there already",
            where=path,
            expected="no such file, as what live cameras showed cannot be recorded again",
            got=f"{path.stat().st_size / 1e6:.1f} MB",
            do_next="give another name with -o, or move it away: nothing is overwritten",
        )


def used_cameras(rig: Rig, views: str | None) -> tuple[bool, ...]:
    """(V,) which cameras are wanted."""
    if views is None:
        return (True,) * len(rig.cameras)
    wanted = [name.strip() for name in views.split(",") if name.strip()]
    unknown = [name for name in wanted if name not in rig.camera_ids]
    if unknown or not wanted:
        raise RigRefusedError(
            f"the rig has no camera {', '.join(unknown) or '(none given)'}",
            where="--views",
            expected=f"some of {','.join(rig.camera_ids)}",
            got=repr(views),
            do_next="name cameras as the rig file does, with commas between them",
        )
    return tuple(camera_id in wanted for camera_id in rig.camera_ids)


def detector_of(object_model: Path | None, pose_model: Path | None, *, needed: bool) -> Detector | None:
    """The networks that are wanted, bundled where none is named; None where they are not needed."""
    if not needed:
        return None
    from recognition.detectors import load_bundled, load_detector

    if object_model is not None and pose_model is not None:
        return load_detector(object_model, pose_model)
    bundled = load_bundled()
    if object_model is None and pose_model is None:
        return bundled
    return load_detector(object_model, pose_model, rest=bundled)


def write_poses_of(scenes: Sequence[Scene], rig: Rig, path: Path) -> None:
    """Write the workers' joints of a run."""
    from recognition.poses import Poses, write_poses

    with writing(path):
        write_poses(Poses.of(scenes, rig.world_from_rig), path)
