"""How somebody moves: what follows from the name of a way of moving."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from tools.sicsg.assets import asset_rng

GESTURES = ("relaxed", "hips", "crossed", "phone", "clipboard", "point", "chin")
"""What arms do while somebody stands."""
_WEIGHTS = (0.42, 0.14, 0.12, 0.08, 0.1, 0.09, 0.05)
_SLOTS = 32


@dataclass(frozen=True, slots=True)
class Style:
    """A way of moving. Radians, seconds; lengths relative to the body height."""

    step: float
    """Length of a step at 1.2 m/s."""
    arm_swing: float
    elbow: float
    """How far the elbows are bent when the arms hang."""
    arms_out: float
    """How far the arms hang away from the body."""
    stoop: float
    """How far the upper body leans forward."""
    toe_out: float
    stance: float
    """Distance between the feet."""
    sway: float
    """Size of the idle sway."""
    lift: float
    """How high the feet are lifted in a step."""
    left_handed: bool
    kneels: bool
    """Kneels on one knee where others squat."""
    phases: tuple[float, ...]
    """Eight phases of slow movements."""
    slot_s: float
    """How long a gesture lasts."""
    gestures: tuple[str, ...]
    """What the arms do, one slot of time after the other, for ever again."""
    work: str
    """``drill``: both hands press; ``seal``: one hand draws long lines; ``wipe``: one hand circles."""

    @property
    def hand(self) -> int:
        """Index of the leading hand."""
        return 0 if self.left_handed else 1

    def wave(self, number: int, t_s: float, period_s: float) -> float:
        """A slow movement, -1..1: the sum of two sines without a common period."""
        first, second = self.phases[number % 8], self.phases[(number + 3) % 8]
        w = 2 * math.pi / period_s
        return 0.65 * math.sin(w * t_s + first) + 0.35 * math.sin(1.618 * w * t_s + second)

    def gesture(self, t_s: float) -> tuple[str, str, float]:
        """What the arms come from and go to, and how much of the way is done."""
        place = t_s / self.slot_s + self.phases[0]
        slot = math.floor(place)
        before, now = self.gestures[(slot - 1) % _SLOTS], self.gestures[slot % _SLOTS]
        return before, now, min((place - slot) * self.slot_s / 0.8, 1.0)


@lru_cache(maxsize=512)
def style(name: str) -> Style:
    """The way of moving of this asset name."""
    rng = asset_rng("motion", name)
    return Style(
        step=float(rng.uniform(0.36, 0.43)),
        arm_swing=float(rng.uniform(0.2, 0.6)),
        elbow=float(rng.uniform(0.15, 0.5)),
        arms_out=float(rng.uniform(0.1, 0.24)),
        stoop=float(rng.uniform(0.0, 0.16)),
        toe_out=float(rng.uniform(0.02, 0.25)),
        stance=float(rng.uniform(0.11, 0.19)),
        sway=float(rng.uniform(0.5, 1.3)),
        lift=float(rng.uniform(0.035, 0.06)),
        left_handed=bool(rng.random() < 0.15),
        kneels=bool(rng.random() < 0.5),
        phases=tuple(rng.uniform(0.0, 2 * math.pi, 8).tolist()),
        slot_s=float(rng.uniform(2.5, 5.0)),
        gestures=tuple(rng.choice(GESTURES, _SLOTS, p=_WEIGHTS).tolist()),
        work=str(rng.choice(["drill", "seal", "wipe"])),
    )
