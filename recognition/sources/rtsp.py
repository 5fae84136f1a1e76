"""A live camera over RTSP: its own H.264, frame by frame, at the times at which it took them.

RTP runs inside the RTSP connection (TCP), so that frames are late rather than broken. Nothing that a camera does is an
exception: each fault is an interruption with the whole message, and the camera is tried again until it is back. Frames
before the first key frame of a session cannot be decoded and are dropped; all later ones are handed on.

Decision: a camera that sends no sender reports is not used, and is told about. Its frames could be given the time of
arrival less some bound, but the delay of encoder, transport and jitter buffer is unknown and differs between cameras;
a worker who walks at 2 m/s would be placed by 10 cm wrong for every 50 ms of it, and nothing would show it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator
from itertools import count

import av
import av.error
from av.container import InputContainer
from av.video.stream import VideoStream

from recognition.errors import StreamError
from recognition.sources.decoding import Decoder
from recognition.sources.rtsp_faults import RtspFaults
from recognition.sources.rtsp_time import MediaClock, Report
from recognition.sources.rtsp_units import AccessUnit, access_units
from recognition.sources.stream import ClockStep, Interruption, Packet, StreamEvent
from recognition.sources.urls import SourceUrl
from rigcal.rig import ClockModel

OPEN_TIMEOUT_S = 5.0
"""For the connection, and again for its first packets. Loopback: 0.07 s; name servers and slow cameras take seconds."""
READ_TIMEOUT_S = 1.5
"""A camera that is silent for longer is lost. Also how long a blocked read outlives :meth:`RtspStream.close`."""
KEY_WAIT_S = 10.0
"""A session in which nothing can be decoded for longer is of no use."""
REPORT_WAIT_S = 15.0
"""Frames are held until the first sender report, for no longer than this: reports come every 5 s, or as much as 7.5 s
(RFC 3550, 6.2 and 6.3.1), and one may be lost."""
JUMP_S = 1.0
"""A frame whose media time is further ahead of its arrival than this, measured by the quickest frame of the session,
is not on the session's time line any more."""
OFF_S = 10.0
"""A capture time this far from the time of arrival is not of this clock: networks and cameras delay by less."""
BEHIND_S = 0.1
"""Times of a stream always ascend. Reports that move the line back by less than this hold the next frames back; a clock
that was set back by more while the camera was away is a fault until it has caught up."""
BACKOFF_FIRST_S, BACKOFF_FACTOR, BACKOFF_CAP_S = 0.5, 2.0, 10.0
"""Pause before a lost camera is tried again: 0.5, 1, 2, 4, 8, 10, 10, ... s, from the start again after a session of
more than the cap. Not randomised: a rig has few cameras, each with a server of its own."""
_OPTIONS = {
    "rtsp_transport": "tcp",
    "allowed_media_types": "video",  # with sound beside it FFmpeg would move video times at the first report
    "fflags": "+noparse",
    "fpsprobesize": "0",  # else 20 frames are waited for: 0.95 s instead of 0.07 s to open at 30 frames a second
    "analyzeduration": "1000000",  # where the description lacks parameter sets, look for them for 1 s
}


