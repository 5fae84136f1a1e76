"""Whether the site is monitored, as far as the run says it: one that has fallen silent is NOT MONITORED."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from recognition.alarms.messages import Health

if TYPE_CHECKING:
    from recognition.observations import Status

STARTING = Health("NOT MONITORED", "the run has started and has no result yet")
ENDED = Health("NOT MONITORED", "the run has ended")
FAILED = Health("NOT MONITORED", "the run has failed")
LAST_WORDS = (ENDED, FAILED)
DIED = Health("NOT MONITORED", "the connection to the run was lost: it was killed, or the network is down")


class Pulse:
    """The latest word of the run; for any thread."""

    def __init__(self, silence_s: float) -> None:
        self._silence_s = silence_s
        self._lock = threading.Lock()
        self._said, self._said_s = STARTING, time.monotonic()
        self._last_word: Health | None = None

    def beat(self, status: Status, reason: str) -> bool:
        """The run says how the site is monitored; returns whether that is another status than before."""
        with self._lock:
            now_s = time.monotonic()
            before = self._health(now_s).status
            self._said, self._said_s = Health(status, reason), now_s
            return before != status

    def end(self, *, has_failed: bool) -> None:
        """The run ends, and the site is NOT MONITORED from here on."""
        with self._lock:
            self._last_word = FAILED if has_failed else ENDED

    def health(self) -> Health:
        """How it stands now."""
        with self._lock:
            return self._health(time.monotonic())

    def silent_in_s(self) -> float:
        """When the run will have been silent for too long if it says nothing, in seconds from now; 0 or less where it
        has been."""
        with self._lock:
            return self._said_s + self._silence_s - time.monotonic()

    def _health(self, now_s: float) -> Health:
        if self._last_word is not None:
            return self._last_word
        if now_s - self._said_s >= self._silence_s:
            return Health("NOT MONITORED", f"the run has said nothing for {self._silence_s:g} s")
        return self._said
