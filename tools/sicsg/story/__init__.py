"""Stories: who does what when, on which stage, with which objects about."""

from tools.sicsg.story.stage import StageFullError
from tools.sicsg.story.write import Plot, write_story

__all__ = ["Plot", "StageFullError", "write_story"]
