"""Clocks: hosts that do not answer, samples and content that do not give a clock."""

from __future__ import annotations

from rigcal.errors._base import RigcalError


class SyncError(RigcalError):
    """Clocks that cannot be measured from what was given."""
