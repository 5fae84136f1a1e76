"""Decisions as alarms: which violations were found and how soon, what was raised for nothing, and where it failed.

A violation is found where it is decided at an instant at which it lasts. An alarm is a run of instants at which a
violation is decided; it is false where none lasts from half a second before to half a second after it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from recognition.evaluation.violations.truth import KINDS, NEAR_S, SceneTruth, Stretch, borders
from rigcal.geometry import Bools

FailureKind = Literal["missed", "missed in part", "false alarm", "too long"]
_RULE_OF_THREE = -math.log(0.05)
"""Of something that never happened, so many times are still likely with 5 %: 3.0."""


@dataclass(frozen=True, slots=True)
class Alarms:
    """Of one violation, over sequences and choices of cameras."""

    violations: int
    """How often it happened."""
    delays_s: tuple[float, ...]
    """Of each that was found: from its start to the first instant at which it is decided."""
    false_alarms: int
    safe_s: float
    """How long it did not last."""

    @property
    def recall(self) -> float:
        """Share of the violations that was found; NaN where there was none."""
        return len(self.delays_s) / self.violations if self.violations else math.nan

    @property
    def median_delay_s(self) -> float:
        """NaN where none was found."""
        return float(np.median(self.delays_s)) if self.delays_s else math.nan

    @property
    def worst_delay_s(self) -> float:
        """NaN where none was found."""
        return max(self.delays_s, default=math.nan)

    @property
    def false_per_hour(self) -> float:
        """False alarms per hour in which the violation did not last."""
        return self.false_alarms / (self.safe_s / 3600) if self.safe_s else math.nan

    @property
    def likely_per_hour(self) -> float:
        """Where none was false: the rate that this little footage cannot exclude with 95 %; else NaN."""
        if self.false_alarms or not self.safe_s:
            return math.nan
        return _RULE_OF_THREE / (self.safe_s / 3600)


@dataclass(frozen=True, slots=True)
class Failure:
    """A time, outside of transitions, at which a violation was decided wrongly."""

    sequence: str
    violation: str
    start_s: float
    end_s: float
    """Seconds after the first instant; the end is that of the last wrong one."""
    kind: FailureKind


def alarms_of(truths: Sequence[SceneTruth], decided: Sequence[Bools], kind: int) -> Alarms:
    """Alarms of one violation.

    Args:
        truths: Of the sequences.
        decided: (U, F, K) of each sequence.
        kind: Number of the violation.
    """
    violations, false_alarms, safe_s, delays_s = 0, 0, 0.0, []
    for truth, choices in zip(truths, decided, strict=True):
        t_s, stretches = truth.t_s, truth.stretches[kind]
        for said in choices[:, :, kind]:
            violations += len(stretches)
            delays_s += [delay for s in stretches if (delay := _delay_s(truth, said, s)) is not None]
            runs = borders(said)
            false_alarms += sum(not _touches(stretches, t_s[a], t_s[b - 1] + truth.period_s) for a, b in runs)
            safe_s += float((~truth.active[:, kind]).sum()) * truth.period_s
    return Alarms(violations, tuple(delays_s), false_alarms, safe_s)


def failures_of(truth: SceneTruth, said: Bools) -> tuple[Failure, ...]:
    """Where decisions (F, K) of a sequence are wrong outside of transitions, by violation and time."""
    found = []
    for kind, name in enumerate(KINDS):
        active, counted, own = truth.active[:, kind], ~truth.near[:, kind], said[:, kind]
        for a, b in borders(active & ~own & counted):
            of = next(s for s in truth.stretches[kind] if s.start_s <= truth.t_s[a] < s.end_s)
            is_found = _delay_s(truth, own, of) is not None
            found.append(_failure(truth, name, a, b, "missed in part" if is_found else "missed"))
        for a, b in borders(~active & own & counted):
            first, end = next((first, end) for first, end in borders(own) if first <= a < end)
            touches = _touches(truth.stretches[kind], truth.t_s[first], truth.t_s[end - 1] + truth.period_s)
            found.append(_failure(truth, name, a, b, "too long" if touches else "false alarm"))
    return tuple(found)


def _failure(truth: SceneTruth, violation: str, first: int, end: int, kind: FailureKind) -> Failure:
    t_s = truth.t_s - truth.t_s[0]
    return Failure(truth.name, violation, round(float(t_s[first]), 3), round(float(t_s[end - 1]), 3), kind)


def _delay_s(truth: SceneTruth, said: Bools, stretch: Stretch) -> float | None:
    """From the start of a violation to the first instant at which it is decided while it lasts; None: at none."""
    t_s = truth.t_s
    found = t_s[said & (t_s >= stretch.start_s) & (t_s < stretch.end_s)]
    return float(found[0] - stretch.start_s) if len(found) else None


def _touches(stretches: Sequence[Stretch], start_s: float, end_s: float) -> bool:
    return any(start_s < s.end_s + NEAR_S and end_s > s.start_s - NEAR_S for s in stretches)
