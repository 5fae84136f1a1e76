"""What happened during a live run, from many threads to the one that writes and shows it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

Level = Literal["info", "warning", "error"]
_CAPACITY = 1000
"""Entries that nobody has read; beyond it the oldest are given up, for a run must not grow."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One thing that happened."""

    t_ns: int
    """When, rig time."""
    level: Level
    text: str


class Journal:
    """Any thread may say something; one reads."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._entries: deque[Entry] = deque(maxlen=_CAPACITY)

    def say(self, level: Level, text: str) -> None:
        """Note something, at the present rig time."""
        self._entries.append(Entry(self._now_ns(), level, text))

    def read(self) -> Iterator[Entry]:
        """What was said since the last reading, in order of time."""
        while self._entries:
            yield self._entries.popleft()
