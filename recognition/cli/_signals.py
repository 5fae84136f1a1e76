"""Ctrl-C, and what ends services and terminals: asked for between instants, so that the recording is finished."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

_WORDS = {
    signal.SIGINT: "the keyboard",
    signal.SIGTERM: "the system (SIGTERM)",
    signal.SIGHUP: "the end of its terminal (SIGHUP)",
}


class Stop:
    """Whether somebody wants the run to end."""

    def __init__(self) -> None:
        self.by: str | None = None
        """Who, in words."""

    def __call__(self) -> bool:
        return self.by is not None


@contextmanager
def stop_on_signal() -> Iterator[Stop]:
    """Ctrl-C, SIGTERM and SIGHUP are noted instead of ending the process; under ``nohup`` SIGHUP stays ignored."""
    stop = Stop()

    def note(number: int, _frame: object) -> None:
        stop.by = _WORDS[signal.Signals(number)]

    is_kept = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    noted = [number for number in _WORDS if not (number is signal.SIGHUP and is_kept)]
    before = {number: signal.signal(number, note) for number in noted}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
