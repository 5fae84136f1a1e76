"""Instants to run on: from a capture and a detector, a capture and a detections file, or a detections file alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from recognition.detectors import Detector
from recognition.errors import SourceError
from recognition.interpolation import in_common_time
from recognition.observations import FrameSet, Instant, ViewDetections, ViewFrame
from recognition.sources.capture import CaptureSource, open_source
from recognition.sources.detections_file import DetectionsFile, read_detections
from recognition.sources.synchrony import NOTABLE_SPREAD_S, SyncReport
from recognition.sources.timing import STAMPED
from rigcal.cores import core_count
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True)
class FeedOptions:
    """How instants are made."""

    use: Sequence[bool]
    """(V,) which of the rig's cameras are wanted."""
    fps: float
    """Frame rate where neither images nor detections hold times."""
    interpolate: bool = False
    """Whether detections are moved to the common times of the instants."""


@dataclass(frozen=True, slots=True)
class Feed:
    """Instants, and what there is to tell about them."""

    instants: Iterator[Instant]
    """In order; to be run through once."""
    total: int
    """How many there are."""
    start_ns: int
    """Rig time of the first."""
    facts: dict[str, str]
    """How they were found, for the metadata of a recording."""
    warnings: tuple[str, ...]
    """What may spoil the result, and what to do."""
    sync: SyncReport | None
    """How the cameras kept time; None for detections without frames."""
    bytes: int | None = None
    """What the frames take where they are; None where there are none."""


def open_feed(
    rig: Rig, source: Path | None, detections: Path | None, detector: Detector | None, options: FeedOptions
) -> Feed:
    """Open the instants of a run.

    Args:
        rig: The rig.
        source: Capture folder; None for detections alone.
        detections: Detections file; None where ``detector`` looks at the frames.
        detector: Looks at the frames where there is no detections file.
        options: Which cameras, at what rate, interpolated or not.

    Raises:
        SourceError: where there is nothing to run on, nothing to interpolate, or the capture or the detections do not
            suit the rig.
        CaptureError: where the capture itself is faulty.
    """
    known = read_detections(detections, rig) if detections is not None else None
    if source is not None:
        capture = open_source(source, rig, use=options.use, fps=options.fps)
        return _capture_feed(source, capture, known, detector, options)
    if known is None:
        raise SourceError(
            "nothing to run on",
            where="recognition run",
            expected="--source CAPTURE, --detections FILE.npz, or both",
            got="neither",
            do_next="give at least one of them",
        )
    times = "frame_time_s" if known.time_s is not None else f"frame numbers at {options.fps:g} fps"
    if options.interpolate and not known.has_own_times:
        raise _nothing_to_interpolate(detections, times)
    instants = instants_of_detections(known, fps=options.fps, use=options.use)
    return Feed(
        instants=in_common_time(instants) if options.interpolate else instants,
        total=len(known.frames),
        start_ns=0,
        facts={"instants": times},
        warnings=(),
        sync=None,
    )


def _capture_feed(
    path: Path, capture: CaptureSource, known: DetectionsFile | None, detector: Detector | None, options: FeedOptions
) -> Feed:
    timing, sync = capture.timing, capture.sync
    if options.interpolate and timing.rule not in STAMPED:
        raise _nothing_to_interpolate(path, timing.rule)
    if known is not None:
        instants = instants_of_both(capture, known)
    elif detector is not None:
        instants = instants_of_capture(capture, detector)
    else:
        raise ValueError("a capture without detections needs a detector")
    return Feed(
        instants=in_common_time(instants) if options.interpolate else instants,
        total=len(timing.number),
        start_ns=int(timing.t_ns.min()),
        facts={"instants": timing.rule, "spread_s": f"{sync.spread_worst_s:.6f}"},
        warnings=(*sync.warnings, *capture_warnings(capture, known, options)),
        sync=sync,
        bytes=size_of(capture),
    )


def size_of(capture: CaptureSource) -> int:
    """What the frames of a capture take on the disk, in bytes."""
    return sum(path.stat().st_size for camera in capture.cameras if camera for path in camera.paths)


def capture_warnings(capture: CaptureSource, known: DetectionsFile | None, options: FeedOptions) -> Iterator[str]:
    """What may spoil the result of a capture, beside what its clocks say."""
    if known is not None and (outside := known.outside(capture.timing.number, capture.timing.seen)):
        yield (
            f"{outside} of the detections are of no frame of the capture and were passed over: the file's frame "
            "numbers must count the instants of the capture"
        )
    if capture.sync.spread_median_s > NOTABLE_SPREAD_S and not options.interpolate:
        yield (
            f"the cameras are not triggered together, {1e3 * capture.sync.spread_median_s:.1f} ms apart in the median: "
            "--interpolate moves what they saw to a common time"
        )


def _nothing_to_interpolate(where: Path | None, times: str) -> SourceError:
    return SourceError(
        "there is nothing to interpolate: every camera's detections have the same time",
        where=where,
        expected="a time for each frame of each camera: timestamps.csv, file names that hold times, or frame_time_s "
        "(F, V) in the detections file",
        got=times,
        do_next="leave --interpolate out, or give the cameras' own times",
    )


def instants_of_capture(source: CaptureSource, detector: Detector) -> Iterator[Instant]:
    """Frames of a capture, and what a detector finds in them.

    The views of an instant are looked at in as many threads as there are processors, while the next one is decoded.
    """

    def seen(view: ViewFrame | None) -> ViewDetections:
        return ViewDetections.empty() if view is None else detector.detect(view.image_bgr)

    frame_sets = source.frame_sets()
    with ThreadPoolExecutor(core_count()) as pool:
        decoded = pool.submit(next, frame_sets, None)
        while (frame_set := decoded.result()) is not None:
            decoded = pool.submit(next, frame_sets, None)
            yield Instant(frame_set, tuple(pool.map(seen, frame_set.views)))


def instants_of_detections(detections: DetectionsFile, *, fps: float, use: Sequence[bool]) -> Iterator[Instant]:
    """Detections of a file without frames; its frame numbers become times at ``fps`` where it holds none."""
    nothing = (None,) * detections.cameras
    for frame in detections.frames:
        own_ns = detections.times_ns(frame, use=use, fps=fps)
        known = [t_ns for t_ns in own_ns if t_ns is not None]
        if known:
            t_ns = known[0] + round(sum(t - known[0] for t in known) / len(known))
            yield Instant(FrameSet(frame, t_ns, nothing, own_ns), _of(detections.views(frame), own_ns))


def instants_of_both(source: CaptureSource, detections: DetectionsFile) -> Iterator[Instant]:
    """Frames of a capture, and detections of a file whose frame numbers count the capture's instants.

    What the file says of a camera that has no frame at an instant is passed over.
    """
    for frame_set in source.frame_sets():
        yield Instant(frame_set, _of(detections.views(frame_set.index), frame_set.times_ns))


def _of(views: Sequence[ViewDetections], times_ns: Sequence[int | None]) -> tuple[ViewDetections, ...]:
    """The views of the cameras that took part, nothing of the others."""
    return tuple(ViewDetections.empty() if t is None else view for view, t in zip(views, times_ns, strict=True))
