"""Rules in plain English."""

from __future__ import annotations

from collections.abc import Iterator

from recognition.rules.ruleset import Rule, RuleSet
from recognition.rules.syntax import (
    Comparison,
    Count,
    Domain,
    Exists,
    Expression,
    Measure,
    Not,
    Place,
    Quantity,
    Several,
    Use,
)

_COUNTED = {
    "<": "fewer than",
    "<=": "at most",
    ">": "more than",
    ">=": "at least",
    "==": "exactly",
    "!=": "not exactly",
}
_WAYS = {"xy": " on the plan", "z": " in height", "3d": ""}


def described(rule: Rule, rules: RuleSet) -> Iterator[str]:
    """A rule in sentences: what it forbids, the definitions that it uses, and its times."""
    whom = "".join(f"for each {_who(domain)}: " for domain in rule.tree.each)
    yield _sentence(f"{whom}{_said(rule.tree.body)}")
    for name in rule.checked.used:
        definition = rules.definitions[name]
        variables = ", ".join(variable.text for variable in definition.variables)
        yield f"{name}({variables}): {_said(definition.body)}."
    yield (
        f"Raised after {rule.for_s:g} s ({rule.severity}); ended when it has not been so for {rule.clear_s:g} s; "
        f"{_unknown(rule)}."
    )


def _unknown(rule: Rule) -> str:
    if rule.on_unknown == "clear":
        return "what cannot be told counts as not so"
    return f"what cannot be told leaves it as it is, for {rule.max_hold_s:g} s at most"


def _said(tree: Expression) -> str:
    if isinstance(tree, Several):
        parts = [_part(part) for part in tree.parts]
        return f"{', '.join(parts[:-1])}, {tree.word} {parts[-1]}"
    if isinstance(tree, Not):
        if isinstance(tree.body, Exists):
            return f"there is no {_who(tree.body.domain)} {_such(tree.body.domain)} {_said(tree.body.body)}"
        return f"it is not so that {_part(tree.body)}"
    if isinstance(tree, Exists):
        return f"there is {_article(_who(tree.domain))} {_such(tree.domain)} {_said(tree.body)}"
    if isinstance(tree, Count):
        many = tree.number.value != 1
        number = f"{_COUNTED[tree.operator]} {tree.number.text}"
        whom = _who(tree.domain, many=many)
        return f"there {'are' if many else 'is'} {number} {whom} {_such(tree.domain)} {_said(tree.body)}"
    return _comparison(tree) if isinstance(tree, Comparison) else _use(tree)


def _part(tree: Expression) -> str:
    """One of several: in brackets where it is itself of several."""
    return f"({_said(tree)})" if isinstance(tree, Several) else _said(tree)


def _comparison(tree: Comparison) -> str:
    side = "below" if tree.operator == "<" else "above"
    leave = f" ({_limit(tree.leave)} while the violation lasts)" if tree.leave else ""
    return f"{_measure(tree.measure)} is {side} {_limit(tree.limit)}{leave}"


def _measure(measure: Measure) -> str:
    first = _place(measure.arguments[0])
    if measure.name.text == "clearance":
        return f"the height of {first} over the floor"
    if measure.name.text == "speed":
        return f"the speed of {first}"
    way = _WAYS[measure.way.text if measure.way else "3d"]
    return f"the distance{way} from {first} to {_place(measure.arguments[1])}"


def _limit(quantity: Quantity) -> str:
    return f"{quantity.value:g} of the worker's height" if quantity.unit.text == "H" else quantity.text


def _place(place: Place) -> str:
    return place.base.text if place.part is None else f"the {place.part.text.replace('_', ' ')} of {place.base.text}"


def _use(tree: Use) -> str:
    places = [_place(place) for place in tree.arguments]
    if tree.name.text == "visible":
        return f"two cameras see {places[0]}"
    if tree.name.text == "inside":
        plural = tree.arguments[0].part is not None and tree.arguments[0].part.text == "feet"
        return f"{places[0]} {'are' if plural else 'is'} in the zone {places[1]}"
    if tree.name.text == "mounted":
        return f"{places[0]} is in an opening"
    return f"{tree.name.text}({', '.join(places)})"


def _who(domain: Domain, *, many: bool = False) -> str:
    plural = "s" if many else ""
    names = [name.text.replace("_", " ") for name in domain.classes] or ["worker"]
    kinds = " or ".join(f"{name}{plural}" for name in names)
    apart = f" other than {' and '.join(name.text for name in domain.apart)}" if domain.apart else ""
    owner = f" that is only {domain.owner.text}'s" if domain.owner else ""
    return f"{kinds} {domain.variable.text}{apart}{owner}"


def _such(domain: Domain) -> str:
    return "for which" if domain.classes else "for whom"


def _article(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
