"""Identities over time.

:mod:`recognition.tracking.paper` serves the paper's method; the tracked method is
:mod:`recognition.tracking.tracked`.
"""

from recognition.tracking.paper import Candidate, Memory, Sighting, Track, Tracker, TrackerState, TrackingOptions

__all__ = ["Candidate", "Memory", "Sighting", "Track", "Tracker", "TrackerState", "TrackingOptions"]
