"""The frames of one camera of a capture, decoded, and encoded beside it wherever they can be recorded as they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from recognition.errors import BrokenFrameError
from recognition.observations import ViewFrame
from recognition.sources.files import untimed
from rigcal.captures import CaptureCamera, read_image
from rigcal.errors import BrokenFileError


class FrameReader:
    """One camera's frames, in any order that does not go far back."""

    def __init__(self, camera: CaptureCamera) -> None:
        self._frames = _video(camera) if camera.kind == "video" else _stills(camera)
        self._waiting: dict[int, ViewFrame] = {}

    def frame(self, frame_idx: int, t_ns: int) -> ViewFrame:
        """The frame of that index, taken at a rig time; each can be asked for once.

        Raises:
            BrokenFileError: where the file cannot be decoded so far.
            ImageSizeError: where an image has another size than the camera's first.
        """
        while frame_idx not in self._waiting:
            read = next(self._frames)
            self._waiting[read.frame_idx] = read
        return replace(self._waiting.pop(frame_idx), t_ns=t_ns)


def _stills(camera: CaptureCamera) -> Iterator[ViewFrame]:
    for packet, path in zip(untimed(camera).packets(), camera.paths, strict=True):
        encoded, encoding = packet.to_record
        yield ViewFrame(packet.number, packet.t_ns, read_image(camera, path, colour=True), encoded, encoding)


def _video(camera: CaptureCamera) -> Iterator[ViewFrame]:
    stream, count = untimed(camera), 0
    decoder = stream.decoder(is_quick=False)
    try:
        for packet in stream.packets():
            for frame in decoder.decode(packet):
                yield frame.view()
                count += 1
        for frame in decoder.flush():
            yield frame.view()
            count += 1
    except BrokenFrameError as error:
        got = f"{count} frames, {error.got}"
        raise BrokenFileError(camera.paths[0], expected=f"{len(camera.frames)} frames", got=got) from error
    if count != len(camera.frames):
        raise BrokenFileError(camera.paths[0], expected=f"{len(camera.frames)} frames", got=f"{count} frames")
