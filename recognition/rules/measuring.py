"""Measures and limits: terms with their kinds, ways and units checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from recognition.rules import vocabulary as words
from recognition.rules.cast import WORKER
from recognition.rules.naming import Names, Scope, Text, fail
from recognition.rules.syntax import Measure, Name, Place, Quantity
from recognition.rules.terms import (
    Apart,
    Clearance,
    Nearest,
    PointOf,
    Speed,
    Term,
    ToAxis,
    ToExtent,
    ToFootprint,
    ToTop,
    ToZone,
)
from recognition.rules.vocabulary import alike

_Make: TypeAlias = Callable[[PointOf], Term]


class Measures:
    """Makes the terms of a rule."""

    def __init__(self, names: Names) -> None:
        self._names = names
        self.timed: dict[tuple[str, str], None] = {}
        """Kinds and points whose speed is asked for."""

    def term(self, measure: Measure, scope: Scope, here: Text) -> Term:
        """The term of a measure."""
        name, places = measure.name.text, measure.arguments
        text = here.text[measure.at : measure.end]
        require_count(2 if name == "dist" else 1, places, measure.name, here)
        if measure.way is not None and name != "dist":
            fail(here, measure.way.at, f"{name} has one way to be measured", f"{name}(...)", text,
                 f"leave out {measure.way.text}")  # fmt: skip
        if name == "dist":
            return self._distance(measure, scope, here, text)
        point = self._names.point(places[0], scope, here)
        require_single(point, places[0], name, here)
        if name == "clearance":
            self._names.floor[text] = None
            return Clearance(point)
        for kind in scope[places[0].base.text].classes or (WORKER,):
            self.timed[kind, point.name] = None
        return Speed(point)

    def _distance(self, measure: Measure, scope: Scope, here: Text, text: str) -> Term:
        first, second = measure.arguments
        if self._names.is_extended(first, scope):
            first, second = second, first
        if self._names.is_extended(first, scope):
            fail(here, first.base.at, "a distance needs a point", "one point at least, such as w.feet", text,
                 "measure from a point")  # fmt: skip
        point = self._names.point(first, scope, here)
        way = measure.way.text if measure.way else "3d"
        if way != "3d":
            self._names.floor[text] = None
        if not self._names.is_extended(second, scope):
            other = self._names.point(second, scope, here)
            if point == other or words.HANDS == point.name == other.name:
                fail(here, second.base.at, "a distance between the same", "two different points", text, "mend one")
            return _of_hands(point, lambda one: _of_hands(other, lambda two: Apart(one, two, way)))
        at = measure.way or measure.name
        if second.part is None:
            zone = self._names.zone(second, here)
            _require_way(way, ("xy",), "a zone", at, here)
            return _of_hands(point, lambda one: ToZone(one, zone))
        part, slot = second.part.text, self._names.variable(second.base, scope, here).slot
        self._names.require_part(second, scope, here)
        _require_way(way, words.WAYS_OF_PART[part], f"the {part} of an object", at, here)
        return _of_hands(point, lambda one: _to_part(part, one, slot, way))


def limit_of(quantity: Quantity, measure: Measure, workers: int, here: Text) -> float:
    """In metres, metres per second, or a share of the height."""
    unit, name = quantity.unit, measure.name.text
    if unit.text not in words.UNITS:
        fail(here, unit.at, f"unknown unit {unit.text}{alike(unit.text, list(words.UNITS))}", ", ".join(words.UNITS),
             unit.text, "mend the unit")  # fmt: skip
    kind, factor = words.UNITS[unit.text]
    if kind != ("speed" if name == "speed" else "length"):
        fitting = [u for u, (k, _) in words.UNITS.items() if k != kind]
        fail(here, unit.at, f"{name} is not measured in {unit.text}", ", ".join(fitting), quantity.text,
             "mend the unit")  # fmt: skip
    if unit.text == "H" and workers != 1:
        fail(here, unit.at, "whose height?", "a measure about one worker, or a limit in metres",
             f"{workers} workers in {here.text[measure.at : measure.end]}", "write the limit in m")  # fmt: skip
    value = quantity.value * factor
    most = words.MOST_SPEED_M_PER_S if kind == "speed" else words.MOST_LENGTH_M
    if unit.text == "H":
        most = words.MOST_HEIGHTS
    if not words.LEAST_LENGTH_M <= value <= most:
        fail(here, quantity.at, "an impossible limit",
             f"{_plain(words.LEAST_LENGTH_M / factor)} to {_plain(most / factor)} {unit.text}",
             quantity.text, "mend the limit")  # fmt: skip
    return value


def _plain(value: float) -> str:
    return f"{value:.3g}"


def _of_hands(point: PointOf, make: _Make) -> Term:
    """The term of a point; of both hands, the smaller of two terms."""
    if point.name != words.HANDS:
        return make(point)
    return Nearest(tuple(make(replace(point, name=name)) for name in ("left_wrist", "right_wrist")))


def _to_part(part: str, point: PointOf, slot: int, way: str) -> Term:
    if part == words.AXIS:
        return ToAxis(point, slot, way)
    if part == words.FOOTPRINT:
        return ToFootprint(point, slot)
    return ToTop(point, slot) if part == words.TOP else ToExtent(point, slot)


def require_single(point: PointOf, place: Place, name: str, here: Text) -> None:
    """Refuse both hands where one point is meant."""
    if point.name == words.HANDS:
        fail(here, place.base.at, f"{name} is about one point", "left_wrist or right_wrist", place.text,
             "hands are for dist(...), where the nearer counts")  # fmt: skip


def _require_way(way: str, known: tuple[str, ...], what: str, at: Name, here: Text) -> None:
    if way not in known:
        fail(here, at.at, f"a distance to {what} is not measured in {way}", " or ".join(known), way,
             f"write dist(..., {known[0]})")  # fmt: skip


def require_count(wanted: int, places: tuple[Place, ...], name: Name, here: Text) -> None:
    """Refuse another number of arguments."""
    if len(places) != wanted:
        fail(here, name.at, f"{name.text} takes {wanted} argument{'s' * (wanted != 1)}", f"{wanted}", len(places),
             "add what is missing, or leave out what is too much")  # fmt: skip
