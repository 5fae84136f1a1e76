"""Rules over scenes: which condition holds for whom, by how much, and which violation lasts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import isnan, nan
from typing import TypeAlias

from recognition.errors import RigRefusedError
from recognition.observations import Scene
from recognition.rules.cast import Key
from recognition.rules.company import ADULT_M, Company, Member, Present
from recognition.rules.conditions import involved
from recognition.rules.explaining import Explanation, explained
from recognition.rules.ruleset import Rule, RuleSet
from recognition.rules.terms import Frame
from recognition.rules.timing import Course, Durations
from recognition.rules.verdict import Actor, Judgement, Verdict
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True)
class BindingExplanation:
    """Why a rule is true, false or unknown for those whom its ``each`` names."""

    verdict: Verdict
    why: Explanation | None
    """None where they are not in the scene."""


_Keys: TypeAlias = tuple[Key, ...]
_ALONE: _Keys = ()


@dataclass(slots=True)
class _Binding:
    number: int
    course: Course
    actors: tuple[Actor, ...]


class Judge:
    """Judges scenes in order of time; same rules, rig and scenes: the same verdicts.

    Args:
        rules: The rules.
        rig: Of the scenes.
        adult_m: How tall whoever was not measured yet is, at least and at most; NaN: nothing is known of it.

    Raises:
        RigRefusedError: where a rule needs the floor or the vertical, and the rig has no world frame.
    """

    def __init__(self, rules: RuleSet, rig: Rig, *, adult_m: tuple[float, float] = ADULT_M) -> None:
        if rules.needs_floor and rig.world_from_rig is None:
            name, text = rules.needs_floor[0]
            raise RigRefusedError(
                f"the rule {name} needs the floor and the vertical, which this rig does not know",
                where=f"rules {rules.name}, rig {rig.site}",
                expected="a rig with world_from_rig",
                got=f"null, and {len(rules.needs_floor)} rules such as {name}: {text}",
                do_next="measure the floor with `rigcal world`, or leave such rules out",
            )
        self.rules = rules
        classes = {name: rules.classes[name] for rule in rules.rules for name in rule.checked.classes}
        timed = {pair for rule in rules.rules for pair in rule.checked.timed}
        self._company = Company(classes, timed, rig, adult_m)
        self._variables = max(rule.checked.variables for rule in rules.rules)
        self._books: list[tuple[Rule, Durations, dict[_Keys, _Binding]]] = [
            (rule, _durations(rule), {}) for rule in rules.rules
        ]
        self._numbered = 0
        self._now: Frame | None = None
        self._judgement: Judgement | None = None

    def judge(self, scene: Scene) -> Judgement:
        """Every rule at one instant, later than the last; where nothing is monitored, everything is unknown."""
        if self._judgement is not None and scene.t_ns <= self._judgement.t_ns:
            raise ValueError(f"t_ns: expected a time after {self._judgement.t_ns}, the last instant, got {scene.t_ns}")
        self._now = None
        if scene.status != "NOT MONITORED":
            present = self._company.step(scene)
            self._now = Frame(self._company, present, self._variables)
            if present.renamed:
                self._rename(present)
        verdicts: list[Verdict] = []
        for rule, durations, bindings in self._books:
            verdicts += self._judged(rule, durations, bindings, scene.t_ns)
        self._judgement = Judgement(scene.t_ns, scene.status, tuple(verdicts))
        return self._judgement

    def explain(self, rule_name: str) -> tuple[BindingExplanation, ...]:
        """Why a rule was true, false or unknown at the instant that was judged last, term by term.

        Raises:
            KeyError: where there is no such rule.
        """
        rule, now = self.rules.rule(rule_name), self._now
        verdicts = self._judgement.verdicts if self._judgement else ()
        found = []
        for verdict in verdicts:
            if verdict.rule != rule_name:
                continue
            why = None
            if now is not None and _bound(rule, now, verdict):
                now.is_active = verdict.is_active
                why = explained(rule.checked.condition, now)
            found.append(BindingExplanation(verdict, why))
        return tuple(found)

    def _judged(
        self, rule: Rule, durations: Durations, bindings: dict[_Keys, _Binding], t_ns: int
    ) -> Iterator[Verdict]:
        now = self._now
        left = dict(bindings) if bindings else None
        if now is not None:
            condition = rule.checked.condition
            for keys in _bindings(rule, now):
                binding = bindings.get(keys)
                if left and binding:
                    del left[keys]
                now.is_active = binding is not None and binding.course.is_active
                margin = condition.margin(now)
                if binding is None:
                    if not margin > 0.0:
                        yield Verdict(rule.name, -1, _names(rule, keys), None if isnan(margin) else False, margin,
                                      False, None, None)  # fmt: skip
                        continue
                    binding = bindings[keys] = self._new(durations, _names(rule, keys))
                if margin > 0.0:
                    binding.actors = _participants(rule, keys, now)
                yield self._stepped(rule, keys, binding, bindings, t_ns, margin)
        for keys, binding in (left or {}).items():
            yield self._stepped(rule, keys, binding, bindings, t_ns, nan)

    def _stepped(
        self, rule: Rule, keys: _Keys, binding: _Binding, bindings: dict[_Keys, _Binding], t_ns: int, margin: float
    ) -> Verdict:
        course = binding.course
        truth = None if isnan(margin) else margin > 0.0
        course.step(t_ns, truth)
        if course.is_idle:
            del bindings[keys]
        return Verdict(
            rule.name, binding.number, binding.actors, truth, margin, course.is_active, course.since_ns, course.ended_ns
        )

    def _new(self, durations: Durations, actors: tuple[Actor, ...]) -> _Binding:
        self._numbered += 1
        return _Binding(self._numbered - 1, Course(durations), actors)

    def _rename(self, present: Present) -> None:
        """Let bindings go on under the new numbers of tracks."""
        renamed = present.renamed
        for _, _, bindings in self._books:
            for keys in [keys for keys in bindings if any(key in renamed for key in keys)]:
                binding = bindings.pop(keys)
                bindings[tuple(renamed.get(key, key) for key in keys)] = binding
                binding.actors = tuple(
                    Actor(*renamed.get((actor.kind, actor.track_id), (actor.kind, actor.track_id)), actor.role)
                    for actor in binding.actors
                )


def _durations(rule: Rule) -> Durations:
    return Durations(
        round(rule.for_s * 1e9), round(rule.clear_s * 1e9), round(rule.max_hold_s * 1e9), rule.on_unknown == "hold"
    )


def _bindings(rule: Rule, now: Frame) -> Iterator[_Keys]:
    """Whom ``each`` names, one after another; the frame means them while they are out."""
    each = rule.checked.each
    if not each:
        yield _ALONE
    elif len(each) == 1:
        slot = each[0].slot
        for actor in each[0].here(now):
            now.actors[slot] = actor
            yield (actor.key,)
    else:
        yield from _nested(rule, now, 0, ())


def _nested(rule: Rule, now: Frame, depth: int, keys: _Keys) -> Iterator[_Keys]:
    each = rule.checked.each
    if depth == len(each):
        yield keys
        return
    for actor in each[depth].here(now):
        now.actors[each[depth].slot] = actor
        yield from _nested(rule, now, depth + 1, (*keys, actor.key))


def _names(rule: Rule, keys: _Keys) -> tuple[Actor, ...]:
    return _named(tuple(among.domain.variable.text for among in rule.checked.each), keys)


@lru_cache(maxsize=4096)
def _named(roles: tuple[str, ...], keys: _Keys) -> tuple[Actor, ...]:
    return tuple(Actor(kind, track_id, role) for (kind, track_id), role in zip(keys, roles, strict=True))


def _participants(rule: Rule, keys: _Keys, now: Frame) -> tuple[Actor, ...]:
    """Those whom ``each`` names and who make the condition true, each once."""
    found = dict.fromkeys(keys)
    named = list(_names(rule, keys))
    for role, actor in involved(rule.checked.condition, now):
        if actor.key not in found:
            found[actor.key] = None
            named.append(Actor(*actor.key, role))
    return tuple(named)


def _bound(rule: Rule, now: Frame, verdict: Verdict) -> bool:
    """Let the frame mean whom a verdict is about; False where one is not in the scene."""
    here: dict[Key, Member] = {actor.key: actor for actor in now.present.workers}
    here |= {thing.key: thing for things in now.present.things.values() for thing in things}
    for among, actor in zip(rule.checked.each, verdict.actors, strict=False):
        found = here.get((actor.kind, actor.track_id))
        if found is None:
            return False
        now.actors[among.slot] = found
    return True
