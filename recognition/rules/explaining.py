"""Why a condition is true, false or unknown at an instant, term by term."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isfinite, isnan

from recognition.rules.cast import OWN_S, Person, Thing
from recognition.rules.conditions import (
    SEEN_BY,
    Compare,
    Condition,
    Defined,
    Inside,
    Joined,
    Mounted,
    Negated,
    Number,
    Some,
    SomeOwn,
    Visible,
)
from recognition.rules.terms import (
    Apart,
    Frame,
    Nearest,
    PointOf,
    Speed,
    Term,
    ToAxis,
    ToExtent,
    ToFootprint,
    ToTop,
)


@dataclass(frozen=True, slots=True)
class Explanation:
    """A condition with its truth, and why."""

    text: str
    """As the rule has it, with who is meant."""
    truth: bool | None
    margin: float
    """By which share of the limit; NaN where it is unknown."""
    detail: str
    """What was measured, and what is not known."""
    parts: tuple[Explanation, ...]
    """Of what it is made."""

    def lines(self, indent: int = 0) -> Iterator[str]:
        """The tree as lines of text."""
        word = {True: "true", False: "false", None: "unknown"}[self.truth]
        detail = f"  {self.detail}" if self.detail else ""
        yield f"{'  ' * indent}{word:8}{self.text}{detail}"
        for part in self.parts:
            yield from part.lines(indent + 1)


def explained(condition: Condition, now: Frame) -> Explanation:
    """A condition about those whom the frame means."""
    margin, detail = condition.margin(now), ""
    parts: tuple[Explanation, ...] = ()
    if isinstance(condition, Compare):
        detail = _comparison(condition, now)
    elif isinstance(condition, Visible):
        detail = _visible(condition, now)
    elif isinstance(condition, Inside):
        detail = _inside(condition, now)
    elif isinstance(condition, Mounted):
        detail = f"of {len(condition.openings)} openings"
    elif isinstance(condition, Joined):
        parts = tuple(explained(part, now) for part in condition.parts)
    elif isinstance(condition, Negated | Defined):
        parts = (explained(condition.body, now),)
    else:
        detail = _counted(condition, now)
        parts = tuple(_each(condition, now))
    return Explanation(condition.text, _truth(margin), margin, detail, parts)


def name_of(member: Person | Thing) -> str:
    """``worker 3``, ``ladder 7``."""
    kind, track_id = member.key
    lost = ", lost" if isinstance(member, Person) and member.is_lost else ""
    return f"{kind} {track_id}{lost}"


def _truth(margin: float) -> bool | None:
    return None if isnan(margin) else margin > 0.0


def _each(condition: Some | SomeOwn | Number, now: Frame) -> Iterator[Explanation]:
    variable = condition.among.domain.variable.text
    given = condition.table(now)[1] if isinstance(condition, SomeOwn) else {}
    for member in list(condition.among.all(now)):
        now.actors[condition.among.slot] = member
        why = explained(condition.body, now)
        detail = why.detail
        if isinstance(condition, SomeOwn) and isinstance(member, Thing) and member.unseen_s > OWN_S:
            detail = f"{detail}; no camera has seen it for {member.unseen_s:.2g} s".lstrip("; ")
        if member.key in given and isinstance(condition, SomeOwn):
            holder = given[member.key][0]
            if holder != now.actors[condition.owner].key:
                detail = f"{detail}; it is {holder[0]} {holder[1]}'s".lstrip("; ")
        yield Explanation(f"{variable} = {name_of(member)}: {why.text}", why.truth, why.margin, detail, why.parts)


def _counted(condition: Some | SomeOwn | Number, now: Frame) -> str:
    if not isinstance(condition, Number):
        return "" if any(True for _ in condition.among.all(now)) else "there is none"
    least, most = condition.between(now)
    return f"{least}" if least == most else f"between {least} and {most}"


def _comparison(condition: Compare, now: Frame) -> str:
    least, most = condition.term.between(now)
    unit = "m/s" if isinstance(condition.term, Speed) else "m"
    low, high = condition.limits_now(now)
    share = condition.leave if now.is_active else condition.limit
    of_height = "" if condition.height_of is None else f" ({share:g} H)"
    bound = f"limit {low:.3g} {unit}{of_height}"
    if low < high:
        bound = f"limit {low:.3g} to {high:.3g} {unit} ({share:g} H; the worker was not measured yet)"
    unsure = list(dict.fromkeys(_unsure(condition.term, now)))
    return "; ".join([_amount(least, most, unit), bound, *unsure])


def _amount(least: float, most: float, unit: str) -> str:
    if least == most:
        return f"{least:.3g} {unit}"
    if not isfinite(most):
        return f"at least {least:.3g} {unit}" if least > 0.0 and isfinite(least) else "not known"
    return f"between {least:.3g} and {most:.3g} {unit}"


def _unsure(term: Term, now: Frame) -> Iterator[str]:
    """What of a term is not known."""
    if isinstance(term, Nearest):
        for part in term.terms:
            yield from _unsure(part, now)
        return
    for point in (term.first, term.second) if isinstance(term, Apart) else (term.point,):
        yield from _unknown_point(point, now)
    if isinstance(term, ToAxis | ToFootprint | ToTop | ToExtent):
        thing: Thing = now.actors[term.slot]
        if thing.body is None and thing.shape != "plain":
            yield f"the keypoints of {name_of(thing)} are not known"


def _unknown_point(point: PointOf, now: Frame) -> Iterator[str]:
    member: Person | Thing = now.actors[point.slot]
    radius = point.ball(now)[3]
    if radius == 0.0:
        return
    within = "" if radius == inf else f", within {radius:.2g} m"
    yield f"{point.name} of {name_of(member)} is not known{within}"


def _visible(condition: Visible, now: Frame) -> str:
    seen = condition.views(now)
    return f"{seen} cameras see it, {SEEN_BY} are needed"


def _inside(condition: Inside, now: Frame) -> str:
    x, y, z, radius = condition.point.ball(now)
    depth = condition.zone.inside_m(x, y, z)
    where = f"{abs(depth):.3g} m {'inside' if depth > 0 else 'outside'}"
    return where if not radius else "; ".join([where, *_unknown_point(condition.point, now)])
