"""Instants of cameras that do not wait: everything recorded, the newest frame set looked at, the older ones skipped.

For each camera one thread receives and one decodes; one thread records; the networks look at the views of a set in as
many threads as there are processors, and already at the next set while the caller places what was seen in the last one.
Every queue is bounded, and what happens when it is full is stated where it is:

- packets to the disk: :mod:`recognition.live.recording` (a camera's packets are lost up to its next key frame; loud);
- packets to a decoder: :mod:`recognition.live.camera` (left undecoded up to the next key frame; recorded all the same);
- frames that wait for their partners: :mod:`recognition.grouping` (an instant leaves without them);
- frame sets to the networks: :mod:`recognition.live.gathering` (a newer one takes the place of an older one);
- what was seen to the caller: the networks wait, since a caller that is slower than they are must not fall behind.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from threading import Event
from types import TracebackType
from typing import Self

from recognition.detectors import Detector
from recognition.errors import SourceError
from recognition.grouping import GroupingOptions
from recognition.live.books import Books
from recognition.live.camera import LiveCamera, Shared
from recognition.live.gathering import Gathering
from recognition.live.journal import Entry, Journal
from recognition.live.latency import Latency
from recognition.live.looking import Looking, Seen
from recognition.live.recording import PacketRecording
from recognition.monitoring import Verdict, clock_faults, judged
from recognition.observations import FrameSet, Instant, ViewDetections
from recognition.recording import Recorder
from recognition.sources.decoding import DecodedFrame
from recognition.sources.stream import Stream
from recognition.status import CameraStatus, LiveStatus
from rigcal.rig import Rig

SILENCE_S = 1.0
"""Without a frame set for so long there is an instant that no camera took part in, and so on at this pace."""
_POLL_S = 0.2
"""How soon a stop is noticed."""
_BOOKS_S = 1.0
"""Over which rates are taken, and after which clocks are judged again."""
_REPORT_S = 10.0
"""How often skipped sets are put down in the recording."""
_SWITCH_S = 1e-4
"""After so long a thread that computes in Python makes way for one that waits to go on. Python's own 5 ms are long
here: the thread that is to hand the next picture to a network waits for those that place, decode and record."""


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """How live cameras are followed."""

    use: Sequence[bool]
    """(V,) which of the rig's cameras are wanted."""
    is_live: bool
    """Whether the clocks are judged by their age now and messages bear times of arrival; else the streams are files."""
    clock_age_s: float
    """Clock models older than this are not trusted where ``is_live``."""
    grouping: GroupingOptions = field(default_factory=GroupingOptions)


