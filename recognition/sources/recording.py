"""A recording as a source of instants: what the cameras saw, exactly as the run that recorded it saw it.

A recording is one file, a folder, or the segments of a run. Its instants come in the order in which the run placed
them, with the detections at the common times where the run interpolated; no frame is decoded.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

from pydantic import ValidationError

from recognition.errors import RecordingError
from recognition.observations import FrameSet, Instant, ViewDetections
from recognition.recording import (
    RecordedView,
    TrackedInstant,
    holds_tracks,
    iter_detections,
    iter_tracks,
    read_metadata,
    read_rig_attachment,
    read_segment,
    recording_files,
    unfinished_notes,
)
from recognition.recording.origin import GEOMETRY_KEY
from rigcal.rig import Rig
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import digest, rig_of


class RecordedInstants:
    """The instants of a recording, in order; to be run through once.

    Raises:
        RecordingError: while they are read, where a file is damaged or holds a camera that the rig has not.
    """

    def __init__(
        self, files: Sequence[Path], rig: Rig, *, start_ns: int | None = None, end_ns: int | None = None
    ) -> None:
        self._files, self._rig = files, rig
        self._start_ns, self._end_ns = start_ns, end_ns
        self.incomplete = 0
        """Instants so far that lost the messages of a camera, and were left out."""

    def __iter__(self) -> Iterator[Instant]:
        waiting: list[RecordedView] = []
        for file in self._files:
            for view in iter_detections(file, start_ns=self._start_ns, end_ns=self._end_ns):
                if waiting and (view.index, view.instant_ns) != (waiting[0].index, waiting[0].instant_ns):
                    self.incomplete += 1
                    waiting = []
                waiting.append(self._known(file, view))
                if len(waiting) == view.views:
                    yield self._instant(waiting)
                    waiting = []
        self.incomplete += bool(waiting)

    def _known(self, file: Path, view: RecordedView) -> RecordedView:
        if view.camera_id not in self._rig.camera_ids:
            raise RecordingError(
                f"the recording holds detections of camera {view.camera_id}, which its rig does not have",
                where=file,
                expected=f"cameras {', '.join(self._rig.camera_ids)}",
                got=view.camera_id,
                do_next=f"run `recognition check {file}`",
            )
        return view

    def _instant(self, views: Sequence[RecordedView]) -> Instant:
        by_camera = {view.camera_id: view for view in views}
        of_cameras = [by_camera.get(camera_id) for camera_id in self._rig.camera_ids]
        nothing = ViewDetections.empty()
        frame_set = FrameSet(
            index=views[0].index,
            t_ns=views[0].instant_ns,
            views=(None,) * len(of_cameras),
            times_ns=tuple(None if view is None else view.t_ns for view in of_cameras),
        )
        return Instant(
            frame_set,
            views=tuple(view.seen if view else nothing for view in of_cameras),
            common=tuple(view.common if view else nothing for view in of_cameras) if views[0].interpolated else (),
        )


class RecordedTracks:
    """What was judged at the instants of a recording, in order; to be run through once.

    Raises:
        RecordingError: while they are read, where a file is damaged.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        self._files = files
        self.incomplete = 0
        """Instants so far that are missing among those of a file."""

    def __iter__(self) -> Iterator[TrackedInstant]:
        for file in self._files:
            due: int | None = None
            for number, recorded in iter_tracks(file):
                self.incomplete += 0 if due is None else number - due
                due = number + 1
                yield recorded


@dataclass(frozen=True, slots=True)
class RecordedRun:
    """What a recording says of its run."""

    files: tuple[Path, ...]
    """One file, or the segments, in order."""
    rig: Rig
    metadata: Mapping[str, str]
    """Options, networks and what else describes the run."""
    warnings: tuple[str, ...]
    """Why a replay may differ from the run."""
    start_ns: int | None = None
    """Only what was logged from this time on counts; None: everything."""
    end_ns: int | None = None
    """Only what was logged up to this time counts."""

    def instants(self) -> RecordedInstants:
        """The instants, from the first."""
        return RecordedInstants(self.files, self.rig, start_ns=self.start_ns, end_ns=self.end_ns)

    @property
    def geometry_digest(self) -> str:
        """The rig file's, by which rules and events name it; empty where the recording does not say."""
        return self.metadata.get(GEOMETRY_KEY, "")

    @property
    def holds_tracks(self) -> bool:
        """Whether it can be judged again without being placed again, which needs all of it.

        Raises:
            RecordingError: where a file is damaged.
        """
        return self.start_ns is None and self.end_ns is None and holds_tracks(self.files)

    def tracks(self) -> RecordedTracks:
        """What was judged at each instant of the whole recording, from the first."""
        return RecordedTracks(self.files)

    def between(self, start_ns: int | None, end_ns: int | None) -> RecordedRun:
        """A part of it, by the times at which things were logged; the rest is not read."""
        return replace(self, start_ns=start_ns, end_ns=end_ns)


def open_recording(path: Path) -> RecordedRun:
    """Open a finished recording for a replay.

    Args:
        path: a file, the name ``NAME.mcap`` of segments, or a folder with one recording.

    Raises:
        RecordingError: where there is none, a file is unfinished or damaged, its rig file cannot be used, or files
            are of several runs.
    """
    files = recording_files(path)
    rig = _recorded_rig(files[0])
    return RecordedRun(
        files=files,
        rig=rig,
        metadata=MappingProxyType(read_metadata(files[0])),
        warnings=(*_segment_warnings(files), *unfinished_notes(path)),
    )


def _recorded_rig(file: Path) -> Rig:
    try:
        content = json.loads(read_rig_attachment(file))
        document = RigDocument.model_validate(content)
        problem = "" if document.digest == digest(content) else f"its digest is {digest(content)}"
    except (ValueError, ValidationError, RecursionError) as error:
        problem = str(error).splitlines()[0]
    if problem:
        raise RecordingError(
            "the rig file inside the recording cannot be used",
            where=file,
            expected="the rig file as rigcal wrote it",
            got=problem,
            do_next=f"run `recognition check {file}`, which says what is wrong with it",
        )
    return rig_of(document)


def _segment_warnings(files: Sequence[Path]) -> Iterator[str]:
    """What the segments of a run lack; RecordingError where they are of several runs."""
    places = [read_segment(file) for file in files]
    runs = {place[0] for place in places if place}
    if len(files) > 1 and (None in places or len(runs) > 1):
        raise RecordingError(
            "the segments are not of one run",
            where=files[0].parent,
            expected="segments that one run recorded",
            got=f"{len(files)} files of {len(runs) + places.count(None)} runs",
            do_next="move the others away, or replay one file at a time",
        )
    numbers = [place[1] for place in places if place]
    if numbers and numbers[0] > 0:
        yield f"the run began {numbers[0]} segments before {files[0].name}: identities are given anew from here"
    for before, after in pairwise(numbers):
        if after != before + 1:
            yield f"segments {before + 1} to {after - 1} are missing: nothing is known of that time"
