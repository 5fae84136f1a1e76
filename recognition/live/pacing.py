"""Files as if they were live: each packet comes when it was taken, by a clock that starts with the first of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from recognition.sources.decoding import Decoder
from recognition.sources.stream import Packet, Stream, StreamEvent


class Pacing:
    """The common clock of ``streams`` files; it starts at ``start_ns`` when all of them are open."""

    def __init__(self, streams: int, start_ns: int) -> None:
        self._start_ns, self._awaited = start_ns, streams
        self._changed = threading.Condition()
        self._origin_ns: int | None = None

    def now_ns(self) -> int:
        """Rig time now; the start as long as not every stream is open."""
        origin_ns = self._origin_ns
        return self._start_ns + (0 if origin_ns is None else time.monotonic_ns() - origin_ns)

    def opened(self) -> None:
        """One more stream is open, or will never be; returns at once."""
        with self._changed:
            self._awaited -= 1
            if self._awaited == 0:
                self._origin_ns = time.monotonic_ns()
                self._changed.notify_all()

    def wait_for(self, t_ns: int, closing: threading.Event) -> None:
        """Wait until it is that time, or ``closing`` is set."""
        with self._changed:
            while self._origin_ns is None and not closing.is_set():
                self._changed.wait(0.1)
        closing.wait(max(t_ns - self.now_ns(), 0) * 1e-9)


class PacedStream:
    """A file's stream, paced; see :class:`recognition.sources.stream.Stream`."""

    def __init__(self, stream: Stream, pacing: Pacing) -> None:
        self._stream, self._pacing = stream, pacing
        self._closing = threading.Event()

    @property
    def camera(self) -> int:
        """Index of the camera in the rig."""
        return self._stream.camera

    def packets(self) -> Iterator[StreamEvent]:
        """The packets, each at its time."""
        is_open = False
        try:
            for event in self._stream.packets():
                if not is_open:
                    is_open = True
                    self._pacing.opened()
                if isinstance(event, Packet):
                    self._pacing.wait_for(event.t_ns, self._closing)
                if self._closing.is_set():
                    return
                yield event
        finally:
            if not is_open:
                self._pacing.opened()

    def decoder(self) -> Decoder:
        """A decoder for these packets."""
        return self._stream.decoder()

    def close(self) -> None:
        """End :meth:`packets` at once."""
        self._closing.set()
        self._stream.close()
