"""The video or the images of one camera of a capture as packets: as they are stored, nothing is decoded.

H.264 whose frames are stored in the order in which they are shown, JPEG and PNG files can be recorded as they are. A
viewer shows Annex B access units one by one, so that B-frames cannot be copied.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import av
import av.error
import numpy as np
from av.bitstream import BitStreamFilterContext

from recognition.sources.decoding import Decoder
from recognition.sources.stream import Packet
from rigcal.captures import CaptureCamera
from rigcal.errors import BrokenFileError
from rigcal.geometry import Ints

_ENCODING = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png", ".bmp": "bmp", ".tif": "tiff", ".tiff": "tiff"}
_RECORDABLE = ("jpeg", "png")


@dataclass(frozen=True, slots=True)
class _VideoForm:
    """How a video is stored."""

    codec: str
    extradata: bytes | None
    rank: dict[int, int] | None
    """Number of the frame by its presentation time; None where packets do not say it, but come in order of storage."""
    in_order: bool
    """Whether frames are stored in the order in which they are shown."""

    @property
    def is_h264(self) -> bool:
        return self.codec == "h264"


class FileStream:
    """One camera of a capture; see :class:`recognition.sources.stream.Stream`.

    Args:
        camera: Index of the camera in the rig.
        found: The camera of the capture.
        times_ns: (F,) capture time of each of its frames, rig time in nanoseconds.
    """

    def __init__(self, camera: int, found: CaptureCamera, times_ns: Ints) -> None:
        if len(times_ns) != len(found.frames):
            raise ValueError(f"{len(times_ns)} times for {len(found.frames)} frames")
        self._camera, self._found, self._times_ns = camera, found, times_ns.tolist()
        self._closing = threading.Event()
        self._form: _VideoForm | None = None

    @property
    def camera(self) -> int:
        """Index of the camera in the rig."""
        return self._camera

    def packets(self) -> Iterator[Packet]:
        """Packets in the order in which the frames are stored.

        Raises:
            BrokenFileError: where the file cannot be read, or holds fewer frames or more than it was said to.
        """
        packets = self._video() if self._found.kind == "video" else self._stills()
        for packet in packets:
            if self._closing.is_set():
                return
            yield packet

    def decoder(self, *, is_quick: bool = True) -> Decoder:
        """A decoder for these packets; ``is_quick`` as :class:`Decoder` has it.

        Raises:
            BrokenFileError: where the file cannot be read.
        """
        found = self._found
        if found.kind == "images":
            return Decoder(found.id, found.size_wh)
        form = self._video_form()
        return Decoder(
            found.id,
            found.size_wh,
            extradata=None if form.is_h264 else form.extradata,
            is_numbered=form.rank is not None,
            is_quick=is_quick,
        )

    def close(self) -> None:
        """End :meth:`packets` at the next one."""
        self._closing.set()

    def _stills(self) -> Iterator[Packet]:
        for number, path in enumerate(self._found.paths):
            encoding = _ENCODING[path.suffix.lower()]
            yield self._packet(number, path.read_bytes(), encoding, is_key=True, recordable=encoding in _RECORDABLE)

    def _video(self) -> Iterator[Packet]:
        path, total, count = self._found.paths[0], len(self._found.frames), 0
        form = self._video_form()
        recordable = form.is_h264 and form.in_order
        try:
            with av.open(str(path)) as container:
                stream = container.streams.video[0]
                to_annex_b = BitStreamFilterContext("h264_mp4toannexb", stream) if form.is_h264 else None
                for stored in container.demux(stream):
                    if not stored.size:
                        continue
                    number = count if form.rank is None or stored.pts is None else form.rank[stored.pts]
                    is_key = stored.is_keyframe
                    content = b"".join(map(bytes, to_annex_b.filter(stored))) if to_annex_b else bytes(stored)
                    count += 1
                    if count <= total:
                        yield self._packet(number, content, form.codec, is_key=is_key, recordable=recordable)
        except av.error.FFmpegError as error:
            raise BrokenFileError(path, expected=f"{total} frames", got=f"{count} frames, {error}") from error
        if count != total:
            raise BrokenFileError(path, expected=f"{total} frames", got=f"{count} frames")

    def _packet(self, number: int, content: bytes, encoding: str, *, is_key: bool, recordable: bool) -> Packet:
        return Packet(self._camera, number, self._times_ns[number], None, content, encoding, is_key, recordable)

    def _video_form(self) -> _VideoForm:
        if self._form is None:
            self._form = _read_form(self._found)
        return self._form


def untimed(found: CaptureCamera) -> FileStream:
    """The frames of a camera whose times are kept elsewhere: each has time 0."""
    return FileStream(0, found, np.zeros(len(found.frames), dtype=np.int64))


def _read_form(found: CaptureCamera) -> _VideoForm:
    path = found.paths[0]
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            stored = [packet.pts for packet in container.demux(stream) if packet.size]
            codec, extradata = stream.codec_context.name, stream.codec_context.extradata
            by_storage = container.format.name == "avi"  # knows one time of a frame: that of its decoding
            is_reordered = stream.codec_context.has_b_frames
    except av.error.FFmpegError as error:
        raise BrokenFileError(path, expected=f"{len(found.frames)} frames", got=str(error)) from error
    known = [pts for pts in stored if pts is not None]
    if by_storage or len(set(known)) != len(stored):
        return _VideoForm(codec, extradata, None, in_order=by_storage and not is_reordered)
    rank = {pts: number for number, pts in enumerate(sorted(known))}
    return _VideoForm(codec, extradata, rank, in_order=all(a < b for a, b in pairwise(known)))
