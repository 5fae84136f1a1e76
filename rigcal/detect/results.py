"""What was searched and found in the frames of one file, and how it is kept in the cache."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.detect.found import FoundBoard

UNSEARCHED, QUICK, THOROUGH = range(3)


@dataclass(slots=True)
class FileResults:
    """Filled while a file is searched."""

    effort: list[int]
    """How each frame was searched: ``UNSEARCHED``, ``QUICK`` or ``THOROUGH``."""
    boards: dict[int, FoundBoard] = field(default_factory=dict)
    """By frame of the file."""

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """The same as arrays, for the cache."""
        frames = sorted(self.boards)
        boards = [self.boards[frame] for frame in frames]
        return {
            "effort": np.array(self.effort, dtype=np.int8),
            "frames": np.array(frames, dtype=np.int64),
            "counts": np.array([len(board.corner_ids) for board in boards], dtype=np.int64),
            "corner_ids": np.concatenate([np.zeros(0, np.int64), *(board.corner_ids for board in boards)]),
            "corners_px": np.concatenate([np.zeros((0, 2)), *(board.corners_px for board in boards)]),
            "turned": np.array([board.turned for board in boards], dtype=np.bool_),
            "problem": np.array([board.problem for board in boards], dtype=np.str_),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]] | None, frame_count: int) -> FileResults:
        """What the cache holds; nothing searched where it holds nothing, or an entry that does not fit together."""
        empty = cls([UNSEARCHED] * frame_count)
        if arrays is None:
            return empty
        try:
            effort, frames, counts = (arrays[name].tolist() for name in ("effort", "frames", "counts"))
            ends = np.cumsum(arrays["counts"])[:-1]
            ids, corners = np.split(arrays["corner_ids"], ends), np.split(arrays["corners_px"], ends)
            rows = zip(frames, counts, ids, corners, arrays["turned"], arrays["problem"], strict=True)
            boards = {frame: FoundBoard(i, c, bool(t), str(p)) for frame, n, i, c, t, p in rows if len(i) == len(c) == n}
        except (KeyError, ValueError, IndexError):
            return empty
        return cls(effort, boards) if len(effort) == frame_count and len(boards) == len(frames) else empty
