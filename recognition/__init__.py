"""recognition: the multi-view runtime that consumes a rig file and records workers and objects to MCAP."""

from rigcal import __version__

__all__ = ["__version__"]
