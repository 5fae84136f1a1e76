"""Live cameras, and files paced as if they were: every packet recorded, the newest frame set looked at."""

from recognition.live.feed import LiveFeed, LiveOptions
from recognition.live.inputs import LiveInput, chosen_sources, live_cameras, paced_capture
from recognition.live.journal import Entry

__all__ = ["Entry", "LiveFeed", "LiveInput", "LiveOptions", "chosen_sources", "live_cameras", "paced_capture"]
