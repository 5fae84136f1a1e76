"""From truth at instants to a violation that lasts.

Times count what was determined: an instant at which a condition was unknown adds nothing to either side, and what lies
between two instants farther apart than :data:`GAP_NS` is unknown. What was unknown for longer than that before it was
raised begins anew; what was raised is held as long as the rule says.
"""

from __future__ import annotations

from dataclasses import dataclass, field

GAP_NS = 1_000_000_000
SLACK_NS = 5_000_000
"""By so much a time may fall short: instants are not quite evenly spaced, and nine periods of 33.3 ms are 0.3 s."""


@dataclass(frozen=True, slots=True)
class Durations:
    """Of a rule, in nanoseconds."""

    raise_ns: int
    clear_ns: int
    hold_ns: int
    holds: bool
    """Whether unknown leaves things as they are; else it counts as false."""


@dataclass(slots=True)
class Course:
    """What became of one condition so far."""

    durations: Durations
    is_active: bool = False
    since_ns: int | None = None
    """When the condition began to hold, while it does or is taken to."""
    ended_ns: int | None = None
    """When it ceased to, at the instant at which the violation is ended."""
    _last: bool | None = field(default=None)
    _last_ns: int | None = None
    _known_ns: int = 0
    _held_ns: int = 0
    _false_since_ns: int | None = None
    _false_ns: int = 0

    @property
    def is_idle(self) -> bool:
        """Whether nothing of it needs to be remembered."""
        return not self.is_active and self.since_ns is None

    def step(self, t_ns: int, truth: bool | None) -> None:
        """Go on to an instant later than the last."""
        self.ended_ns = None
        if truth is None and not self.durations.holds:
            truth = False
        passed = 0
        if self._last_ns is not None and truth is self._last and t_ns - self._last_ns <= GAP_NS:
            passed = t_ns - self._last_ns
        self._last, self._last_ns = truth, t_ns
        if truth is None:
            self._unknown(t_ns)
            return
        self._known_ns = t_ns
        if truth:
            self._true(t_ns, passed)
        else:
            self._false(t_ns, passed)

    def _true(self, t_ns: int, passed: int) -> None:
        self._false_since_ns, self._false_ns = None, 0
        if self.since_ns is None:
            self.since_ns, self._held_ns = t_ns, 0
        self._held_ns += passed
        if self._held_ns >= self.durations.raise_ns - SLACK_NS:
            self.is_active = True

    def _false(self, t_ns: int, passed: int) -> None:
        if not self.is_active:
            self.since_ns, self._held_ns = None, 0
            return
        if self._false_since_ns is None:
            self._false_since_ns = t_ns
        self._false_ns += passed
        if self._false_ns >= self.durations.clear_ns - SLACK_NS:
            self._end(self._false_since_ns)

    def _unknown(self, t_ns: int) -> None:
        unknown_ns = t_ns - self._known_ns
        if self.is_active and unknown_ns >= self.durations.hold_ns:
            self._end(t_ns)
        elif not self.is_active and unknown_ns >= min(self.durations.hold_ns, GAP_NS):
            self.since_ns, self._held_ns = None, 0

    def _end(self, ended_ns: int) -> None:
        self.is_active, self.since_ns, self.ended_ns = False, None, ended_ns
        self._held_ns, self._false_ns, self._false_since_ns = 0, 0, None
