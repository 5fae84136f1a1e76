"""What breaks the grid of the stamps: missing frames, frames that came twice, and clocks that were stepped.

``r`` is how far each stamp is ahead of a grid that counts every frame that came. A missing frame lifts it by a whole
period for good, a frame that came twice lowers it likewise, a stepped clock shifts it by any amount for good; what is
late or early comes back. Late frames are never early, so that the level of arrival times is their floor.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rigcal.geometry import Floats
from rigcal.pace.levels import PAST, Tolerance, floor_of, look_ahead
from rigcal.pace.results import Gap, Step

_CAME_TWICE = 0.25
"""Frames closer than this share of a period may be the same frame, delivered twice."""
_CHANGING, _CHANGING_RATE = 0.3, 0.02
"""Of a rate that changes, gaps are told from changes by this share of a period and of their length."""


@dataclass(slots=True)
class Events:
    """What was found, and how to put every stamp on one grid."""

    missing: list[Gap] = field(default_factory=list)
    twice: list[int] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    late: int = 0

    def on_grid(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Stamps without the clock's steps (n,), and the number of each frame on the grid (n,)."""
        seconds, frames = np.zeros(len(t_s)), np.ones(len(t_s))
        for step in self.steps:
            seconds[step.at] += step.jump_s
        for gap in self.missing:
            frames[gap.after + 1] += gap.count
        frames[self.twice] -= 1
        return t_s - np.cumsum(seconds), np.cumsum(frames)


@dataclass(frozen=True, slots=True)
class _Jump:
    """A place where stamps went to another level and stayed."""

    place: int
    """The interval at which they left the old one."""
    ahead_s: Floats
    """(m,) how far above the old level the stamps after it lie, up to the first one on the new level."""
    strays_s: Floats
    """(m,) the intervals before them, less their period."""
    turn: int
    """How many of the stamps after it lie at the old level rather than the new one, before the others do."""
    told: int
    """How many stamps tell the lesser known of the two levels."""
    level_s: float
    """The new level above the old one."""
    slack_s: float
    """How well that is known."""
    period_s: float

    @property
    def periods(self) -> int:
        """Its nearest whole number of periods."""
        return round(self.level_s / self.period_s)

    @property
    def is_whole(self) -> bool:
        """Whether it is a whole number of periods, and not none."""
        return self.periods != 0 and abs(self.level_s - self.periods * self.period_s) <= self.slack_s

    def second_frames(self) -> list[int]:
        """The frames that may be the ones before them, delivered twice, the closest first."""
        close = np.flatnonzero(self.strays_s < (_CAME_TWICE - 1) * self.period_s)
        return [self.place + 1 + int(frame) for frame in close[np.argsort(self.strays_s[close], kind="stable")]]


@dataclass(frozen=True, slots=True)
class _Course:
    """How the stamps go beside their grid."""

    r: Floats
    """(n,) how far each stamp is ahead."""
    strays_s: Floats
    """(n - 1,) the intervals, less their periods."""
    periods_s: Floats
    """(n - 1,) the period at each interval."""
    allowed: Tolerance
    steady: bool

    def begins_late(self, place: int, before_s: float) -> bool:
        """Whether all frames up to an interval at the start were late."""
        after_s = floor_of(self.r[place + 1 : place + 1 + PAST], self.allowed.level_s)
        return place < self.allowed.first and after_s < before_s - self.allowed.level_s

    def jump(self, place: int, past: int, ahead_s: Floats, level_s: float) -> _Jump:
        """The jump at an interval to another level, after as many stamps at the old one."""
        allowed, period_s = self.allowed, float(self.periods_s[place])
        last = int(np.argmax(np.abs(ahead_s - level_s) <= allowed.level_s)) + 1
        told = min(past, int(np.sum(np.abs(ahead_s - level_s) <= allowed.interval_s)))
        if self.steady:
            slack_s = allowed.rate * abs(level_s) + (allowed.level_s if told >= PAST else allowed.interval_s)
        else:
            slack_s = _CHANGING_RATE * abs(level_s) + _CHANGING * period_s
        strays_s = self.strays_s[place : place + last]
        return _Jump(place, ahead_s[:last], strays_s, _turn(ahead_s, level_s), told, level_s, slack_s, period_s)


