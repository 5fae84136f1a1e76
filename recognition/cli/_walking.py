"""The walk of a commissioning beside a run of live cameras: said on the terminal, kept to in a thread of its own."""

from __future__ import annotations

import select
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from recognition.cli._show import echo

if TYPE_CHECKING:
    from recognition.cli._signals import Stop
    from recognition.commissioning import Performed, Walk

_ASK_EVERY_S = 0.1
"""How often it is asked whether the walk is to end."""
OVER = "the end of the walk"


class Walking:
    """Goes through a walk, and ends the run with it."""

    def __init__(self, stop: Stop) -> None:
        self._stop = stop
        self.performed: list[Performed] = []
        """Steps that were done to their end."""

    @contextmanager
    def beside(self, walk: Walk, now_ns: Callable[[], int], *, asks: bool) -> Iterator[None]:
        """Walk as long as the block lasts; where ``asks``, Enter says that all are in place."""
        guide = threading.Thread(target=self._walk, args=(walk, now_ns, asks), name="walk")
        guide.start()
        try:
            yield
        finally:
            self._stop.by = self._stop.by or OVER
            guide.join()

    def _walk(self, walk: Walk, now_ns: Callable[[], int], asks: bool) -> None:
        from recognition.commissioning import walked

        confirmed = self._confirmed if asks else None
        for done in walked(walk, now_ns=now_ns, say=echo, wait=self._wait, confirmed=confirmed):
            self.performed.append(done)
        self._stop.by = self._stop.by or OVER

    def _wait(self, seconds: float) -> bool:
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0 and not self._stop():
            time.sleep(min(left, _ASK_EVERY_S))
        return not self._stop()

    def _confirmed(self) -> bool:
        echo("  press Enter when all are in place")
        while not self._stop():
            if select.select([sys.stdin], [], [], _ASK_EVERY_S)[0]:
                return sys.stdin.readline() != ""
        return False
