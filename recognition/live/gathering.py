"""From the decoded frames of every camera to the newest frame set.

Decoders hand frames in, one consumer takes sets out. There is room for one set: where the consumer is late, a newer
set takes the place of one that nobody took, which is thereby skipped as a whole, and counted. So nothing that is looked
at is older than it must be, and nothing piles up.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from threading import Condition
from typing import Generic, NamedTuple, TypeVar

from recognition.grouping import Group, Grouper, GroupingOptions
from recognition.monitoring import LEAST_CAMERAS

T = TypeVar("T")


class Numbered(NamedTuple, Generic[T]):
    """A frame set and its number among all, from 0."""

    number: int
    group: Group[T]


class Gathering(Generic[T]):
    """Frames of ``cameras`` cameras in, sets out; safe to use from several threads."""

    def __init__(self, cameras: Iterable[int], count: int, options: GroupingOptions) -> None:
        """Gather.

        Args:
            cameras: Indices of those that will send.
            count: How many the rig has.
            options: How long frames wait for each other.
        """
        self._changed = Condition()
        self._grouper: Grouper[T] = Grouper(count, options)
        self._sending = set(cameras)
        self._there: set[int] = set()
        self._newest: Numbered[T] | None = None
        self._last_ns: int | None = None
        self.sets = 0
        """Frame sets that there were."""
        self.skipped = 0
        """Those that nobody took before a newer one was there."""
        self.alone = 0
        """Frames without a partner of another camera while there were others, or older than a set that had left."""
        self.late = [0] * count
        """Frames per camera that came after their set had left."""

    def add(self, camera: int, t_ns: int, frame: T) -> None:
        """Hand in a frame of a camera, taken at a rig time."""
        with self._changed:
            now_ns = time.monotonic_ns()
            self._there.add(camera)
            if not self._grouper.add(camera, t_ns, frame, now_ns):
                self.late[camera] += 1
            self._collect(now_ns)

    def lose(self, camera: int) -> None:
        """Wait no longer for a camera until it sends again."""
        with self._changed:
            self._there.discard(camera)
            self._grouper.lose(camera)
            self._changed.notify()

    def end(self, camera: int) -> None:
        """A camera will send no more; what the others send beside its last frames is not for the networks."""
        with self._changed:
            self._sending.discard(camera)
            self._grouper.lose(camera)
            if not self._sending:
                for group in self._grouper.rest():
                    self._offer(group)
            self._changed.notify()

    def take(self, timeout_s: float) -> Numbered[T] | None:
        """The newest set, which nobody took before; None where there is none within the time, or ever again."""
        until_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        with self._changed:
            while True:
                now_ns = time.monotonic_ns()
                self._collect(now_ns)
                if self._newest is not None or not self._sending or now_ns >= until_ns:
                    taken, self._newest = self._newest, None
                    return taken
                due_ns = self._grouper.due_ns()
                self._changed.wait((min(until_ns, due_ns or until_ns) - now_ns) * 1e-9)

    @property
    def is_over(self) -> bool:
        """Whether every camera has ended and the last set was taken."""
        with self._changed:
            return not self._sending and self._newest is None

    def _collect(self, now_ns: int) -> None:
        for group in self._grouper.groups(now_ns):
            self._offer(group)

    def _offer(self, group: Group[T]) -> None:
        is_old = self._last_ns is not None and group.t_ns <= self._last_ns
        if is_old or group.cameras < min(LEAST_CAMERAS, len(self._there)):
            self.alone += group.cameras
            return
        self._last_ns = group.t_ns
        self.skipped += self._newest is not None
        self._newest = Numbered(self.sets, group)
        self.sets += 1
        self._changed.notify()
