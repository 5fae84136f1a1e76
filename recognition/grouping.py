"""Frames of several cameras into instants while they arrive: in rig time, with a wait that is bounded.

The rule is that of captures on disk (:mod:`rigcal.instants`): one to one, the nearest within half a frame period of
the frame of the first camera that is there. What is known only later on disk is decided here as soon as it can be: an
instant leaves when every camera has given its frame, or can no longer give one because a later frame of it is there,
or is not waited for. A camera is not waited for when it is known to be lost, has been silent for
:attr:`GroupingOptions.silent_s`, or the instant has waited for :attr:`GroupingOptions.wait_s` since its first frame
arrived; one that comes too late for its instant is refused, for an instant is never changed.

Nothing here knows threads or clocks: times of arrival are handed in, of any clock that does not step.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from statistics import median
from typing import Generic, NamedTuple, TypeVar

from rigcal.errors import OptionError

T = TypeVar("T")
_SPACINGS = 31
"""Of a camera's frames, by whose median its period is known: one second at 30 fps."""


@dataclass(frozen=True, slots=True)
class GroupingOptions:
    """How long frames wait for each other.

    Raises:
        OptionError: where a time or rate is not above 0.
    """

    wait_s: float = 0.1
    """For what is missing, from the arrival of an instant's first frame: the bound of what grouping adds to the time
    from capture to track. Encoders and networks deliver cameras some 10 ms apart, seldom 100."""
    silent_s: float = 0.5
    """After which a camera is not waited for, until it sends again."""
    fps: float = 30.0
    """Frame rate until two frames of a camera tell it."""

    def __post_init__(self) -> None:
        for name in ("wait_s", "silent_s", "fps"):
            if not 0 < getattr(self, name) < float("inf"):
                raise OptionError(name, expected="a number above 0", got=getattr(self, name))


@dataclass(frozen=True, slots=True)
class Group(Generic[T]):
    """The frames of one instant."""

    t_ns: int
    """Mean of the times of the frames, rig time."""
    times_ns: tuple[int | None, ...]
    """(V,) rig time of each camera's frame; None where it has none."""
    frames: tuple[T | None, ...]
    """(V,) what was handed in for each camera."""

    @property
    def cameras(self) -> int:
        """How many cameras have a frame."""
        return sum(t_ns is not None for t_ns in self.times_ns)


class _Waiting(NamedTuple, Generic[T]):
    t_ns: int
    arrived_ns: int
    frame: T


class _Head(NamedTuple, Generic[T]):
    """The next instant, as far as it is there."""

    frames: tuple[_Waiting[T] | None, ...]
    anchor_ns: int
    """Rig time of the frame that the others are near to."""
    arrived_ns: int
    """When the first of them did."""


class _Camera(Generic[T]):
    """What is remembered of one camera."""

    def __init__(self) -> None:
        self.waiting: deque[_Waiting[T]] = deque()
        self.spacings_ns: deque[int] = deque(maxlen=_SPACINGS)
        self.last_ns: int | None = None
        """Rig time of its latest frame."""
        self.arrived_ns: int | None = None
        """When that came; where nothing has come yet, silence counts from the first frame of any camera."""
        self.there = True
        """Whether it is waited for, unless it falls silent."""
        self.floor_ns: int | None = None
        """Frames up to here are of instants that have left."""


