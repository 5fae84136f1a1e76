"""What rules measure: distances, heights and speeds, as intervals.

A term's value is ``(at least, at most)``, in metres or metres per second: both are the same where everything that it
needs is known, and ``(0, inf)`` where nothing is. See :mod:`recognition.rules.cast` for what is in between.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, sqrt
from typing import Any, TypeAlias

from recognition.rules.cast import Ball, Key, Thing, level_m
from recognition.rules.company import Company, Present
from recognition.rules.zones import Zone

Between: TypeAlias = tuple[float, float]
Ownership: TypeAlias = tuple[dict[Key, list[tuple[Key, float]]], dict[Key, tuple[Key, float]]]
"""Margins of each worker with objects, and the worker whose own an object is, with the margin of that."""
_UNKNOWN: Between = (0.0, inf)
_DECK_M = 0.5
"""Where its corners are not known, a deck is a disc: half of what lies between the length and the width of most."""
_ANKLE_M = 0.08
"""Height of ankles over what one stands on."""
_ANKLES = ("feet", "left_ankle", "right_ankle")


class Frame:
    """One instant, and whom the variables of a rule mean at the moment."""

    __slots__ = ("_crowned", "actors", "company", "is_active", "memo", "present", "tables")

    def __init__(self, company: Company, present: Present, variables: int) -> None:
        self.company, self.present = company, present
        self.actors: list[Any] = [None] * variables
        """Person or thing that each variable means."""
        self.is_active = False
        """Whether the violation that is judged lasts: then limits are those of ``exit``."""
        self.memo: dict[tuple[object, ...], float] = {}
        """Margins of definitions at this instant."""
        self.tables: dict[tuple[int, bool], Ownership] = {}
        """Whose is what at this instant."""
        self._crowned: dict[Key, int] | None = None

    def crowned(self, key: Key) -> int:
        """See :meth:`Company.crowned`; 0 of a worker who is not in the scene."""
        if self._crowned is None:
            self._crowned = self.company.crowned(self.present.workers)
        return self._crowned.get(key, 0)


def _thing(now: Frame, slot: int) -> Thing:
    found: Thing = now.actors[slot]
    return found


@dataclass(frozen=True, slots=True)
class PointOf:
    """A point of a worker or object: slot of the variable, name of the point."""

    slot: int
    name: str

    def ball(self, now: Frame) -> Ball:
        """Where it is."""
        found: Ball = now.actors[self.slot].point(self.name)
        return found


@dataclass(frozen=True, slots=True)
class Apart:
    """Distance of two points: ``3d``, ``xy`` on the plan, ``z`` in height."""

    first: PointOf
    second: PointOf
    way: str

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        first, second, actors = self.first, self.second, now.actors
        ax, ay, az, unsure = actors[first.slot].point(first.name)
        bx, by, bz, radius = actors[second.slot].point(second.name)
        if self.way == "3d":
            away = sqrt((ax - bx) * (ax - bx) + (ay - by) * (ay - by) + (az - bz) * (az - bz))
        elif self.way == "xy":
            away = hypot(ax - bx, ay - by)
        else:
            away = abs(az - bz)
        radius += unsure
        return (away - radius if away > radius else 0.0), away + radius


@dataclass(frozen=True, slots=True)
class ToAxis:
    """Distance from a ladder's axis: ``3d``, or ``xy`` on the point's own level."""

    point: PointOf
    slot: int
    way: str

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        ball, thing = self.point.ball(now), _thing(now, self.slot)
        x, y, z, radius = ball
        if thing.body is None or thing.body.axis is None:
            if self.way == "3d":
                return thing.extent_m(ball)
            away, radius = level_m(ball, thing.middle), radius + thing.middle[3]
            return (away - radius if away > radius else 0.0), away + radius
        axis = thing.body.axis
        away = axis.distance_m(x, y, z) if self.way == "3d" else axis.level_distance_m(x, y, z)
        return (away - radius if away > radius else 0.0), away + radius


@dataclass(frozen=True, slots=True)
class ToFootprint:
    """Distance on the plan from what a deck covers; 0 above and below it."""

    point: PointOf
    slot: int

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        ball, thing = self.point.ball(now), _thing(now, self.slot)
        x, y, _, radius = ball
        if thing.body is None or thing.body.footprint is None:
            away, radius = max(0.0, level_m(ball, thing.middle) - _DECK_M), radius + thing.middle[3]
            return (away - radius if away > radius else 0.0), away + radius
        away = thing.body.footprint.distance_m(x, y, 0.0)
        return (away - radius if away > radius else 0.0), away + radius


@dataclass(frozen=True, slots=True)
class ToTop:
    """Difference in height from what one stands on; of ankles, from where they are then."""

    point: PointOf
    slot: int

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        thing = _thing(now, self.slot)
        _, _, z, radius = self.point.ball(now)
        top_m = 2 * thing.middle[2] if thing.body is None else thing.body.top_m  # it stands on the floor
        if thing.body is None:
            radius += thing.middle[3]
        away = abs(z - top_m - (_ANKLE_M if self.point.name in _ANKLES else 0.0))
        return (away - radius if away > radius else 0.0), away + radius


@dataclass(frozen=True, slots=True)
class ToExtent:
    """Distance from what an object occupies; 0 on it."""

    point: PointOf
    slot: int

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        return _thing(now, self.slot).extent_m(self.point.ball(now))


@dataclass(frozen=True, slots=True)
class ToZone:
    """Distance from a zone on the plan; 0 inside."""

    point: PointOf
    zone: Zone

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        x, y, _, radius = self.point.ball(now)
        if radius == inf:
            return _UNKNOWN
        away = self.zone.distance_m(x, y)
        return (away - radius if away > radius else 0.0), away + radius


@dataclass(frozen=True, slots=True)
class Nearest:
    """The smallest of several: of both hands."""

    terms: tuple[Term, ...]

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        first, second = (term.between(now) for term in self.terms)
        return min(first[0], second[0]), min(first[1], second[1])


@dataclass(frozen=True, slots=True)
class Clearance:
    """Height over the floor."""

    point: PointOf

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        _, _, z, radius = self.point.ball(now)
        return z - radius, z + radius


@dataclass(frozen=True, slots=True)
class Speed:
    """How fast a point moves, over the last half second."""

    point: PointOf

    def between(self, now: Frame) -> Between:
        """At least, at most."""
        return now.company.speed_m_per_s(now.actors[self.point.slot], self.point.name, now.present.t_ns)


Term: TypeAlias = Apart | ToAxis | ToFootprint | ToTop | ToExtent | ToZone | Nearest | Clearance | Speed
"""Something that can be measured."""
