"""Failures as short videos of all views, so that anybody can see why a decision was wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from recognition.evaluation.violations.alarms import Failure
from recognition.sources.recording import open_recording
from recognition.viewing import Codec, Rendering, RenderOptions, VideoWriter, read_footage
from rigcal.errors import writing

BEFORE_S, AFTER_S = 2.0, 2.0
"""What a clip shows around the failure."""


def write_clips(
    failures: Sequence[Failure],
    recording_of: Callable[[str], Path],
    use: Sequence[bool],
    folder: Path,
    *,
    codec: Codec = "h264",
) -> tuple[Path, ...]:
    """Write a video of each failure, heads blurred, with what was recognised drawn over every view.

    Args:
        failures: What went wrong, where and when.
        recording_of: The recording of a sequence, by its name.
        use: (V,) which cameras are shown.
        folder: Where the videos are put; made where it is not there.
        codec: ``h264``, or ``mpeg4`` where FFmpeg has no encoder for that.

    Returns:
        One path for each failure, in order.

    Raises:
        RecordingError: where a recording cannot be used.
        OutputError: where a video cannot be written.
    """
    paths = []
    for number, failure in enumerate(failures):
        name = f"{number:03d}-{failure.sequence}-{failure.violation}-{failure.kind.replace(' ', '-')}.mp4"
        path = folder / name
        shown = RenderOptions(tuple(use), max(0.0, failure.start_s - BEFORE_S), failure.end_s + AFTER_S)
        rendering = Rendering(read_footage(open_recording(recording_of(failure.sequence))), shown)
        with writing(path), VideoWriter(path, rendering.size_wh, rendering.rate, codec) as video:
            for picture in rendering.pictures():
                video.write(picture.image_bgr, picture.t_ns)
        paths.append(path)
    return tuple(paths)
