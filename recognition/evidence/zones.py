"""The zones of a site that a rule speaks about."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from recognition.rules import Rule, RuleSet
from recognition.rules.zones import Zone


def zones_of(rules: RuleSet | None, rule_name: str, rules_digest: str) -> tuple[Zone, ...]:
    """The zones in a rule's condition, by name; none where these are not the rules that are meant.

    Args:
        rules: Those that are known; None: none are.
        rule_name: Name of the rule.
        rules_digest: Of the rules that are meant.
    """
    if rules is None or rules.digest != rules_digest:
        return ()
    return tuple(_zones(rules.rule(rule_name)))


def _zones(rule: Rule) -> list[Zone]:
    found: dict[str, Zone] = {}
    left: list[Any] = [rule.checked.condition]
    while left:
        one = left.pop()
        if isinstance(one, Zone):
            found[one.name] = one
        elif isinstance(one, tuple):
            left += one
        elif is_dataclass(one):
            left += [getattr(one, field.name) for field in fields(one)]
    return [found[name] for name in sorted(found)]
