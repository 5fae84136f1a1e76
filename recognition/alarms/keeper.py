"""The thread between a run and its disk: it keeps what waits, notes what was raised and reads what was answered.

A disk that refuses holds nothing up: everything stays in memory and is tried again.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from recognition.alarms.answers import Answers, note_event, read_answers
from recognition.alarms.delivery import Announce
from recognition.alarms.places import ANSWERS_SUFFIX, beside
from recognition.alarms.register import Word
from recognition.alarms.waiting import Waiting

LOOK_S = 1.0
"""How often answers are looked for, and a disk that refused is tried again."""
MOST_NOTES = 10_000
"""That wait for a disk that refuses; of more, the oldest are forgotten."""


class Keeper:
    """Keeps queues on disk, and a recording's notes and answers in step."""

    def __init__(self, queues: Sequence[Waiting], recording: Path, announce: Announce) -> None:
        self._queues, self._recording, self._announce = queues, recording, announce
        self._notes: deque[Word] = deque(maxlen=MOST_NOTES)
        self._woken, self._is_over = threading.Event(), False
        self._seen: tuple[int, int] | None = None
        self._faults: dict[str, str] = {}
        self._thread = threading.Thread(target=self._run, name="alarms-keeper", daemon=True)
        self.answers = Answers()
        """The latest that were read."""

    def start(self) -> None:
        """Begin; the answers that are there are known when this returns."""
        self._look()
        self._thread.start()

    def wake(self) -> None:
        """Something is to be put on disk; never waits."""
        self._woken.set()

    def note(self, word: Word) -> None:
        """Write this down beside the recording; never waits."""
        self._notes.append(word)
        self.wake()

    def stop(self, timeout_s: float) -> None:
        """Put everything on disk and end; a disk that hangs is left to it after the time."""
        self._is_over = True
        self.wake()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while not self._is_over:
            self._woken.wait(LOOK_S)
            self._woken.clear()
            self._sync()
            self._write_notes()
            self._look()
        self._sync()
        self._write_notes()
        for queue in self._queues:
            queue.close()

    def _sync(self) -> None:
        for queue in self._queues:
            queue.sync()
        fault = next((queue.fault for queue in self._queues if queue.fault is not None), None)
        self._say("what waits to be sent is not on disk and would be lost with this process", fault)

    def _write_notes(self) -> None:
        fault = None
        while self._notes and fault is None:
            word = self._notes[0]
            try:
                note_event(self._recording, word.event, word.phase, word.at_ns, word.mute)
                self._notes.popleft()
            except OSError as error:
                fault = error.strerror or str(error)
        self._say("what was raised cannot be noted beside the recording", fault)

    def _look(self) -> None:
        """Read the answers where their file has changed."""
        fault = None
        try:
            found = beside(self._recording, ANSWERS_SUFFIX).stat()
            if (found.st_size, found.st_mtime_ns) != self._seen:
                self.answers = read_answers(self._recording)
                self._seen = (found.st_size, found.st_mtime_ns)
        except FileNotFoundError:
            pass
        except OSError as error:
            fault = error.strerror or str(error)
        self._say("what operators answered cannot be read", fault)
        unreadable = self.answers.unreadable
        self._say("answers of operators are not understood", f"{unreadable} lines" if unreadable else None)

    def _say(self, what: str, fault: str | None) -> None:
        """Announce a fault once, and that it is over."""
        if fault is not None and what not in self._faults:
            self._announce("warning", f"{what}: {fault}")
        elif fault is None and what in self._faults:
            self._announce("info", f"no longer: {what}")
        if fault is None:
            self._faults.pop(what, None)
        else:
            self._faults[what] = fault
