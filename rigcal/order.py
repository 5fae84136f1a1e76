"""The orders in which a finder may give the corners of a board that looks alike when it is turned.

A checkerboard's colours tell its two ends apart only where its counts of columns and rows differ in parity, and a
square one looks alike turned by 90 degrees too. So a view's corners may be numbered from the wrong end; the relative
pose of two cameras, which several views must agree on, tells which views are (:mod:`rigcal.pairwise`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigcal.board import Board, Checkerboard
from rigcal.detections import BoardView, Finding
from rigcal.geometry import Ints

_TURNS = (0, 2, 1, 3)  # quarter turns, the likelier first


def corner_orders(board: Board) -> tuple[Ints, ...]:
    """Each (K,): the corner that the finder's corner ``i`` may truly be; the first is the order as found.

    Boards with markers have one order. Checkerboards have two (turned by 180 degrees), square ones four.
    """
    ids = np.arange(len(board.corners_in_board))
    if not isinstance(board, Checkerboard):
        return (ids,)
    grid = ids.reshape(board.rows, board.columns)
    turns = _TURNS if board.rows == board.columns else _TURNS[:2]
    return tuple(np.rot90(grid, turn).ravel() for turn in turns)


def reordered(view: BoardView, order: Ints) -> BoardView:
    """The same pixels with the corners numbered by ``order`` (K,)."""
    ids = order[view.corner_ids]
    rank = np.argsort(ids)
    return replace(view, corner_ids=ids[rank], corners_px=view.corners_px[rank])


def turned_finding(frame: str, order_idx: int, partners: Sequence[str]) -> Finding:
    """What to tell of a view whose corners were numbered anew."""
    against = f" against {', '.join(partners)}" if partners else ""
    return Finding(frame, "unflipped", f"corner order turned by {90 * _TURNS[order_idx]} degrees{against}")


def quarter_turns(order_idx: int, *, minus: int) -> int:
    """Index of the order that takes order ``minus`` to ``order_idx``."""
    return _TURNS.index((_TURNS[order_idx] - _TURNS[minus]) % 4)