class LiveFeed:
    """The instants of live streams; use it in a ``with`` block, which ends with everything recorded that arrived.

    Args:
        rig: The rig.
        streams: Of the cameras in use.
        detector: Looks at the frames; several threads call it at once.
        recorder: Takes the packets; open for as long as the block lasts.
        now_ns: The present rig time in nanoseconds, which does not step.
        options: Which cameras, and how they are judged.
    """

    def __init__(
        self,
        rig: Rig,
        streams: Sequence[Stream],
        detector: Detector,
        recorder: Recorder,
        now_ns: Callable[[], int],
        options: LiveOptions,
    ) -> None:
        self._rig, self._recorder, self._options = rig, recorder, options
        self._now_ns = now_ns
        self._journal = Journal(now_ns)
        self._recording = PacketRecording(recorder, rig.camera_ids, self._journal)
        views = [stream.camera for stream in streams]
        self._gathering: Gathering[DecodedFrame] = Gathering(views, len(rig.cameras), options.grouping)
        shared = Shared(self._recording, self._gathering, self._journal, Event())
        self._stopping = shared.stopping
        self._cameras = [LiveCamera(rig.camera_ids[stream.camera], stream, shared) for stream in streams]
        self._stack = ExitStack()
        self._work: list[Future[None]] = []
        self._looking = Looking(self._gathering, detector, self._stopping, self._broken)
        self._looked_at = self._silences = self._abandoned = 0
        self._latency, self._is_unrecorded = Latency(), False
        self._books = Books.opened(time.monotonic(), len(streams))
        self.announce: Callable[[Entry], None] = lambda _entry: None
        """Told of everything that happens, beside the recording."""

    def __enter__(self) -> Self:
        self._judge_clocks()
        self._stack.enter_context(_quick_switching())
        threads = self._stack.enter_context(ThreadPoolExecutor(2 * len(self._cameras) + 2, "live"))
        self._writing = threads.submit(self._recording.run)
        cameras = (work for one in self._cameras for work in (one.decode, one.receive))
        self._work = [threads.submit(work) for work in (*cameras, self._looking.run)]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stopping.set()
        for camera in self._cameras:
            camera.close()
        wait(self._work)
        self._recording.close()
        self._stack.close()
        self._abandoned = self._gathering.sets - self._gathering.skipped - self._looked_at
        if kind is None:
            self._raise_failures()
            self._report(time.monotonic())
            self._put_down()

    def instants(self, stop: Callable[[], bool] | None = None) -> Iterator[Instant]:
        """What was seen in the newest frame set whenever the networks are free, until the streams end or ``stop``.

        Where nothing comes, an instant without cameras every :data:`SILENCE_S`, as old as that.

        Raises:
            RecordingError: where the disk refuses.
        """
        heard_s = time.monotonic()
        while not (stop is not None and stop()):
            self._raise_failures()
            seen = self._looking.next(_POLL_S)
            now_s = time.monotonic()
            if seen is not None:
                heard_s = now_s
                yield self._instant(seen)
            elif self._looking.is_over:
                self._raise_failures()
                return
            elif now_s - heard_s > SILENCE_S and not self._looking.is_busy:
                heard_s = now_s
                yield self._nothing()
            self._keep_books()

    def judged(self, frame_set: FrameSet) -> Verdict:
        """How well an instant is monitored, and what is wrong with the cameras that it lacks."""
        faults = {camera.index: camera.fault for camera in self._cameras}
        known = {index: fault for index, fault in faults.items() if fault}
        return judged(self._rig.camera_ids, self._options.use, frame_set, known)

    def placed(self, frame_set: FrameSet) -> None:
        """The tracks of an instant are there: count the time since its first frame was taken."""
        times_ns = [t_ns for t_ns in frame_set.times_ns if t_ns is not None]
        if times_ns:
            self._latency.add((self._now_ns() - min(times_ns)) * 1e-9)

    def log_ns(self) -> int | None:
        """The time of arrival that messages of the present bear; None where they bear their own."""
        return self._now_ns() if self._options.is_live else None

    @property
    def status(self) -> LiveStatus:
        """How the run stands; for any thread."""
        books, gathering = self._books, self._gathering
        return LiveStatus(
            elapsed_s=time.monotonic() - books.start_s,
            cameras=tuple(map(self._camera_status, self._cameras, books.fps)),
            sets=gathering.sets,
            looked_at=self._looked_at,
            skipped=gathering.skipped + self._abandoned,
            alone=gathering.alone,
            sets_per_s=books.sets_per_s,
            latency_p50_s=self._latency.quantile_s(0.5),
            latency_p95_s=self._latency.quantile_s(0.95),
            waiting_bytes=self._recording.waiting_bytes,
            unrecorded_why=self._recorder.stopped,
        )

    def _camera_status(self, camera: LiveCamera, fps: float) -> CameraStatus:
        return CameraStatus(
            camera_id=camera.camera_id,
            fps=fps,
            lag_s=None if camera.lag_ns is None else camera.lag_ns * 1e-9,
            received=camera.received,
            recorded=self._recording.written[camera.index],
            unrecorded=self._recording.lost[camera.index] + camera.unrecorded,
            undecoded=camera.undecoded,
            corrupt=camera.corrupt,
            late=self._gathering.late[camera.index],
            interruptions=camera.interruptions,
            fault=camera.fault,
        )

    def _instant(self, seen: Seen) -> Instant:
        self._looked_at += 1
        number, group = seen.taken
        times_ns = tuple(None if view is None else t_ns for view, t_ns in zip(seen.views, group.times_ns, strict=True))
        frame_set = _frame_set(number + self._silences, group.t_ns, times_ns)
        return Instant(frame_set, tuple(view or ViewDetections.empty() for view in seen.views))

    def _broken(self, camera: int, error: SourceError) -> None:
        next(one for one in self._cameras if one.index == camera).broken(error)

    def _nothing(self) -> Instant:
        views = len(self._rig.cameras)
        number, t_ns = self._gathering.sets + self._silences, self._now_ns() - round(SILENCE_S * 1e9)
        self._silences += 1
        return Instant(_frame_set(number, t_ns, (None,) * views), (ViewDetections.empty(),) * views)

    def _raise_failures(self) -> None:
        for work in (self._writing, *self._work):
            if work.done():
                work.result()

    def _keep_books(self) -> None:
        """Rates, clocks and the journal."""
        now_s = time.monotonic()
        if now_s - self._books.at_s >= _BOOKS_S:
            self._books = self._books.turned(now_s, self._looked_at, [one.received for one in self._cameras])
            self._judge_clocks()
            self._watch_recorder()
        if now_s - self._books.reported_s >= _REPORT_S:
            self._report(now_s)
        self._put_down()

    def _report(self, now_s: float) -> None:
        sets, skipped = self._gathering.sets, self._gathering.skipped
        new = skipped - self._books.skipped
        if new:
            self._journal.say(
                "warning",
                f"{new} of {max(sets - self._books.sets, new)} frame sets were skipped in the last "
                f"{max(now_s - self._books.reported_s, 1.0):.0f} s: inference is late",
            )
        self._books = replace(self._books, reported_s=now_s, sets=sets, skipped=skipped)

    def _watch_recorder(self) -> None:
        if self._recorder.stopped and not self._is_unrecorded:
            self._is_unrecorded = True
            self._journal.say("error", f"NOTHING IS RECORDED any more: {self._recorder.stopped}")

    def _judge_clocks(self) -> None:
        if not self._options.is_live:
            return
        faults = dict(
            clock_faults(
                self._rig,
                self._options.use,
                self._now_ns() * 1e-9,
                max_age_s=self._options.clock_age_s,
                period_s=1 / self._options.grouping.fps,
            )
        )
        for camera in self._cameras:
            camera.judge_clock_model(faults.get(camera.index))

    def _put_down(self) -> None:
        """What happened, into the recording and to whoever listens."""
        for entry in self._journal.read():
            receive_ns = entry.t_ns if self._options.is_live else None
            self._recorder.log(entry.level, entry.text, entry.t_ns, receive_ns=receive_ns)
            self.announce(entry)


@contextmanager
def _quick_switching() -> Iterator[None]:
    """Have threads make way for each other soon; the setting is the whole interpreter's, and is put back."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)


def _frame_set(number: int, t_ns: int, times_ns: tuple[int | None, ...]) -> FrameSet:
    """Without the images, which are recorded already."""
    return FrameSet(number, t_ns, (None,) * len(times_ns), times_ns)
