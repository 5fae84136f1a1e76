"""From packets to frames; an image is made of a frame only when somebody asks for it.

Decoding a stream is cheap beside what looks at its frames, and cannot be left out, since every frame builds on the
last. The conversion to BGR can: a frame that is skipped costs none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import av
import av.error
import numpy as np
from av.video.codeccontext import VideoCodecContext
from numpy.typing import NDArray

from recognition.errors import BrokenFrameError, SourceError
from recognition.observations import ViewFrame
from recognition.sources.stream import Packet
from rigcal.captures import decode_image

_STILL = {"jpeg": ".jpg", "png": ".png", "bmp": ".bmp", "tiff": ".tif"}
"""Encodings of which each packet is an image by itself, and the suffixes of their files."""


@dataclass(frozen=True, slots=True, eq=False)
class DecodedFrame:
    """A frame, ready to be made an image of."""

    packet: Packet
    """The packet that it came in: camera, number, times, encoded bytes."""
    _picture: av.VideoFrame | None
    """None: the packet is an image by itself."""
    _camera_id: str
    _size_wh: tuple[int, int]

    def image_bgr(self) -> NDArray[np.uint8]:
        """(H, W, 3), made anew by each call.

        Raises:
            BrokenFrameError: where a still image cannot be decoded.
            SourceError: where it has another size than the camera.
        """
        if self._picture is not None:
            return np.asarray(self._picture.to_ndarray(format="bgr24"), dtype=np.uint8)
        try:
            image = decode_image(self.packet.encoded, _STILL[self.packet.encoding], colour=True)
        except ValueError as error:
            raise _broken(self._camera_id, self.packet, str(error)) from error
        _require_size(self._camera_id, self.packet, self._size_wh, (image.shape[1], image.shape[0]))
        return image

    def view(self) -> ViewFrame:
        """The frame with its image, and with its encoded bytes where they can be recorded as they are."""
        return ViewFrame(self.packet.number, self.packet.t_ns, self.image_bgr(), *self.packet.to_record)


class Decoder:
    """Decodes the packets of one camera, in one thread.

    Args:
        camera_id: The camera's name, for messages.
        size_wh: The size that its frames must have.
        extradata: What the codec keeps outside of its packets; H.264 in Annex B form keeps nothing there.
        is_numbered: Whether packets are numbered in the order of their times. Otherwise they are in the order in
            which they are stored, and frames, which come in that of their times, take the numbers in turn.
        is_quick: Give out each frame with its own packet, on one thread; otherwise some packets later, on all of the
            processors, which is for files that nobody waits for.
    """

    def __init__(
        self,
        camera_id: str,
        size_wh: tuple[int, int],
        *,
        extradata: bytes | None = None,
        is_numbered: bool = True,
        is_quick: bool = True,
    ) -> None:
        self._camera_id, self._size_wh, self._extradata = camera_id, size_wh, extradata
        self._is_numbered, self._is_quick = is_numbered, is_quick
        self._context: VideoCodecContext | None = None
        self._waiting: dict[int, Packet] = {}

    def decode(self, packet: Packet) -> list[DecodedFrame]:
        """The frames that a packet completes, in order of their numbers: one as a rule, none or more with B-frames.

        Raises:
            BrokenFrameError: where the packet is damaged; decoding goes on with the next one.
            SourceError: where a frame has another size than the camera, or its codec is not known.
        """
        if packet.encoding in _STILL:
            return [DecodedFrame(packet, None, self._camera_id, self._size_wh)]
        if self._context is None:
            self._context = self._created(packet)
        self._waiting[packet.number] = packet
        sent = av.Packet(packet.encoded)
        sent.pts = sent.dts = packet.number
        try:
            pictures = self._context.decode(sent)
        except av.error.FFmpegError as error:
            self._waiting.pop(packet.number)
            raise _broken(self._camera_id, packet, error.strerror or type(error).__name__) from error
        return list(self._frames(pictures))

    def flush(self) -> list[DecodedFrame]:
        """The frames that are left at the end of a file; nothing may be decoded afterwards."""
        return [] if self._context is None else list(self._frames(self._context.decode(None)))

    def _created(self, packet: Packet) -> VideoCodecContext:
        try:
            context = av.CodecContext.create(packet.encoding, "r")
        except (av.error.FFmpegError, ValueError) as error:
            raise SourceError(
                f"no decoder for the video of camera {self._camera_id}",
                expected="H.264, or another codec that FFmpeg knows",
                got=packet.encoding,
                do_next="convert the video to H.264",
            ) from error
        if not isinstance(context, VideoCodecContext):
            raise ValueError(f"{packet.encoding} is no codec of video")
        if self._extradata:
            context.extradata = self._extradata
        if self._is_quick:
            context.thread_count = 1
            if packet.is_recordable:
                context.flags |= av.codec.context.Flags.low_delay  # its frames are in order: wait for no other
        else:
            context.thread_type = "AUTO"
        return context

    def _frames(self, pictures: list[av.VideoFrame]) -> Iterator[DecodedFrame]:
        for picture in pictures:
            number = picture.pts if self._is_numbered else min(self._waiting)
            if number is None or number not in self._waiting:
                continue  # a second field, or what a decoder makes of nothing
            packet = self._waiting.pop(number)
            self._waiting = {n: waiting for n, waiting in self._waiting.items() if n > number}
            _require_size(self._camera_id, packet, self._size_wh, (picture.width, picture.height))
            yield DecodedFrame(packet, picture, self._camera_id, self._size_wh)


def _require_size(camera_id: str, packet: Packet, expected_wh: tuple[int, int], got_wh: tuple[int, int]) -> None:
    if got_wh != expected_wh:
        raise SourceError(
            f"camera {camera_id} has images of another size than it was calibrated with",
            where=f"frame {packet.number}",
            expected=f"{expected_wh[0]}x{expected_wh[1]} px",
            got=f"{got_wh[0]}x{got_wh[1]} px",
            do_next="set the camera to the calibrated resolution without cropping, or calibrate at this one",
        )


def _broken(camera_id: str, packet: Packet, got: str) -> BrokenFrameError:
    return BrokenFrameError(
        f"a frame of camera {camera_id} cannot be decoded",
        where=f"frame {packet.number}, at {packet.t_ns} ns",
        expected=f"a whole {packet.encoding} frame",
        got=got,
        do_next="nothing where it is one frame: decoding goes on, at the next key frame at the latest; else check the "
        "camera and its cable, or copy the file again",
    )
