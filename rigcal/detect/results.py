"""What was searched and found in the frames of one camera, and how a file's share of it is kept in the cache."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.detect.found import FoundBoard

UNSEARCHED, QUICK, THOROUGH = range(3)


@dataclass(slots=True)
class Results:
    """Filled while frames are searched."""

    effort: list[int]
    """How each frame was searched: ``UNSEARCHED``, ``QUICK`` or ``THOROUGH``."""
    boards: dict[int, FoundBoard] = field(default_factory=dict)
    """By frame."""

    def part(self, start: int, count: int) -> Results:
        """The results of ``count`` frames from ``start``, counted from 0."""
        boards = {k: self.boards[start + k] for k in range(count) if start + k in self.boards}
        return Results(self.effort[start : start + count], boards)

    @classmethod
    def joined(cls, parts: Sequence[Results]) -> Results:
        """Parts one after the other."""
        whole = cls([])
        for part in parts:
            whole.boards |= {len(whole.effort) + k: board for k, board in part.boards.items()}
            whole.effort += part.effort
        return whole

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """The same as arrays, for the cache."""
        boards = [self.boards[frame] for frame in sorted(self.boards)]
        return {
            "effort": np.array(self.effort, dtype=np.int8),
            "frames": np.array(sorted(self.boards), dtype=np.int64),
            "counts": np.array([len(board.corner_ids) for board in boards], dtype=np.int64),
            "corner_ids": np.concatenate([np.zeros(0, np.int64), *(board.corner_ids for board in boards)]),
            "corners_px": np.concatenate([np.zeros((0, 2)), *(board.corners_px for board in boards)]),
            "turned": np.array([board.turned for board in boards], dtype=np.bool_),
            "problem": np.array([board.problem for board in boards], dtype=np.str_),
            "blur_px": np.array([board.blur_px for board in boards], dtype=np.float64),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]] | None, frame_count: int) -> Results:
        """What the cache holds; nothing searched where it holds nothing, or what does not fit together."""
        nothing = cls([UNSEARCHED] * frame_count)
        if arrays is None or arrays.keys() != nothing.to_arrays().keys():
            return nothing
        ends = np.cumsum(arrays["counts"])
        total = int(ends[-1]) if len(ends) else 0
        boards = len(arrays["frames"])
        fits = (
            len(arrays["effort"]) == frame_count
            and {len(arrays[name]) for name in ("counts", "turned", "problem", "blur_px")} == {boards}
            and len(arrays["corner_ids"]) == total
            and arrays["corners_px"].shape == (total, 2)
        )
        if not fits:
            return nothing
        ids, corners = np.split(arrays["corner_ids"], ends[:-1]), np.split(arrays["corners_px"], ends[:-1])
        told = (arrays["turned"].tolist(), arrays["problem"].tolist(), arrays["blur_px"].tolist())
        rows = zip(arrays["frames"].tolist(), zip(ids, corners, *told, strict=False), strict=False)
        return cls(arrays["effort"].tolist(), {frame: FoundBoard(*fields) for frame, fields in rows})
