"""What is wrong with a camera's synchronisation, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Colour(StrEnum):
    """The light that a technician sees."""

    GREEN = "green"
    """Checked and within its limit."""
    AMBER = "amber"
    """Something is not known or will not last; a recording can be used."""
    RED = "red"
    """A recording made now would be wrong."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is not as it should be."""

    fault: str
    """Its name, for programs: ``dead host``, ``stepped clock``, ``offset``, ``drift``, ``dropped frames``, ..."""
    colour: Colour
    what: str
    """What was found, with figures."""
    do_next: str
    """What to do about it."""


def worst(colours: Iterable[Colour]) -> Colour:
    """The worst of several; green where there is none."""
    order = list(Colour)
    return max(colours, key=order.index, default=Colour.GREEN)


def duration(seconds: float) -> str:
    """A time in words: ``250 ms``, ``40 s``, ``12 min``, ``3.5 h``, ``2.1 days``."""
    for limit, scale, unit in ((1.0, 1e-3, "ms"), (120.0, 1.0, "s"), (7200.0, 60.0, "min"), (172800.0, 3600.0, "h")):
        if abs(seconds) < limit:
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds / 86400:.3g} days"
