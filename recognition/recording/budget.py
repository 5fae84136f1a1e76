"""How much of the disk a recording may take, and what gives way when that is used up.

Two policies, stated by whoever starts the run. ``newest``: the oldest finished segment of the run is deleted, so that
the disk always holds the latest hours. ``oldest``: the recording ends, whole, and what it holds stays; recognition
goes on. Without one, a recording ends as with ``oldest``, but a run that is known not to fit is refused at its start.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from recognition.errors import NoRoomError
from rigcal.errors import OptionError

RESERVE_BYTES = 256_000_000
"""What is left free for the rest of the system, and for the end of the recording: its index and what is not yet on
the disk when the room is asked for, once a second or every :data:`LOOK_BYTES`."""
LOOK_BYTES = 64_000_000
LOOK_S = 1.0

Keep = Literal["newest", "oldest"]


@dataclass(frozen=True, slots=True)
class DiskBudget:
    """What one run may take.

    Raises:
        OptionError: where ``max_bytes`` is no positive number.
    """

    max_bytes: int | None = None
    """Of all its files together; None: what the disk has, less :data:`RESERVE_BYTES`."""
    keep: Keep | None = None
    """What stays when it is used up; None: as ``oldest``, and a run that cannot fit is refused."""

    def __post_init__(self) -> None:
        if self.max_bytes is not None and self.max_bytes <= 0:
            raise OptionError("max_bytes", expected="a size above 0", got=self.max_bytes)

    def shortage(self, used_bytes: int, free_bytes: int) -> str | None:
        """Why no more may be recorded, in words; None where more may.

        Args:
            used_bytes: what the files of the run take.
            free_bytes: what the disk has left.
        """
        if self.max_bytes is not None and used_bytes >= self.max_bytes:
            return f"its {in_bytes(self.max_bytes)} are used up"
        if free_bytes <= RESERVE_BYTES:
            return f"the disk has {in_bytes(free_bytes)} left, and {in_bytes(RESERVE_BYTES)} are kept free"
        return None

    def room(self, free_bytes: int) -> int:
        """How many bytes may be recorded on a disk with so many free."""
        room = max(0, free_bytes - RESERVE_BYTES)
        return room if self.max_bytes is None else min(room, self.max_bytes)


def require_room(path: Path, budget: DiskBudget, expected_bytes: int | None) -> str | None:
    """Look at the disk before a recording starts.

    Args:
        path: the recording to be.
        budget: what it may take.
        expected_bytes: what the whole run is likely to take; None where nobody knows.

    Returns:
        what will give way, in words; None where everything fits, or nobody knows.

    Raises:
        NoRoomError: where there is no room to start, or a run without a policy will not fit.
    """
    free_bytes = free_on_disk(path)
    room = budget.room(free_bytes)
    got = f"{in_bytes(free_bytes)} free, of which {in_bytes(room)} may be recorded"
    if room == 0:
        raise NoRoomError(
            "the disk has no room for a recording",
            where=path.parent,
            expected=f"more than {in_bytes(RESERVE_BYTES)} free",
            got=got,
            do_next="free some space, or record to another disk with -o",
        )
    if expected_bytes is None or expected_bytes <= room:
        return None
    if budget.keep is None:
        raise NoRoomError(
            "the recording will not fit",
            where=path.parent,
            expected=f"room for about {in_bytes(expected_bytes)}",
            got=got,
            do_next="free some space, or say what gives way: --keep newest with --segment, or --keep oldest",
        )
    gives_way = (
        "the oldest segments are deleted" if budget.keep == "newest" else "recording ends and recognition goes on"
    )
    return f"the run takes about {in_bytes(expected_bytes)} and may take {in_bytes(room)}: from there on, {gives_way}"


def free_on_disk(path: Path) -> int:
    """Bytes that the disk of a recording has left."""
    return shutil.disk_usage(path.parent).free


def in_bytes(count: int) -> str:
    """A size for people."""
    return f"{count / 1e9:.3g} GB" if count >= 1e8 else f"{count / 1e6:.3g} MB"
