"""What a walk says of each rule: found in time, silent where it must be, able to tell.

Of a step that violates a rule, the rule must find it within two seconds. In all others it must be silent: a violation
that began before the step may go on for as long, no other may be there. Where it is about a rule and safe, silence is
worth something only if the rule could tell: it must have been determined of somebody or something at half of the
instants or more. Silence of a rule that sees nobody is no pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from recognition.commissioning.walk import Performed
from recognition.commissioning.witness import Glance
from recognition.rules import Rule, RuleSet

FOUND_WITHIN_S = 2.0
"""Within which a violation must be found."""
_AFTER_WAIT_S = 1.0
"""And, of a rule that itself waits for longer before it raises anything, within so much after that."""
_LEAST_TELLING = 0.5
"""Share of the instants at which a rule must be able to tell."""
_MOST_BLIND = 0.2
"""Share of the instants at which nothing may be monitored."""

Outcome = Literal["found", "late", "missed", "silent", "false alarm", "cannot tell", "not monitored"]
Verdict = Literal["pass", "FAIL", "not tried"]


@dataclass(frozen=True, slots=True)
class StepResult:
    """A rule in a step."""

    rule: str
    step: int
    """Number of the step, from 1."""
    outcome: Outcome
    delay_s: float | None
    """Of a violation that was found: after the step's start. Of a false alarm: when it was first there."""

    @property
    def holds(self) -> bool:
        """Whether it is as it should be."""
        return self.outcome in ("found", "silent")


@dataclass(frozen=True, slots=True)
class RuleResult:
    """A rule over the whole walk."""

    rule: str
    verdict: Verdict
    steps: tuple[StepResult, ...]
    """Those that it was judged in."""

    @property
    def worst_delay_s(self) -> float | None:
        """Of the violations that were found; None where none was."""
        return max(
            (s.delay_s for s in self.steps if s.outcome in ("found", "late") and s.delay_s is not None), default=None
        )

    @property
    def failures(self) -> tuple[StepResult, ...]:
        """Steps in which it is not as it should be."""
        return tuple(step for step in self.steps if not step.holds)


def found_within_s(rule: Rule) -> float:
    """Within how long a violation of a rule must be found."""
    return max(FOUND_WITHIN_S, rule.for_s + _AFTER_WAIT_S)


def ended_within_s(rule: Rule) -> float:
    """For how long a violation may go on after it ended."""
    return max(FOUND_WITHIN_S, rule.clear_s + _AFTER_WAIT_S)


def results_of(rules: RuleSet, glances: Sequence[Glance], walk: Sequence[Performed]) -> tuple[RuleResult, ...]:
    """Every rule of a file.

    Args:
        rules: Those that were watched.
        glances: What they said, in order of time.
        walk: The steps that were done.
    """
    during = [[glance for glance in glances if done.start_ns <= glance.t_ns < done.end_ns] for done in walk]
    return tuple(_rule(rule, walk, during) for rule in rules.rules)


def _rule(rule: Rule, walk: Sequence[Performed], during: Sequence[Sequence[Glance]]) -> RuleResult:
    steps = []
    for number, (done, glances) in enumerate(zip(walk, during, strict=True), start=1):
        outcome, delay_s = _outcome(rule, done, glances)
        if outcome is not None:
            steps.append(StepResult(rule.name, number, outcome, delay_s))
    if any(not step.holds for step in steps):
        return RuleResult(rule.name, "FAIL", tuple(steps))
    own = [done.step for done in walk if rule.name in done.step.about]
    is_tried = {rule.name in step.violates for step in own} == {True, False}
    return RuleResult(rule.name, "pass" if is_tried else "not tried", tuple(steps))


def _outcome(rule: Rule, done: Performed, glances: Sequence[Glance]) -> tuple[Outcome | None, float | None]:
    """None for a step that is not about the rule, and in which nothing can be said of it."""
    is_about = rule.name in done.step.about
    if not glances or sum(glance.is_blind for glance in glances) > _MOST_BLIND * len(glances):
        return ("not monitored" if is_about else None), None
    if rule.name in done.step.violates:
        return _violation(rule, done, glances)
    excused_ns = done.start_ns + round(ended_within_s(rule) * 1e9)
    for glance in glances:
        since_ns = glance.since_ns.get(rule.name)
        if since_ns is not None and not (since_ns < done.start_ns and glance.t_ns < excused_ns):
            return "false alarm", _after_s(done, glance)
    telling = sum(rule.name in glance.determined for glance in glances)
    if is_about and telling < _LEAST_TELLING * len(glances):
        return "cannot tell", None
    return "silent", None


def _violation(rule: Rule, done: Performed, glances: Sequence[Glance]) -> tuple[Outcome, float | None]:
    for glance in glances:
        if rule.name in glance.since_ns:
            delay_s = _after_s(done, glance)
            return ("found" if delay_s <= found_within_s(rule) else "late"), delay_s
    return "missed", None


def _after_s(done: Performed, glance: Glance) -> float:
    return round((glance.t_ns - done.start_ns) * 1e-9, 3)
