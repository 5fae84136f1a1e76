"""An mp4 of pictures, each shown from its own time on.

H.264 in yuv420p without B-frames, its index in front: what browsers and the players of Windows show, while it loads.
PyAV's own wheels encode it with libx264, which is GPL and no part of this package; a build without that has libopenh264
(BSD) at best. mpeg4 (MPEG-4 part 2) is in every build, but browsers do not show it, so it is never taken unasked.
OpenCV's writer was the alternative: it has a fixed frame rate, and in its wheels no encoder of H.264.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Literal, Self

import av
import av.codec
import av.error
import numpy as np
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from av.video.stream import VideoStream
from numpy.typing import NDArray

from recognition.errors import RecognitionError
from rigcal.errors import OutputError

Codec = Literal["h264", "mpeg4"]
ENCODERS: Mapping[Codec, tuple[str, ...]] = MappingProxyType({"h264": ("libx264", "libopenh264"), "mpeg4": ("mpeg4",)})
"""FFmpeg's names, the first that it has is taken."""
TIME_BASE = Fraction(1, 60_000)
"""Of times in the file, s; MPEG-4 part 2 cannot count in finer steps than 1/65535 s."""
BIT_RATE = 6_000_000
"""Of encoders that know no quality; libx264 takes what its quality needs."""
_OPTIONS: dict[str, dict[str, str]] = {"libx264": {"crf": "23", "preset": "veryfast"}}


class VideoWriter:
    """Writes an mp4 by way of ``.NAME.part``; use it in a ``with`` block, which gives the file its name at its end.

    Args:
        path: The file to be; replaced when the block ends without an exception.
        size_wh: Of the pictures; even numbers.
        rate: About how many pictures come each second, which players show as the frame rate.
        codec: ``h264``, or ``mpeg4`` where FFmpeg has no encoder for that.

    Raises:
        RecognitionError: where FFmpeg has no encoder for the codec.
        OutputError: where the file cannot be written.
    """

    def __init__(self, path: Path, size_wh: tuple[int, int], rate: float, codec: Codec = "h264") -> None:
        encoder = encoder_of(codec)
        if path.is_dir():
            raise OutputError(path, got="a folder")
        self._path, self._part = path, path.with_name(f".{path.name}.part")
        try:
            self._container = av.open(str(self._part), "w", format="mp4", options={"movflags": "+faststart"})
        except (OSError, av.error.FFmpegError) as error:
            raise OutputError(path, got=error.strerror or str(error)) from error
        stream = self._container.add_stream(encoder, rate=Fraction(rate).limit_denominator(1000))
        if not isinstance(stream, VideoStream):
            raise ValueError(f"{encoder} is no encoder of video")
        self._stream = stream
        context = stream.codec_context
        context.width, context.height = size_wh
        context.pix_fmt, context.time_base, context.max_b_frames = "yuv420p", TIME_BASE, 0
        context.colorspace, context.color_range = Colorspace.ITU709, ColorRange.MPEG
        context.color_primaries, context.color_trc = ColorPrimaries.BT709, ColorTrc.BT709
        context.bit_rate = 0 if encoder in _OPTIONS else BIT_RATE
        context.options = dict(_OPTIONS.get(encoder, {}))
        self._first_ns: int | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._container.mux(self._stream.encode(None))
            self._container.close()
            if kind is None:
                self._part.replace(self._path)
        except (OSError, av.error.FFmpegError) as failure:
            raise OutputError(self._path, got=failure.strerror or str(failure)) from failure
        finally:
            self._part.unlink(missing_ok=True)

    def write(self, image_bgr: NDArray[np.uint8], t_ns: int) -> None:
        """Add a picture (H, W, 3); times in nanoseconds increase, and the first one's is where the video begins."""
        self._first_ns = t_ns if self._first_ns is None else self._first_ns
        rgb = av.VideoFrame.from_ndarray(image_bgr, format="bgr24")
        frame = rgb.reformat(format="yuv420p", dst_colorspace=Colorspace.ITU709)
        frame.pts, frame.time_base = round((t_ns - self._first_ns) * 1e-9 / TIME_BASE), TIME_BASE
        try:
            self._container.mux(self._stream.encode(frame))
        except (OSError, av.error.FFmpegError) as failure:
            raise OutputError(self._path, got=failure.strerror or str(failure)) from failure


def encoder_of(codec: Codec) -> str:
    """FFmpeg's name of what encodes; to be asked before something takes long.

    Raises:
        RecognitionError: where FFmpeg has no encoder for the codec.
    """
    for name in ENCODERS[codec]:
        if name in av.codec.codecs_available:
            return name
    others = [other for other in ENCODERS if other != codec]
    raise RecognitionError(
        f"FFmpeg has no encoder for {codec} here",
        expected=" or ".join(ENCODERS[codec]),
        got="neither in this build of PyAV" if len(ENCODERS[codec]) > 1 else "not in this build of PyAV",
        do_next=f"give --codec {others[0]}, or write pictures with --png",
    )
