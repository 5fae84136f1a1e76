"""Names in expressions: what each word means where it stands, and refusals that say where that is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn, TypeAlias

from recognition.rules import vocabulary as words
from recognition.rules.parsing import ExpressionError
from recognition.rules.syntax import Expression, Name, Place
from recognition.rules.terms import PointOf
from recognition.rules.vocabulary import Shape, alike
from recognition.rules.zones import Opening, Zone


@dataclass(frozen=True, slots=True)
class Definition:
    """A condition with a name."""

    name: str
    variables: tuple[Name, ...]
    text: str
    body: Expression
    number: int


@dataclass(frozen=True, slots=True)
class Declared:
    """What a rule file declares."""

    classes: Mapping[str, Shape]
    zones: Mapping[str, Zone]
    openings: tuple[Opening, ...]
    definitions: Mapping[str, Definition]


@dataclass(frozen=True, slots=True)
class Variable:
    """Whom a variable means."""

    slot: int
    classes: tuple[str, ...]
    """Of objects; empty for workers."""


Scope: TypeAlias = Mapping[str, Variable]
"""Variables by their names."""


@dataclass(frozen=True, slots=True)
class Text:
    """What is being checked, and from where it is used."""

    text: str
    source: str | None = None
    arguments: Mapping[str, Place] = field(default_factory=dict)
    caller: Text | None = None

    @property
    def path(self) -> tuple[str, ...]:
        """Names of the definitions that it is in."""
        outer = self.caller.path if self.caller else ()
        return outer if self.source is None else (*outer, self.source)


class Names:
    """What a rule's words mean, and which it uses."""

    def __init__(self, declared: Declared) -> None:
        self.declared = declared
        self.touched: set[int] = set()
        """Slots of variables about which something is said."""
        self.floor: dict[str, None] = {}
        """What needs the floor or the vertical, as it is written."""

    def variable(self, name: Name, scope: Scope, here: Text) -> Variable:
        """The variable of a name; it counts as spoken about."""
        variable = scope.get(name.text)
        if variable is None:
            if name.text in self.declared.zones:
                fail(here, name.at, f"{name.text} is a zone", "a worker's or an object's variable", name.text,
                     f"write inside(w.feet, {name.text})")  # fmt: skip
            known = [*scope, *self.declared.zones]
            fail(here, name.at, f"unknown name {name.text}{alike(name.text, known)}",
                 ", ".join(known) if known else "a variable of each, exists or count", name.text,
                 "mend the name, or bring it in with each, exists or count")  # fmt: skip
        self.touched.add(variable.slot)
        return variable

    def zone(self, place: Place, here: Text) -> Zone:
        """The zone that a place names."""
        name = place.base
        if place.part is not None or name.text not in self.declared.zones:
            known = list(self.declared.zones)
            fail(here, name.at, f"unknown zone {place.text}{alike(name.text, known)}",
                 ", ".join(known) if known else "a zone under [zones.NAME]", place.text,
                 f"declare it: [zones.{name.text}] with its polygon_m")  # fmt: skip
        return self.declared.zones[name.text]

    def is_extended(self, place: Place, scope: Scope) -> bool:
        """Whether it is no point: a part of an object, or a zone."""
        if place.part is not None:
            return place.part.text in words.SHAPES_OF_PART
        return place.base.text not in scope and place.base.text in self.declared.zones

    def point(self, place: Place, scope: Scope, here: Text) -> PointOf:
        """The point that a place names."""
        variable = self.variable(place.base, scope, here)
        if place.part is None:
            if not variable.classes:
                self.blame(place, here, f"which point of {place.text}?", "a worker's point: " + listed_points(),
                           place.text, f"write {place.text}.torso, or the point that is meant")  # fmt: skip
            return PointOf(variable.slot, "centre")
        self.require_part(place, scope, here)
        if place.part.text == "bottom":
            self.floor[place.text] = None
        if place.part.text in words.SHAPES_OF_PART:
            fail(here, place.part.at, f"{place.text} is no point", "a point", place.text,
                 f"dist(POINT, {place.text}, ...) measures the distance from it")  # fmt: skip
        return PointOf(variable.slot, place.part.text)

    def require_part(self, place: Place, scope: Scope, here: Text) -> None:
        """Refuse a point or part that the variable's kind does not have."""
        variable, part = self.variable(place.base, scope, here), place.part
        if part is None:
            return
        everything = [*words.WORKER_POINTS, *words.OBJECT_POINTS, *words.SHAPES_OF_PART]
        if part.text not in everything:
            known = list(words.WORKER_POINTS) if not variable.classes else [*words.OBJECT_POINTS, *words.SHAPES_OF_PART]
            fail(here, part.at, f"unknown point {part.text}{alike(part.text, everything)}", ", ".join(known),
                 part.text, "mend the name")  # fmt: skip
        if not variable.classes:
            if part.text not in words.WORKER_POINTS:
                self.blame(place, here, f"a worker has no {part.text}", listed_points(), place.text,
                           "name an object, or a point of the worker")  # fmt: skip
            return
        if part.text in words.OBJECT_POINTS:
            return
        shapes = words.SHAPES_OF_PART.get(part.text, ())
        wrong = [name for name in variable.classes if self.declared.classes[name] not in shapes]
        if wrong:
            have = [name for name, shape in self.declared.classes.items() if shape in shapes]
            self.blame(place, here, f"a {wrong[0]} has no {part.text}",
                       f"one of {', '.join(have)}" if have else "a worker", place.text,
                       "name another, or another part: centre, bottom, extent")  # fmt: skip

    def blame(self, place: Place, here: Text, problem: str, expected: str, got: str, do_next: str) -> NoReturn:
        """Refuse a place: where it is an argument, at the outermost use that gave it."""
        at, text = (place.part or place.base).at, here
        base = place.base.text
        while base in text.arguments and text.caller is not None:
            given = text.arguments[base]
            at, base, text = given.base.at, given.base.text, text.caller
        got = got if text is here else f"{base}, where {here.source} needs {place.text}"
        fail(text, at, problem, expected, got, do_next)


def listed_points() -> str:
    """The points of workers, for messages."""
    return ", ".join((*words.BODY_POINTS, words.HANDS)) + " and the joints, such as left_wrist"


def fail(here: Text, at: int, problem: str, expected: str, got: object, do_next: str) -> NoReturn:
    """Refuse what stands at an offset of a text."""
    raise ExpressionError(at, problem, expected=expected, got=str(got), do_next=do_next, source=here.source)
