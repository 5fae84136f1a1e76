"""Interchange with other calibration tools; what each format's numbers mean is written in its module."""

from __future__ import annotations

from rigcal.formats._exchange import export_rig, import_rig
from rigcal.formats._registry import FORMATS, Format

__all__ = ["FORMATS", "Format", "export_rig", "import_rig"]
