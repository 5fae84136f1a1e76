"""Frame sets from a capture on disk: videos or image folders, in rig time.

Cameras of the capture are found for those of the rig by name, else by the unique integer at the end of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recognition.errors import SourceError
from recognition.observations import FrameSet
from recognition.sources.files import FileStream
from recognition.sources.frames import FrameReader
from recognition.sources.synchrony import SyncReport, judge_synchrony
from recognition.sources.timing import Timing, capture_clocks, capture_timing
from rigcal.captures import CaptureCamera, open_capture
from rigcal.rig import Rig
from rigcal.stamps import match_camera_id


@dataclass(frozen=True, slots=True)
class CaptureSource:
    """A capture, seen from a rig."""

    cameras: tuple[CaptureCamera | None, ...]
    """(V,) the capture's camera for each of the rig's; None for a camera that is left out."""
    timing: Timing
    """Its instants."""
    sync: SyncReport
    """How its cameras kept time."""

    def frame_sets(self) -> Iterator[FrameSet]:
        """Every instant in order, decoded, with its number among those of the whole capture.

        Raises:
            BrokenFileError: where a file cannot be decoded.
        """
        readers = [FrameReader(camera) if camera else None for camera in self.cameras]
        rows = (self.timing.frame_idx.tolist(), self.timing.frame_t_ns.tolist())
        for number, t_ns, frames, times_ns in zip(
            self.timing.number.tolist(), self.timing.t_ns.tolist(), *rows, strict=True
        ):
            views = tuple(
                reader.frame(frame, own_ns) if reader and frame >= 0 else None
                for reader, frame, own_ns in zip(readers, frames, times_ns, strict=True)
            )
            yield FrameSet(number, t_ns, views)

    def streams(self) -> tuple[FileStream | None, ...]:
        """(V,) each camera as a stream of packets at the times of :attr:`timing`; None for one that is left out."""
        found = []
        for view, camera in enumerate(self.cameras):
            rows = self.timing.seen[:, view]
            times_ns = np.zeros(len(camera.frames) if camera else 0, dtype=np.int64)
            times_ns[self.timing.frame_idx[rows, view]] = self.timing.frame_t_ns[rows, view]
            found.append(FileStream(view, camera, times_ns) if camera else None)
        return tuple(found)


def open_source(path: Path, rig: Rig, *, use: Sequence[bool], fps: float) -> CaptureSource:
    """Open a capture for a rig.

    Args:
        path: Capture folder.
        rig: The rig; its clock models map camera time to rig time.
        use: (V,) which of the rig's cameras are wanted.
        fps: Frame rate of image folders whose names hold no times.

    Raises:
        SourceError: where a wanted camera is missing, a camera is not the rig's, or images have another size than
            the rig was calibrated for.
        CaptureError: where the capture itself is faulty.
    """
    capture = open_capture(path)
    ids = [camera.id for camera in capture.cameras]
    matches = [match_camera_id(camera.id, ids) for camera in rig.cameras]
    unknown = sorted(set(ids) - {match for match in matches if match})
    missing = [c.id for c, match, wanted in zip(rig.cameras, matches, use, strict=True) if wanted and match is None]
    if missing or unknown:
        raise SourceError(
            f"the capture lacks {', '.join(missing)}" if missing else f"the rig has no camera {', '.join(unknown)}",
            where=path,
            expected=f"cameras {', '.join(rig.camera_ids)}",
            got=f"cameras {', '.join(ids)}",
            do_next="name the videos or folders as the rig names its cameras; leave cameras out with --views",
        )
    cameras = tuple(
        capture.cameras[ids.index(match)] if match and wanted else None
        for match, wanted in zip(matches, use, strict=True)
    )
    _require_sizes(path, rig, cameras)
    models = {match: camera.clock for match, camera in zip(matches, rig.cameras, strict=True) if match}
    columns = [ids.index(match) if match and wanted else -1 for match, wanted in zip(matches, use, strict=True)]
    clocks = capture_clocks(capture, models)
    timing = capture_timing(capture, clocks, columns, fps=fps)
    return CaptureSource(cameras, timing, judge_synchrony(timing, clocks, columns, capture.cameras, rig))


def _require_sizes(path: Path, rig: Rig, cameras: Sequence[CaptureCamera | None]) -> None:
    for camera, found in zip(rig.cameras, cameras, strict=True):
        if found and found.size_wh != camera.camera.size_wh:
            width, height = camera.camera.size_wh
            raise SourceError(
                f"camera {camera.id} has images of another size than it was calibrated with",
                where=path / found.paths[0].name,
                expected=f"{width}x{height} px",
                got=f"{found.size_wh[0]}x{found.size_wh[1]} px",
                do_next="record at the calibrated resolution without cropping, calibrate at this one, or leave the "
                "camera out with --views",
            )
