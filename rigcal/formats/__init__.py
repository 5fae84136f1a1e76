"""Interchange with other calibration tools; what each format's numbers mean is written in its module."""

from __future__ import annotations

from rigcal.formats._registry import FORMATS, Format, export_rig, import_rig

__all__ = ["FORMATS", "Format", "export_rig", "import_rig"]
