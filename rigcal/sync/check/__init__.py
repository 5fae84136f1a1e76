"""The check before a recording: what was read of every camera's clock, stamps and pictures, judged in millimetres."""

from rigcal.sync.check.findings import Colour, Finding, worst
from rigcal.sync.check.judge import CameraCheck, SyncCheck, check_sync
from rigcal.sync.check.readings import CameraReadings, HostReading, StampReading

__all__ = [
    "CameraCheck",
    "CameraReadings",
    "Colour",
    "Finding",
    "HostReading",
    "StampReading",
    "SyncCheck",
    "check_sync",
    "worst",
]
