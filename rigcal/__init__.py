"""rigcal: calibrate, synchronise and check a rig of cameras; the result is one validated rig file."""

__version__ = "0.1.0"
__all__ = ["__version__"]