class Grouper(Generic[T]):
    """Groups the frames of ``cameras`` cameras; the frames of each come in order of time."""

    def __init__(self, cameras: int, options: GroupingOptions | None = None) -> None:
        self._options = options or GroupingOptions()
        self._cameras: tuple[_Camera[T], ...] = tuple(_Camera() for _ in range(cameras))
        self._period_ns = round(1e9 / self._options.fps)
        self._began_ns: int | None = None

    def add(self, camera: int, t_ns: int, frame: T, now_ns: int) -> bool:
        """Hand in a frame of a camera, taken at ``t_ns`` and arrived at ``now_ns``; False: its instant has left."""
        self._began_ns = now_ns if self._began_ns is None else self._began_ns
        one = self._cameras[camera]
        one.there, one.arrived_ns = True, now_ns
        if one.last_ns is not None and 0 < t_ns - one.last_ns < self._options.silent_s * 1e9:
            one.spacings_ns.append(t_ns - one.last_ns)
            self._period_ns = min(round(median(c.spacings_ns)) for c in self._cameras if c.spacings_ns)
        one.last_ns = t_ns if one.last_ns is None else max(t_ns, one.last_ns)
        if one.floor_ns is not None and t_ns <= one.floor_ns:
            return False
        one.waiting.append(_Waiting(t_ns, now_ns, frame))
        return True

    def lose(self, camera: int) -> None:
        """Wait for a camera no longer, until its next frame."""
        self._cameras[camera].there = False

    def groups(self, now_ns: int) -> Iterator[Group[T]]:
        """The instants that leave at ``now_ns``, in order of time."""
        while (head := self._head()) is not None and self._is_ready(head, now_ns):
            yield self._leave(head)

    def rest(self) -> Iterator[Group[T]]:
        """What still waits, when no more frames will come."""
        for camera in range(len(self._cameras)):
            self.lose(camera)
        yield from self.groups(0)

    def due_ns(self) -> int | None:
        """When the next instant leaves if no frame comes, by the clock of the arrivals; None: none waits."""
        head = self._head()
        return None if head is None else head.arrived_ns + round(self._options.wait_s * 1e9)

    def _head(self) -> _Head[T] | None:
        """Around the first frame of the first camera, but for frames that are older than what belongs to that."""
        firsts_ns = [camera.waiting[0].t_ns for camera in self._cameras if camera.waiting]
        if not firsts_ns:
            return None
        half_ns, anchor_ns, end_ns = self._period_ns / 2, firsts_ns[0], float("inf")
        while older_ns := [t_ns for t_ns in firsts_ns if t_ns < anchor_ns - half_ns]:
            anchor_ns, end_ns = older_ns[0], anchor_ns - half_ns
        frames = tuple(_nearest(camera.waiting, anchor_ns, half_ns, end_ns) for camera in self._cameras)
        return _Head(frames, anchor_ns, min(one.arrived_ns for one in frames if one is not None))

    def _is_ready(self, head: _Head[T], now_ns: int) -> bool:
        if now_ns >= head.arrived_ns + self._options.wait_s * 1e9:
            return True
        return not any(
            one is None and self._may_still_come(camera, head.anchor_ns, now_ns)
            for one, camera in zip(head.frames, self._cameras, strict=True)
        )

    def _may_still_come(self, camera: _Camera[T], anchor_ns: int, now_ns: int) -> bool:
        """Whether a camera is there and has not gone on to a later instant."""
        heard_ns = camera.arrived_ns if camera.arrived_ns is not None else self._began_ns
        if not camera.there or heard_ns is None or now_ns >= heard_ns + self._options.silent_s * 1e9:
            return False
        return camera.last_ns is None or camera.last_ns <= anchor_ns + self._period_ns / 2

    def _leave(self, head: _Head[T]) -> Group[T]:
        """The instant, which waits no more; a frame that is alone closes no other camera's past."""
        known_ns = [one.t_ns for one in head.frames if one is not None]
        end_ns = head.anchor_ns + self._period_ns // 2
        for one, camera in zip(head.frames, self._cameras, strict=True):
            if one is not None:
                camera.floor_ns = one.t_ns
                while camera.waiting and camera.waiting[0].t_ns <= one.t_ns:
                    camera.waiting.popleft()
            elif len(known_ns) > 1:
                camera.floor_ns = max(end_ns, camera.floor_ns or end_ns)
        return Group(
            t_ns=known_ns[0] + round(sum(t_ns - known_ns[0] for t_ns in known_ns) / len(known_ns)),
            times_ns=tuple(None if one is None else one.t_ns for one in head.frames),
            frames=tuple(None if one is None else one.frame for one in head.frames),
        )


def _nearest(waiting: Iterable[_Waiting[T]], t_ns: int, within_ns: float, end_ns: float) -> _Waiting[T] | None:
    """The frame nearest to a time, of those before ``end_ns``; None where none is within."""
    near = [one for one in waiting if abs(one.t_ns - t_ns) <= within_ns and one.t_ns < end_ns]
    return min(near, key=lambda one: abs(one.t_ns - t_ns), default=None)
