"""Frame sets from a capture on disk: videos or image folders, at one rig time.

Cameras of the capture are found for those of the rig by name, else by the unique integer at the end of it. Encoded
frames are handed on beside the decoded ones wherever they can be recorded as they are: JPEG and PNG files, and H.264
without reordered frames (a viewer shows Annex B access units one by one, so B-frames cannot be copied).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import av
import av.error
import numpy as np
from av.bitstream import BitStreamFilterContext
from numpy.typing import NDArray

from recognition.errors import SourceError
from recognition.observations import FrameSet, ViewFrame
from rigcal.captures import Capture, CaptureCamera, open_capture, read_image
from rigcal.errors import BrokenFileError
from rigcal.geometry import Floats
from rigcal.instants import find_instants
from rigcal.rig import Rig
from rigcal.stamps import match_camera_id

_STILL = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png"}


@dataclass(frozen=True, slots=True)
class CaptureSource:
    """A capture, seen from a rig."""

    capture: Capture
    cameras: tuple[CaptureCamera | None, ...]
    """(V,) the capture's camera for each of the rig's; None for a camera that is left out."""
    frame_idx: tuple[tuple[int, ...], ...]
    """(I, V) index of each camera's frame at each instant, -1 where it has none."""
    t_ns: tuple[int, ...]
    """(I,) rig time of each instant in nanoseconds, strictly ascending."""
    rule: str
    """How the instants were found."""
    spread_s: float
    """Greatest time difference within an instant."""

    def frame_sets(self) -> Iterator[FrameSet]:
        """Every instant in order, decoded.

        Raises:
            BrokenFileError: where a file cannot be decoded.
        """
        readers = [_Reader(camera) if camera else None for camera in self.cameras]
        for index, (row, t_ns) in enumerate(zip(self.frame_idx, self.t_ns, strict=True)):
            views = tuple(
                reader.frame(frame, t_ns) if reader and frame >= 0 else None
                for reader, frame in zip(readers, row, strict=True)
            )
            yield FrameSet(index, t_ns, views)


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
    clocks = {match: camera.clock for match, camera in zip(matches, rig.cameras, strict=True) if match}
    instants = find_instants(capture, clocks)
    columns = [ids.index(match) if match and wanted else -1 for match, wanted in zip(matches, use, strict=True)]
    padded = np.column_stack([instants.frame_idx, np.full(len(instants.frame_idx), -1)])
    frame_idx = padded[:, columns]
    held = (frame_idx >= 0).any(axis=1)
    t_s = _seconds(instants.t_s, frame_idx, cameras, instants.rule, fps)
    t_ns = np.rint(t_s[held] * 1e9).astype(np.int64)
    if (np.diff(t_ns) <= 0).any():
        raise SourceError(
            "two instants of the capture have the same time",
            where=path,
            expected="frames at different times",
            got=f"rule {instants.rule}",
            do_next="check timestamps.csv and the file names for repeated times",
        )
    spread_s = float(instants.spread_s.max(initial=0.0))
    rows = tuple(tuple(row) for row in frame_idx[held].tolist())
    return CaptureSource(capture, cameras, rows, tuple(t_ns.tolist()), instants.rule, spread_s)


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


def _seconds(
    t_s: Floats, frame_idx: NDArray[np.int64], cameras: Sequence[CaptureCamera | None], rule: str, fps: float
) -> Floats:
    """Times of the instants: as grouped, else the presentation time of the first video, else frame number / fps."""
    if rule not in ("frame numbers", "none"):
        return t_s
    for column, camera in enumerate(cameras):
        if camera is not None and camera.times_s and (frame_idx[:, column] >= 0).all():
            return np.array([camera.times_s[frame] for frame in frame_idx[:, column]])
    rate = next((camera.fps for camera in cameras if camera and camera.fps), fps)
    return t_s / rate


class _Frame(NamedTuple):
    frame_idx: int
    image_bgr: NDArray[np.uint8]
    encoded: bytes | None = None
    encoding: str = ""


class _Reader:
    """One camera's frames, in any order that does not go far back."""

    def __init__(self, camera: CaptureCamera) -> None:
        self._frames = _video(camera) if camera.kind == "video" else _stills(camera)
        self._waiting: dict[int, _Frame] = {}

    def frame(self, frame_idx: int, t_ns: int) -> ViewFrame:
        while frame_idx not in self._waiting:
            read = next(self._frames)
            self._waiting[read.frame_idx] = read
        found = self._waiting.pop(frame_idx)
        return ViewFrame(frame_idx, t_ns, found.image_bgr, found.encoded, found.encoding)


def _stills(camera: CaptureCamera) -> Iterator[_Frame]:
    for index, path in enumerate(camera.paths):
        encoding = _STILL.get(path.suffix.lower(), "")
        image = read_image(camera, path, colour=True)
        yield _Frame(index, image, path.read_bytes() if encoding else None, encoding)


def _video(camera: CaptureCamera) -> Iterator[_Frame]:
    path, count = camera.paths[0], 0
    try:
        copied = _can_be_copied(path)
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            to_annex_b = BitStreamFilterContext("h264_mp4toannexb", stream) if copied else None
            encoded: deque[bytes] = deque()
            for packet in container.demux(stream):
                has_content = packet.size > 0
                frames = packet.decode()  # before the filter, which takes the packet's content away
                if to_annex_b and has_content:
                    encoded.extend(bytes(filtered) for filtered in to_annex_b.filter(packet))
                for frame in frames:
                    image = np.asarray(frame.to_ndarray(format="bgr24"), dtype=np.uint8)
                    yield _Frame(count, image, encoded.popleft(), "h264") if copied else _Frame(count, image)
                    count += 1
    except av.error.FFmpegError as error:
        raise BrokenFileError(path, expected=f"{len(camera.frames)} frames", got=f"{count} frames, {error}") from error
    if count != len(camera.frames):
        raise BrokenFileError(path, expected=f"{len(camera.frames)} frames", got=f"{count} frames")


def _can_be_copied(path: Path) -> bool:
    """Whether a video is H.264 whose frames are stored in the order in which they are shown."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        if stream.codec_context.name != "h264":
            return False
        shown = [packet.pts for packet in container.demux(stream) if packet.size]
    known = [pts for pts in shown if pts is not None]
    return len(known) == len(shown) and all(a < b for a, b in pairwise(known))
