"""How regularly a camera's frames come, as their stamps tell: rate, jitter, source of the stamps, and what is amiss."""

from rigcal.pace.judge import judge_pace
from rigcal.pace.rates import FreeRunning, free_running
from rigcal.pace.results import Gap, Pace, PaceOptions, Step

__all__ = ["FreeRunning", "Gap", "Pace", "PaceOptions", "Step", "free_running", "judge_pace"]