def find_events(t_s: Floats, periods_s: Floats, allowed: Tolerance, *, steady: bool) -> Events:
    """Go through the places where an interval strays, and decide what each of them is.

    Args:
        t_s: (n,) stamps.
        periods_s: (n - 1,) the period at each interval.
        allowed: How far stamps stray.
        steady: Whether the rate is; where it changes, a jump tells missing frames, or that time ran back by more than
            a period, and nothing finer.
    """
    strays_s = np.diff(t_s) - periods_s
    course = _Course(np.concatenate([[0.0], np.cumsum(strays_s)]), strays_s, periods_s, allowed, steady)
    found, level_from, resume = Events(), 0, 0
    for place in (int(i) for i in np.flatnonzero(np.abs(strays_s) > allowed.interval_s)):
        if place < resume:
            continue
        past = course.r[max(level_from, place + 1 - max(PAST, allowed.ahead)) : place + 1]
        before_s = floor_of(past, allowed.level_s)
        if course.begins_late(place, before_s):
            found.late += place + 1 - level_from  # the grid is told by those that follow
            resume = level_from = place + 1
            continue
        ahead_s, level_s = look_ahead(course.r[place + 1 :], before_s, allowed)
        back = np.flatnonzero(np.abs(ahead_s) <= allowed.level_s)
        if level_s is not None:
            jump = course.jump(place, len(past), ahead_s, level_s)
            if _is_told(jump, len(ahead_s), allowed):
                _note(found, jump, steady=steady)
                resume = level_from = place + max(len(jump.ahead_s), jump.turn + 1)
        elif len(back):
            found.late += int(np.sum(ahead_s[: back[0]] > 0))
            resume = place + 1 + int(back[0])
    return found


def _turn(ahead_s: Floats, level_s: float) -> int:
    """After how many stamps a level was left for another: least distances to either, those of late stamps clipped."""
    old_s = np.minimum(np.abs(ahead_s), abs(level_s))
    new_s = np.minimum(np.abs(ahead_s - level_s), abs(level_s))
    cost_s = np.concatenate([[0.0], np.cumsum(old_s - new_s)])
    return int(np.argmin(cost_s[:-1]))


def _is_told(jump: _Jump, ahead: int, allowed: Tolerance) -> bool:
    """Whether enough stamps stay: whole periods, and stamps that are far too early, are told soonest."""
    if jump.level_s < -jump.period_s or (jump.is_whole and jump.periods > 0):
        return ahead >= allowed.end
    return ahead >= allowed.ahead - 1 and jump.told >= allowed.support


def _note(found: Events, jump: _Jump, *, steady: bool) -> None:
    """Note what brought the stamps to another level."""
    second = jump.second_frames()
    if jump.is_whole and jump.periods > 0:
        found.missing += _gaps(jump)
    elif jump.is_whole and len(second) >= -jump.periods:
        found.twice += second[: -jump.periods]
    elif steady or jump.level_s < -jump.period_s:
        found.steps.append(Step(jump.place + 1 + jump.turn, jump.level_s))


def _gaps(jump: _Jump) -> list[Gap]:
    """Share missing frames out over the intervals in which they can be missing.

    Nothing comes early: a stamp that lies k periods ahead of a later one's level was late, so that as many frames are
    missing before a stamp as the least of those from it on says.
    """
    least_s = np.minimum.accumulate(jump.ahead_s[::-1])[::-1]
    before = np.clip(np.floor((least_s + jump.slack_s) / jump.period_s), 0, jump.periods)
    before[-1] = jump.periods
    more = np.diff(before, prepend=0)
    return [Gap(jump.place + int(i), int(more[i])) for i in np.flatnonzero(more)]
