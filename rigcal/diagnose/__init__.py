"""Why no board is found, or another one than was given: named with counts and measures, in seconds."""

from rigcal.diagnose.check import check_boards

__all__ = ["check_boards"]