class RtspStream:
    """One camera of the rig, live; see :class:`recognition.sources.stream.Stream`.

    Args:
        camera: Index of the camera in the rig.
        camera_id: Its name, for messages.
        url: Where it is.
        clock: From its wall clock to rig time; None takes its wall clock for rig time.
        size_wh: The size that the rig knows it by.
    """

    def __init__(
        self, camera: int, camera_id: str, url: SourceUrl, clock: ClockModel | None, size_wh: tuple[int, int]
    ) -> None:
        self._camera, self._camera_id, self._url, self._clock, self._size_wh = camera, camera_id, url, clock, size_wh
        self._faults = RtspFaults(camera_id, url)
        self._closing = threading.Event()
        self._numbers = count()
        self._latest_ns = -1

    @property
    def camera(self) -> int:
        """Index of the camera in the rig."""
        return self._camera

    def packets(self) -> Iterator[StreamEvent]:
        """Packets until :meth:`close`, and an interruption whenever the camera is lost, or fails for a new reason.

        The first packets come with the first sender report, which a camera may send seconds after the connection.
        """
        pauses_s, told = _pauses_s(), ""
        while not self._closing.is_set():
            opened_s = time.monotonic()
            try:
                for event in self._session():
                    told = ""
                    yield event
                    if self._closing.is_set():
                        return
            except StreamError as error:
                if error.what != told:
                    told = error.what
                    yield Interruption(self._camera, time.time_ns(), error)
            if time.monotonic() - opened_s > BACKOFF_CAP_S:
                pauses_s = _pauses_s()
            self._closing.wait(next(pauses_s))

    def decoder(self) -> Decoder:
        """A decoder for one thread; it follows the stream through interruptions."""
        return Decoder(self._camera_id, self._size_wh)

    def close(self) -> None:
        """End :meth:`packets`: a blocked read within 1.5 s, a connection that is being opened within 5 s and its first
        packets within as much again, a pause at once."""
        self._closing.set()

    def _session(self) -> Iterator[StreamEvent]:
        """One connection, until it breaks.

        Raises:
            StreamError: how it broke, or why there was none.
        """
        with self._opened() as container:
            stream = self._checked(container)
            units = self._guarded(access_units(container, stream, self._closing.is_set))
            yield from self._timed(self._in_line(units))
        if not self._closing.is_set():
            raise self._faults.hung_up()

    def _opened(self) -> InputContainer:
        began_s = time.monotonic()
        try:
            return av.open(self._url.with_credentials, options=_OPTIONS, timeout=(OPEN_TIMEOUT_S, READ_TIMEOUT_S))
        except av.error.FFmpegError as error:
            failure = error
        # Out of the handler: a chained exception would show the whole address.
        is_late = time.monotonic() - began_s >= OPEN_TIMEOUT_S
        raise self._faults.not_opened(failure, OPEN_TIMEOUT_S, is_late=is_late)

    def _checked(self, container: InputContainer) -> VideoStream:
        if not container.streams.video:
            raise self._faults.no_video()
        stream = container.streams.video[0]
        if stream.codec_context is None or stream.codec_context.name != "h264":
            raise self._faults.other_codec(stream)
        return stream

    def _guarded(self, units: Iterator[AccessUnit]) -> Iterator[AccessUnit]:
        """The same, with FFmpeg's errors as ours."""
        failure = None
        try:
            yield from units
        except av.error.FFmpegError as error:
            failure = error
        if failure is not None:
            raise self._faults.broke(failure, READ_TIMEOUT_S)

    def _in_line(self, units: Iterator[AccessUnit]) -> Iterator[AccessUnit]:
        """The same, as long as media time goes on with time."""
        before_ns, least_lag_ns = None, None
        for unit in units:
            lag_ns = time.monotonic_ns() - unit.media_ns
            least_lag_ns = lag_ns if least_lag_ns is None else least_lag_ns
            if before_ns is not None and unit.media_ns <= before_ns:
                raise self._faults.times_ran_back((unit.media_ns - before_ns) * 1e-9)
            if lag_ns < least_lag_ns - JUMP_S * 1e9:
                raise self._faults.times_jumped((least_lag_ns - lag_ns) * 1e-9)
            before_ns, least_lag_ns = unit.media_ns, min(lag_ns, least_lag_ns)
            yield unit

    def _timed(self, units: Iterator[AccessUnit]) -> Iterator[StreamEvent]:
        """Packets from the first key frame on, held until their times are known."""
        clock, held = MediaClock(), deque[AccessUnit]()
        opened_s = time.monotonic()
        begun = False
        for unit in units:
            step_s = None if unit.wall_ns is None else clock.add(Report(unit.media_ns, unit.wall_ns))
            if step_s is not None:
                yield ClockStep(self._camera, self._rig_ns(clock, unit), self._camera_id, step_s)
            begun = begun or unit.is_key
            waited_s = time.monotonic() - opened_s
            if begun:
                held.append(unit)
            elif waited_s > KEY_WAIT_S:
                raise self._faults.no_key_frame(KEY_WAIT_S)
            if not clock.is_known and waited_s > REPORT_WAIT_S:
                raise self._faults.no_reports(REPORT_WAIT_S)
            while held and clock.is_known:
                yield self._packet(clock, held.popleft())

    def _packet(self, clock: MediaClock, unit: AccessUnit) -> Packet:
        t_ns = self._rig_ns(clock, unit)
        off_s = (t_ns - unit.receive_ns) * 1e-9
        if abs(off_s) > OFF_S:
            raise self._faults.wrong_clock(off_s, OFF_S, is_measured=self._clock is not None)
        if t_ns <= self._latest_ns:
            if t_ns < self._latest_ns - BEHIND_S * 1e9:
                raise self._faults.clock_set_back((t_ns - self._latest_ns) * 1e-9)
            t_ns = self._latest_ns + 1
        self._latest_ns = t_ns
        return Packet(
            self._camera, next(self._numbers), t_ns, unit.receive_ns, unit.encoded, "h264", is_key=unit.is_key
        )

    def _rig_ns(self, clock: MediaClock, unit: AccessUnit) -> int:
        wall_ns = clock.wall_ns(unit.media_ns)
        return wall_ns if self._clock is None else self._clock.rig_time_ns(wall_ns)


def _pauses_s() -> Iterator[float]:
    """Before each attempt after the first."""
    pause_s = BACKOFF_FIRST_S
    while True:
        yield pause_s
        pause_s = min(pause_s * BACKOFF_FACTOR, BACKOFF_CAP_S)
