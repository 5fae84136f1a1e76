"""Ctrl-C, and what ends services: asked for between instants, so that a run ends with a finished recording."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

_WORDS = {signal.SIGINT: "the keyboard", signal.SIGTERM: "the system (SIGTERM)"}


class Stop:
    """Whether somebody wants the run to end."""

    def __init__(self) -> None:
        self.by: str | None = None
        """Who, in words."""

    def __call__(self) -> bool:
        return self.by is not None


@contextmanager
def stop_on_signal() -> Iterator[Stop]:
    """Ctrl-C and SIGTERM are noted instead of ending the process."""
    stop = Stop()

    def note(number: int, _frame: object) -> None:
        stop.by = _WORDS[signal.Signals(number)]

    before = {number: signal.signal(number, note) for number in _WORDS}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
