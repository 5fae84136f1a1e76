"""What workers are called: ``worker 1``, ``worker 2``, ... within a shift, and nothing that outlasts it.

A track number is given once in a run, which may go on for weeks; told to others, it would let a worker be followed
over days. Here numbers begin anew with each shift, in the order in which the shift's workers are first named, and what
was called what is forgotten. Nobody is recognised: a worker who leaves and comes back is another one. The recording
calls the same worker by the number of the track; what joins the two is the event's identity.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from datetime import UTC, datetime, time, timedelta, tzinfo

from recognition.events import Actor


class ShiftNames:
    """Names of actors within shifts; the same calls in the same order give the same names."""

    def __init__(self, starts: Sequence[time] = (time(0, 0),), zone: tzinfo = UTC) -> None:
        """Number workers anew at these times of the day.

        Args:
            starts: When the shifts begin, in order of the day.
            zone: Of those times.
        """
        self._starts, self._zone = tuple(starts), zone
        self._numbers: dict[str, dict[int, int]] = {}

    def shift(self, t_ns: int) -> str:
        """The shift of a rig time: when it began, as ``2026-11-22 06:00``."""
        local = datetime.fromtimestamp(t_ns // 1_000_000_000, self._zone)
        index = bisect_right(self._starts, local.time()) - 1
        day = local.date() if index >= 0 else local.date() - timedelta(days=1)
        return f"{day} {self._starts[index]:%H:%M}"

    def name(self, actor: Actor, t_ns: int) -> str:
        """``worker 3``, with the number of the shift of ``t_ns``; ``ladder 2`` with its track's for an object.

        Of two shifts names are known, so that what began in the last one still ends under its name.
        """
        if actor.kind != "worker":
            return f"{actor.kind} {actor.track_id}"
        numbers = self._numbers.setdefault(self.shift(t_ns), {})
        while len(self._numbers) > 2:
            del self._numbers[min(self._numbers)]
        return f"{actor.kind} {numbers.setdefault(actor.track_id, len(numbers) + 1)}"
