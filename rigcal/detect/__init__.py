"""From images to board views: finders, the fit that judges them, and the sweep over a capture."""

from rigcal.detect.found import FoundBoard
from rigcal.detect.sweep import detect_boards, find_board

__all__ = ["FoundBoard", "detect_boards", "find_board"]
