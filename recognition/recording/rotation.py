"""The files of a run: one, or segments that follow each other; within a budget of the disk.

A new segment begins when the last one is long enough. Each camera's video moves to it with its own next key frame, and
until then goes on in the segment before, so that every segment can be decoded from its start and no frame is lost or
stands in two files. A camera that delivers nothing for :data:`LOST_S` is not waited for.

Decision: when the disk is full, or the budget is used up, recording ends and the run goes on: to watch without a
record is worse than to record, and better than to do neither. Whatever the disk took is made whole at the end of the
run. Any other refusal of the disk is raised, for nobody knows what it means.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from recognition.errors import NoRoomError, RecordingError
from recognition.recording.budget import LOOK_BYTES, LOOK_S, DiskBudget, free_on_disk
from recognition.recording.completion import complete
from recognition.recording.container import recover_command
from recognition.recording.messages import log_message
from recognition.recording.segment import Outgoing, Segment

LOST_S = 5.0
"""Time without a frame after which a camera's video is not waited for. By the clock of this machine: of files that are
read as fast as possible, the streams may be minutes of log time apart."""
LOG = "/log"


@dataclass(frozen=True, slots=True)
class Written:
    """What the files of a run hold."""

    files: dict[Path, int]
    """Size in bytes of each finished file that is there, in order."""
    dropped: tuple[Path, ...]
    """Segments that were deleted to make room."""
    stopped: str | None
    """Why recording ended before the run did."""
    undecodable: Counter[str]
    """Frames by topic that nobody could decode, and that were left out."""
    unrecorded: Counter[str]
    """Messages by topic that came after recording ended."""


class Rotation:
    """Puts messages into the file where they belong; safe to use from several threads.

    Args:
        open_segment: Makes the segment of a number, from 0.
        segment_ns: How long a segment is, in log time; None for a single file.
        budget: What the files may take.

    Raises:
        RecordingError: as :class:`Segment` does.
    """

    def __init__(self, open_segment: Callable[[int], Segment], segment_ns: int | None, budget: DiskBudget) -> None:
        self._open, self._segment_ns, self._budget = open_segment, segment_ns, budget
        self._lock = threading.RLock()
        self._count = 1
        self._current: Segment = open_segment(0)
        self._previous: Segment | None = None
        self._behind: set[str] = set()
        """Topics of video that have not moved to the current segment."""
        self._seen_s: dict[str, float] = {}
        """When the last frame of each video came, by the clock of this machine."""
        self._latest: dict[str, int] = {}
        """Latest log time by topic."""
        self._files: dict[Path, int] = {}
        self._dropped: list[Path] = []
        self._torn: list[Segment] = []
        self._stopped: str | None = None
        self._undecodable: Counter[str] = Counter()
        self._unrecorded: Counter[str] = Counter()
        self._look_at_s, self._unlooked_bytes = 0.0, 0
        """When the disk is looked at again, and what was written since it was."""
        self._closed = False
        self._written: Written | None = None

    @property
    def stopped(self) -> str | None:
        """Why recording ended, in words; None while it goes on."""
        return self._stopped

    def write(self, items: Sequence[Outgoing]) -> None:
        """Add messages; those that go to one file stay together in it.

        Raises:
            RecordingError: where the disk refuses for another reason than that it is full, or after the end.
        """
        with self._lock:
            if self._closed:
                raise RecordingError(
                    "the recording is closed",
                    where=self._current.path,
                    do_next="write before the recorder's block ends",
                )
            if self._stopped is not None or not items:
                self._unrecorded.update(item.topic for item in items)
                return
            ordered = [self._ordered(item) for item in items]
            latest = ordered[-1]
            with self._full_disk_ends_it():
                self._rotate(latest.log_ns)
                self._unlooked_bytes += self._put(ordered)
                self._let_go()
                self._mind_the_disk(latest)

    def close(self) -> Written:
        """Finish every file."""
        with self._lock:
            self._closed = True
            if self._written is None:
                with self._full_disk_ends_it():
                    for segment in self._open_segments():
                        self._finish(segment)
                for segment in self._torn:
                    self._mend(segment)
                files, dropped = dict(self._files), tuple(self._dropped)
                self._written = Written(files, dropped, self._stopped, self._undecodable, self._unrecorded)
            return self._written

    def abandon(self) -> None:
        """Finish the ``.part`` files as far as the disk allows, and leave them so."""
        with self._lock:
            self._closed = True
            for segment in self._open_segments():
                segment.abandon()

    def _open_segments(self) -> list[Segment]:
        if self._stopped is not None:
            return []
        return [self._current] if self._previous is None else [self._previous, self._current]

    def _ordered(self, item: Outgoing) -> Outgoing:
        """The message, not logged before the last one of its topic."""
        latest_ns = self._latest.get(item.topic, 0)
        if item.log_ns < latest_ns:
            return replace(item, log_ns=latest_ns)
        self._latest[item.topic] = item.log_ns
        return item

    def _put(self, items: Sequence[Outgoing]) -> int:
        """Write messages to where they belong; returns how many bytes they are."""
        placed, written = [(item, self._segment_of(item)) for item in items], 0
        for segment in self._open_segments():
            lot = [item for item, target in placed if target is segment]
            if lot:
                written += segment.write(lot)
        return written

    def _segment_of(self, item: Outgoing) -> Segment | None:
        """Where a message belongs; None for a frame that nobody could decode."""
        if item.is_key is None:
            return self._current
        self._seen_s[item.topic] = time.monotonic()
        if item.topic in self._behind and not item.is_key:
            return self._previous
        self._behind.discard(item.topic)
        if not item.is_key and item.topic not in self._current.video:
            self._undecodable[item.topic] += 1
            return None
        return self._current

    def _rotate(self, now_ns: int) -> None:
        """Begin a segment where the current one is long enough, and the one before it is finished."""
        start_ns = self._current.start_ns
        if self._segment_ns is None or self._previous is not None or start_ns is None:
            return
        if now_ns - start_ns >= self._segment_ns:
            following = self._open(self._count)
            self._count += 1
            self._previous, self._current = self._current, following
            self._previous.follow_up()
            self._behind = set(self._previous.video)

    def _let_go(self) -> None:
        """Finish the segment before when no camera's video goes on in it."""
        if self._previous is None:
            return
        lost_s = time.monotonic() - LOST_S
        self._behind = {topic for topic in self._behind if self._seen_s[topic] > lost_s}
        if not self._behind:
            self._finish(self._previous)
            self._previous = None

    def _finish(self, segment: Segment) -> None:
        self._files[segment.path] = segment.finish()

    def _mind_the_disk(self, latest: Outgoing) -> None:
        """Once in a while: make room, or end the recording."""
        now_s = time.monotonic()
        if now_s < self._look_at_s and self._unlooked_bytes < LOOK_BYTES:
            return
        used_bytes = self._used_bytes()
        while shortage := self._budget.shortage(used_bytes, free_on_disk(self._current.path)):
            if self._budget.keep != "newest" or not self._files:
                self._end(shortage, latest)
                return
            self._drop_oldest(shortage, latest)
            used_bytes = self._used_bytes()
        self._look_at_s, self._unlooked_bytes = now_s + LOOK_S, 0

    def _used_bytes(self) -> int:
        return sum(self._files.values()) + sum(segment.bytes for segment in self._open_segments())

    def _drop_oldest(self, shortage: str, latest: Outgoing) -> None:
        oldest = next(iter(self._files))
        try:
            oldest.unlink(missing_ok=True)
        except OSError as error:
            raise RecordingError(
                "cannot delete a segment to make room",
                where=oldest,
                expected="a folder from which this run may delete what it recorded",
                got=error.strerror or str(error),
                do_next="mend its permissions, or record with --keep oldest",
            ) from error
        del self._files[oldest]
        self._dropped.append(oldest)
        self._say("warning", f"segment {oldest.name} was deleted, as the newest are to be kept: {shortage}", latest)

    def _end(self, shortage: str, latest: Outgoing) -> None:
        self._say("error", f"recording ends here and recognition goes on: {shortage}", latest)
        for segment in self._open_segments():
            self._finish(segment)
        self._stopped = shortage

    def _say(self, level: str, text: str, latest: Outgoing) -> None:
        line = log_message(level, text, latest.t_ns)
        self._current.write([self._ordered(Outgoing(LOG, line, latest.t_ns, latest.log_ns))])

    @contextlib.contextmanager
    def _full_disk_ends_it(self) -> Iterator[None]:
        """End the recording where the disk is full; what is open is made whole when the run ends."""
        try:
            yield
        except NoRoomError as error:
            self._torn = [segment for segment in self._open_segments() if segment.path not in self._files]
            for segment in self._torn:
                segment.abandon()
            self._stopped = f"the disk refused: {error.got}"

    def _mend(self, segment: Segment) -> None:
        """Make what the disk took of a segment whole."""
        try:
            self._files[segment.path] = complete(segment.part, segment.path)
        except RecordingError:
            self._stopped = f"{self._stopped}; to save what it took, run `{recover_command(segment.part)}`"
