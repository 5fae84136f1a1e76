"""Alarms of a run: opened before it begins, told of its scenes and events, and what they say of themselves."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from recognition.cli._show import echo

if TYPE_CHECKING:
    from recognition.alarms import AlarmOptions, Alarms
    from recognition.events import Event
    from recognition.observations import Scene
    from recognition.recording import Phase

Record = Callable[[str, str], None]


class Alarming:
    """The alarms of a run; without options there are none, and nothing comes of what they are told.

    Args:
        options: Of the alarms file.
        recording: ``NAME.mcap``, as the run records it.

    Raises:
        AlarmsError: where their queue cannot be used.
    """

    def __init__(self, options: AlarmOptions | None, recording: Path) -> None:
        self._voice = _Voice()
        self._alarms: Alarms | None = None
        if options is not None:
            from recognition.alarms import Alarms

            self._alarms = Alarms(options, recording, announce=self._voice)
        self.at_ns: int | None = None
        """Time of the latest scene."""

    @contextmanager
    def running(self, record: Record) -> Iterator[None]:
        """Deliver alarms as long as the block lasts, which is within that of the recorder that ``record`` writes to."""
        if self._alarms is None:
            yield
            return
        with self._voice.recorded(record), self._alarms:
            yield

    def scene(self, scene: Scene) -> None:
        """The next scene, NOT MONITORED ones among them."""
        self.at_ns = scene.t_ns
        if self._alarms is not None:
            self._alarms.heartbeat(scene.status, scene.reason, scene.t_ns)

    def event(self, event: Event, phase: Phase) -> None:
        """A word on an event."""
        if self._alarms is not None and phase != "lasting":
            self._alarms.raise_(event)


class _Voice:
    """What alarms say of their targets, on standard error and, while there is one, in the recording; for any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._record: Record | None = None
        self._unrecorded: list[tuple[str, str]] = []

    def __call__(self, level: str, text: str) -> None:
        echo(text if level == "info" else f"{level}: {text}")
        with self._lock:
            if self._record is None:
                self._unrecorded.append((level, text))
            else:
                self._record(level, text)

    @contextmanager
    def recorded(self, record: Record) -> Iterator[None]:
        """Record what is said, and what was said before, as long as the block lasts."""
        with self._lock:
            self._record = record
            for level, text in self._unrecorded:
                record(level, text)
            self._unrecorded = []
        try:
            yield
        finally:
            with self._lock:
                self._record = None
