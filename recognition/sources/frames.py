"""The frames of one camera of a capture, decoded, and encoded beside it wherever they can be recorded as they are.

That is: JPEG and PNG files, and H.264 without reordered frames (a viewer shows Annex B access units one by one, so
that B-frames cannot be copied).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import av
import av.error
import numpy as np
from av.bitstream import BitStreamFilterContext
from numpy.typing import NDArray

from recognition.observations import ViewFrame
from rigcal.captures import CaptureCamera, read_image
from rigcal.errors import BrokenFileError

_STILL = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png"}


class _Frame(NamedTuple):
    frame_idx: int
    image_bgr: NDArray[np.uint8]
    encoded: bytes | None = None
    encoding: str = ""


class FrameReader:
    """One camera's frames, in any order that does not go far back."""

    def __init__(self, camera: CaptureCamera) -> None:
        self._frames = _video(camera) if camera.kind == "video" else _stills(camera)
        self._waiting: dict[int, _Frame] = {}

    def frame(self, frame_idx: int, t_ns: int) -> ViewFrame:
        """The frame of that index, taken at a rig time; each can be asked for once."""
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
