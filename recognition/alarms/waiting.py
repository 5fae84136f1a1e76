"""The messages that wait for one target, in order: in memory for whoever delivers, on disk for the next run.

Decision: memory leads and the disk follows. A message can be delivered as soon as it was put, and is on disk a moment
later, by a thread that does nothing else; so neither the run nor a delivery ever waits for a disk, and a full one costs
durability, which is said, but no alarm. The alternative, disk first, would hold an alarm up for as long as a recording
at full speed holds up the disk. It costs that a process killed within that moment forgets the message, and that one
killed between a delivery and its record says it again, under the same ``message_id``.
"""

from __future__ import annotations

import threading
from pathlib import Path

from recognition.alarms.journal import Done, Journal, Put, Record, replay
from recognition.alarms.messages import Message

SLACK = 256
"""Records that a file may hold beyond two for each message that waits: 0.1 MB, where one of an event takes 0.8 kB."""


class Waiting:
    """A queue that outlasts its process; methods other than :meth:`sync` and :meth:`close` are for any thread."""

    def __init__(self, path: Path, *, most: int) -> None:
        """Open it, with what an earlier process left.

        Args:
            path: Its file.
            most: How many messages may wait; of more, the oldest are given up.

        Raises:
            OSError: where the file cannot be read or written.
        """
        self._lock = threading.Lock()
        self._journal, self._most = Journal(path), most
        found = replay(path)
        self._waiting: dict[int, Message] = {put.number: put.message for put in found.waiting}
        self._next = max(self._waiting, default=0) + 1
        self._changes: list[Record] = []
        self._must_rewrite = False
        self.lost = found.damaged
        """Messages that were given up: too many waited, the target refused them, or the disk had damaged them."""
        self.fault: str | None = None
        """Why what waits is not on disk; None where it is."""
        self._journal.rewrite(self._snapshot())

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, message: Message) -> None:
        """Add a message at the end."""
        with self._lock:
            put = Put(self._next, message)
            self._next += 1
            self._waiting[put.number] = message
            self._changes.append(put)
            if len(self._waiting) > self._most:
                self._remove(next(iter(self._waiting)))
                self.lost += 1

    def first(self) -> Put | None:
        """The message that has waited longest; None where none waits."""
        with self._lock:
            number = next(iter(self._waiting), None)
            return None if number is None else Put(number, self._waiting[number])

    def done(self, put: Put, *, is_lost: bool = False) -> None:
        """A message was delivered, or given up."""
        with self._lock:
            self._remove(put.number)
            self.lost += is_lost

    def sync(self) -> None:
        """Put on disk what has changed; where that fails, ``fault`` says why and everything is written the next time.
        For one thread."""
        with self._lock:
            changes, self._changes = self._changes, []
            is_long = self._journal.records > 2 * len(self._waiting) + SLACK
            kept = self._snapshot() if self._must_rewrite or is_long else None
        try:
            if kept is not None:
                self._journal.rewrite(kept)
            elif changes:
                self._journal.append(changes)
        except OSError as error:
            self._must_rewrite, self.fault = True, error.strerror or str(error)
            return
        self._must_rewrite, self.fault = False, None

    def close(self) -> None:
        """Put the last changes on disk and let go of the file; after it nothing more is kept."""
        self.sync()
        self._journal.close()

    def _remove(self, number: int) -> None:
        if self._waiting.pop(number, None) is not None:
            self._changes.append(Done((number,)))

    def _snapshot(self) -> list[Record]:
        return [Put(number, message) for number, message in self._waiting.items()]
