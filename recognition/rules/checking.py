"""From what an expression says to a condition that can be judged: names, kinds, units and limits are checked here.

A definition is checked anew for every use, with the kinds of its arguments, as if it stood there; where an argument
does not suit it, the use is blamed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from operator import itemgetter

from recognition.rules import vocabulary as words
from recognition.rules.conditions import (
    Among,
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
from recognition.rules.measuring import Measures, limit_of, require_count, require_single
from recognition.rules.naming import Declared, Names, Scope, Text, Variable, fail
from recognition.rules.syntax import Comparison, Count, Domain, Exists, Expression, Not, Quantity, Several, Use, When
from recognition.rules.vocabulary import alike

MOST_CONDITIONS = 2000
"""Of one rule, with its definitions in place."""


@dataclass(frozen=True, slots=True)
class Checked:
    """A rule that can be judged."""

    each: tuple[Among, ...]
    condition: Condition
    variables: int
    """How many slots it needs."""
    classes: tuple[str, ...]
    """Of the objects that it speaks about."""
    timed: tuple[tuple[str, str], ...]
    """Kinds and points whose speed it asks for."""
    floor: tuple[str, ...]
    """What of it needs the floor or the vertical, as it is written."""
    used: tuple[str, ...]
    """Names of the definitions it uses."""


def checked(when: When, text: str, declared: Declared) -> Checked:
    """A rule's condition.

    Args:
        when: The tree of its text.
        text: The text.
        declared: What the file declares.

    Raises:
        ExpressionError: where something in it, or in a definition it uses, is unknown, of the wrong kind or impossible.
    """
    return _Checker(declared).rule(when, text)


class _Checker:
    """Of one rule."""

    def __init__(self, declared: Declared) -> None:
        self._declared, self._names = declared, Names(declared)
        self._measures = Measures(self._names)
        self._slots, self._numbers = count(), count(len(declared.definitions))
        self._conditions = 0
        self._side: int = 1
        """1 where what is checked being true speaks for a violation, -1 where it speaks against it, 0 for neither."""
        self._classes: dict[str, None] = {}
        self._used: dict[str, None] = {}

    def rule(self, when: When, text: str) -> Checked:
        scope: dict[str, Variable] = {}
        here = Text(text)
        each = []
        for domain in when.each:
            if domain.owner is not None:
                fail(here, domain.owner.at, "`of` stands with `exists` only", "each CLASS o",
                     f"of {domain.owner.text}", "leave it out")  # fmt: skip
            each.append(self._among(domain, scope, here))
            scope[domain.variable.text] = Variable(each[-1].slot, each[-1].classes)
        condition = self._condition(when.body, scope, here)
        for among in each:
            self._require_used(among, here)
        return Checked(
            each=tuple(each),
            condition=condition,
            variables=next(self._slots),
            classes=tuple(self._classes),
            timed=tuple(self._measures.timed),
            floor=tuple(self._names.floor),
            used=tuple(self._used),
        )

    def _among(self, domain: Domain, scope: Scope, here: Text) -> Among:
        name = domain.variable
        if name.text in scope:
            fail(here, name.at, f"the variable {name.text} is taken", "a name that is not in use here", name.text,
                 "rename one of the two")  # fmt: skip
        if name.text in self._declared.classes:
            fail(here, name.at, f"the class {name.text} has no variable", f"{name.text} and a variable", name.text,
                 f"write {name.text} {name.text[0]}")  # fmt: skip
        for word in domain.classes:
            if word.text not in self._declared.classes:
                known = list(self._declared.classes)
                fail(here, word.at, f"unknown class {word.text}{alike(word.text, known)}", ", ".join(known), word.text,
                     "mend the name, or declare the class of another network under [classes]")  # fmt: skip
            self._classes[word.text] = None
        apart = tuple(self._names.variable(other, scope, here).slot for other in domain.apart)
        return Among(next(self._slots), tuple(word.text for word in domain.classes), apart, domain)

    def _condition(self, tree: Expression, scope: Scope, here: Text) -> Condition:
        self._conditions += 1
        if self._conditions > MOST_CONDITIONS:
            fail(here, tree.at, "the rule is too large", f"at most {MOST_CONDITIONS} conditions, definitions in place",
                 "more", "make several rules of it")  # fmt: skip
        text = here.text[tree.at : tree.end]
        if isinstance(tree, Several):
            return Joined(tuple(self._condition(part, scope, here) for part in tree.parts), tree.word == "and", text)
        if isinstance(tree, Not):
            return Negated(self._turned(-1, tree.body, scope, here), text)
        if isinstance(tree, Exists):
            return self._exists(tree, scope, here, text)
        if isinstance(tree, Count):
            return self._count(tree, scope, here, text)
        if isinstance(tree, Comparison):
            return self._comparison(tree, scope, here, text)
        return self._use(tree, scope, here, text)

    def _turned(self, turn: int, tree: Expression, scope: Scope, here: Text) -> Condition:
        """A condition whose truth speaks for a violation as much as what is around it, times ``turn``."""
        before, self._side = self._side, self._side * turn
        found = self._condition(tree, scope, here)
        self._side = before
        return found

    def _exists(self, tree: Exists, scope: Scope, here: Text, text: str) -> Condition:
        among = self._among(tree.domain, scope, here)
        own = {tree.domain.variable.text: Variable(among.slot, among.classes)}
        if tree.domain.owner is None:
            body = self._condition(tree.body, {**scope, **own}, here)
            self._require_used(among, here)
            return Some(among, body, text)
        name = tree.domain.owner
        owner = self._names.variable(name, scope, here)
        if owner.classes or not among.classes:
            fail(here, name.at, "`of` joins an object with its worker", "exists CLASS o of w: ...", text,
                 "give the object a class, and name a worker after `of`")  # fmt: skip
        body = self._condition(tree.body, {name.text: owner, **own}, here)
        self._require_used(among, here)
        return SomeOwn(among, owner.slot, body, next(self._numbers), text)

    def _count(self, tree: Count, scope: Scope, here: Text, text: str) -> Condition:
        number = tree.number
        if tree.domain.owner is not None:
            fail(here, tree.domain.owner.at, "`of` stands with `exists` only", "count(CLASS o: ...)",
                 f"of {tree.domain.owner.text}", "leave it out")  # fmt: skip
        if number.value != int(number.value) or number.value > words.MOST_COUNT:
            fail(here, number.at, "a count of what cannot be", f"a whole number up to {words.MOST_COUNT}", number.text,
                 "mend the number")  # fmt: skip
        if number.value == 0 and tree.operator in ("<", ">="):
            always = "always" if tree.operator == ">=" else "never"
            fail(here, number.at, f"a count is {always} {tree.operator} 0", "a limit that can be crossed", text,
                 "write count(...) > 0, or count(...) == 0")  # fmt: skip
        among = self._among(tree.domain, scope, here)
        variable = Variable(among.slot, among.classes)
        turn = {"<": -1, "<=": -1, ">": 1, ">=": 1}.get(tree.operator, 0)
        body = self._turned(turn, tree.body, {**scope, tree.domain.variable.text: variable}, here)
        self._require_used(among, here)
        return Number(among, body, tree.operator, int(number.value), text)

    def _require_used(self, among: Among, here: Text) -> None:
        if among.slot not in self._names.touched:
            name = among.domain.variable
            fail(here, name.at, f"nothing is said about {name.text}", f"a condition that speaks about {name.text}",
                 "none", f"use {name.text}, or leave it out")  # fmt: skip

    def _comparison(self, tree: Comparison, scope: Scope, here: Text, text: str) -> Condition:
        measure, is_below = tree.measure, tree.operator == "<"
        variables = [scope[p.base.text] for p in measure.arguments if p.base.text in scope]
        workers = {variable.slot for variable in variables if not variable.classes}
        term = self._measures.term(measure, scope, here)
        limit = limit_of(tree.limit, measure, len(workers), here)
        leave = limit
        if tree.leave is not None:
            leave = limit_of(tree.leave, measure, len(workers), here)
            if (tree.limit.unit.text == "H") != (tree.leave.unit.text == "H"):
                fail(here, tree.leave.at, "two kinds of units", f"{tree.limit.unit.text}, as the first limit",
                     tree.leave.text, "write both limits alike")  # fmt: skip
            self._require_beyond(tree.leave, leave - limit if is_below else limit - leave, is_below, here)
        height_of = min(workers) if tree.limit.unit.text == "H" else None
        return Compare(term, is_below, limit, leave, height_of, tree.limit.unit.text, text)

    def _require_beyond(self, leave: Quantity, beyond: float, is_below: bool, here: Text) -> None:
        """The limit after ``exit`` makes it harder for a violation to end, not easier."""
        if self._side == 0:
            fail(here, leave.at, "`exit` has no side here", "no exit within count(...) == or !=", leave.text,
                 "leave it out: both more and fewer can end the violation")  # fmt: skip
        if beyond * self._side <= 0.0:
            side = "above" if is_below == (self._side > 0) else "below"
            why = "" if self._side > 0 else ", since it stands under `not`"
            fail(here, leave.at, "the limit after `exit` is on the wrong side",
                 f"one {side} the first{why}, so that a violation near the limit does not flicker", leave.text,
                 "exchange the two limits, or leave out `exit`")  # fmt: skip

    def _use(self, tree: Use, scope: Scope, here: Text, text: str) -> Condition:
        name = tree.name.text
        if name in words.PREDICATES:
            return self._predicate(tree, scope, here, text)
        definition = self._declared.definitions.get(name)
        if definition is None:
            known = [*self._declared.definitions, *words.PREDICATES, *words.MEASURES, "count"]
            fail(here, tree.name.at, f"unknown condition {name}{alike(name, known)}", ", ".join(known), name,
                 "mend the name, or define it under [definitions]")  # fmt: skip
        if name in here.path:
            fail(here, tree.name.at, f"the definition {name} uses itself", "definitions that end",
                 " -> ".join([*here.path, name]), "take the circle apart")  # fmt: skip
        require_count(len(definition.variables), tree.arguments, tree.name, here)
        self._used[name] = None
        inner: dict[str, Variable] = {}
        for variable, place in zip(definition.variables, tree.arguments, strict=True):
            if place.part is not None:
                fail(here, place.part.at, "a definition takes variables", place.base.text, place.text,
                     f"leave out .{place.part.text}")  # fmt: skip
            inner[variable.text] = self._names.variable(place.base, scope, here)
        given = {v.text: place for v, place in zip(definition.variables, tree.arguments, strict=True)}
        before, self._names.touched = self._names.touched, set()
        inside = Text(definition.text, name, given, here)
        body = self._condition(definition.body, inner, inside)
        for word in definition.variables:
            if inner[word.text].slot not in self._names.touched:
                fail(inside, 0, f"the definition {name} says nothing about {word.text}", f"a use of {word.text}",
                     definition.text, f"leave {word.text} out")  # fmt: skip
        self._names.touched |= before
        slots = [inner[word.text].slot for word in definition.variables]
        return Defined(itemgetter(*slots), body, definition.number, text)

    def _predicate(self, tree: Use, scope: Scope, here: Text, text: str) -> Condition:
        name, places = tree.name.text, tree.arguments
        require_count(2 if name == "inside" else 1, places, tree.name, here)
        if name == "mounted":
            variable = self._names.variable(places[0].base, scope, here)
            if places[0].part is not None or not variable.classes:
                self._names.blame(places[0], here, "only an object is mounted", "an object's variable", places[0].text,
                                  "write mounted(o)")  # fmt: skip
            if self._declared.openings:
                self._names.floor[text] = None
            return Mounted(variable.slot, tuple(opening.board for opening in self._declared.openings), text)
        point = self._names.point(places[0], scope, here)
        require_single(point, places[0], name, here)
        if name == "visible":
            return Visible(point, text)
        self._names.floor[text] = None
        return Inside(point, self._names.zone(places[1], here), text)
