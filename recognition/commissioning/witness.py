"""What the rules say at each instant of a walk, in as few words as its judgement needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from recognition.events import Event, Watch
from recognition.observations import Scene
from recognition.rules import Judgement, RuleSet
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True)
class Glance:
    """An instant."""

    t_ns: int
    is_blind: bool
    """Whether nothing was monitored."""
    since_ns: Mapping[str, int]
    """Of the rules that are violated: when the latest of their violations began."""
    determined: frozenset[str]
    """Rules that could tell of somebody or something whether it was a violation."""


class Witness(Watch):
    """A watch that remembers what it said: for a replay."""

    def __init__(self, rules: RuleSet, rig: Rig) -> None:
        super().__init__(rules, rig)
        self._glances: list[Glance] = []

    @property
    def glances(self) -> tuple[Glance, ...]:
        """In order of time."""
        return tuple(self._glances)

    def step(self, scene: Scene) -> tuple[Judgement, tuple[Event, ...]]:
        """As :meth:`recognition.events.Watch.step`."""
        judgement, events = super().step(scene)
        if not self._glances or judgement.t_ns > self._glances[-1].t_ns:
            self._glances.append(_glance(judgement))
        return judgement, events


def _glance(judgement: Judgement) -> Glance:
    since_ns: dict[str, int] = {}
    for verdict in judgement.verdicts:
        if verdict.is_active and verdict.since_ns is not None:
            since_ns[verdict.rule] = max(since_ns.get(verdict.rule, verdict.since_ns), verdict.since_ns)
    determined = frozenset(verdict.rule for verdict in judgement.verdicts if verdict.truth is not None)
    return Glance(judgement.t_ns, judgement.status == "NOT MONITORED", MappingProxyType(since_ns), determined)
