"""Clocks from a board that is carried about."""

from rigcal.sync.content.board.follow import FrameBudget, board_lags, board_tracks

__all__ = ["FrameBudget", "board_lags", "board_tracks"]
