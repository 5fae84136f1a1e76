"""Corners that cameras saw, one row each: what every solve is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.detections import BoardView
from rigcal.geometry import Bools, Floats, Ints, freeze


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Corners seen by cameras, sorted by (camera, board): one row per corner.

    Raises:
        ValueError: for rows out of order or arrays of unequal length.
    """

    corners_in_board: Floats
    """(K, 3) corners of the board in metres."""
    camera_idx: Ints
    """(N,) which camera."""
    board_idx: Ints
    """(N,) which board position."""
    frame_idx: Ints
    """(N,) which frame of that camera."""
    corner_ids: Ints
    """(N,) which corner of the board."""
    pixels: Floats
    """(N, 2) distorted pixels."""
    weights: Floats
    """(N,) how much each counts: the variance of a still, sharp corner over its own; 1 where nothing else is known."""

    def __post_init__(self) -> None:
        count = len(self.camera_idx)
        order = np.lexsort((self.board_idx, self.camera_idx))
        if (np.diff(order) < 0).any():
            raise ValueError("observations must be sorted by camera, then board")
        freeze(self, np.float64, corners_in_board=(None, 3), pixels=(count, 2), weights=(count,))
        freeze(self, np.int64, camera_idx=(count,), board_idx=(count,), frame_idx=(count,), corner_ids=(count,))

    @classmethod
    def of(
        cls,
        corners_in_board: Floats,
        entries: Sequence[tuple[int, int, BoardView]],
        weights: Mapping[tuple[int, int], float] | None = None,
    ) -> Observations:
        """From (camera index, board index, view) entries in any order; ``weights`` by (camera, board), 1 if absent."""
        entries = sorted(entries, key=lambda entry: entry[:2])
        sizes = [len(view.corner_ids) for _, _, view in entries]

        def repeated(values: Sequence[int]) -> Ints:
            return np.repeat(np.asarray(values, dtype=np.int64), sizes)

        return cls(
            corners_in_board,
            repeated([camera for camera, _, _ in entries]),
            repeated([board for _, board, _ in entries]),
            repeated([view.frame_idx for _, _, view in entries]),
            np.concatenate([view.corner_ids for _, _, view in entries] or [np.zeros(0, dtype=np.int64)]),
            np.concatenate([view.corners_px for _, _, view in entries] or [np.zeros((0, 2))]),
            np.repeat([(weights or {}).get((camera, board), 1.0) for camera, board, _ in entries], sizes),
        )

    def __len__(self) -> int:
        return len(self.camera_idx)

    @property
    def points_in_board(self) -> Floats:
        """(N, 3) metres."""
        return np.asarray(self.corners_in_board[self.corner_ids])

    def subset(self, keep: Bools) -> Observations:
        """The rows where ``keep`` (N,) is true."""
        return Observations(
            self.corners_in_board,
            self.camera_idx[keep],
            self.board_idx[keep],
            self.frame_idx[keep],
            self.corner_ids[keep],
            self.pixels[keep],
            self.weights[keep],
        )

    def placed(self, jobs: Sequence[Sequence[int]]) -> Observations:
        """Some views again, each group on a board of its own: ``jobs[b]`` lists its views (see ``view_starts``)."""
        ends = np.append(self.view_starts, len(self))
        rows = [(np.arange(ends[v], ends[v + 1]), b) for b, views in enumerate(jobs) for v in views]
        row = np.concatenate([r for r, _ in rows])
        board_idx = np.repeat([b for _, b in rows], [len(r) for r, _ in rows])
        order = np.lexsort((board_idx, self.camera_idx[row]))
        chosen = row[order]
        return Observations(
            self.corners_in_board,
            self.camera_idx[chosen],
            board_idx[order],
            self.frame_idx[chosen],
            self.corner_ids[chosen],
            self.pixels[chosen],
            self.weights[chosen],
        )

    @property
    def view_starts(self) -> Ints:
        """(W,) first row of each view: a run of rows with one camera and one board."""
        key = self.camera_idx * (self.board_idx.max(initial=0) + 1) + self.board_idx
        return np.asarray(np.flatnonzero(np.concatenate([[len(key) > 0], np.diff(key) != 0])))
