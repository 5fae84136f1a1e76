"""Conditions with three values and margins, for one instant.

A condition is its margin: positive where it is true, negative where it is false, NaN where it is unknown, never 0. Of a
comparison it is the distance from the limit as a share of the limit, 1 at most; ``and`` is the smallest, ``or`` the
largest, ``not`` the negated one, as in the quantitative semantics of signal temporal logic (Donze and Maler, "Robust
satisfaction of temporal logic over real-valued signals", 2010). What is unknown follows Kleene: ``and`` with something
false is false, ``or`` with something true is true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import Any, TypeAlias

from recognition.rules.cast import OWN_S, Key, Person, Thing
from recognition.rules.company import Member
from recognition.rules.extents import Board
from recognition.rules.syntax import Domain
from recognition.rules.terms import Frame, Ownership, PointOf, Term
from recognition.rules.vocabulary import CROWN
from recognition.rules.zones import Zone

SEEN_BY = 2
"""Cameras that place a point; what fewer see is not ``visible``."""
MOUNTED_M = 0.25
"""All corners of a window that is mounted are nearer than this to its opening."""
_BARELY = 1e-12
"""Instead of a margin of 0."""
_FULLY = 1.0
"""Margin of what has no measure."""


def any_of(margins: Iterable[float]) -> float:
    """Kleene's ``or``: the largest; unknown where one is, unless another is true. False of nothing."""
    most, is_unknown = -_FULLY, False
    for margin in margins:
        if margin > most:
            most = margin
        elif isnan(margin):
            is_unknown = True
    return nan if is_unknown and most < 0.0 else most


@dataclass(frozen=True, slots=True)
class Compare:
    """A measure and its limit."""

    term: Term
    is_below: bool
    limit: float
    """Metres, metres per second, or a share of the height of the worker in ``height_of``."""
    leave: float
    """The limit while the violation lasts."""
    height_of: int | None
    unit: str
    """In which the rule states it."""
    text: str

    def limits_now(self, now: Frame) -> tuple[float, float]:
        """In metres or metres per second, at least and at most: the same, unless the height was not measured yet."""
        limit = self.leave if now.is_active else self.limit
        if self.height_of is None:
            return limit, limit
        height_m = now.actors[self.height_of].height_m
        low_m, high_m = now.company.adult_m if isnan(height_m) else (height_m, height_m)
        return limit * low_m, limit * high_m

    def margin(self, now: Frame) -> float:
        """By which share of the limit it holds."""
        least, most = self.term.between(now)
        low, high = self.limits_now(now)
        if self.is_below:
            if most < low:
                return min((low - most) / low, _FULLY)
            return max((high - least) / high, -_FULLY) or -_BARELY if least >= high else nan
        if least > high:
            return min((least - high) / high, _FULLY)
        return max((most - low) / low, -_FULLY) or -_BARELY if most <= low else nan


@dataclass(frozen=True, slots=True)
class Visible:
    """Whether two cameras see a point now: true or unknown, so that nothing is decided by what nobody sees.

    A crown is seen by those that see the head and whose image holds all of a hat on it.
    """

    point: PointOf
    text: str

    def views(self, now: Frame) -> int:
        """How many cameras see it."""
        member: Member = now.actors[self.point.slot]
        seen = member.views(self.point.name)
        return min(seen, now.crowned(member.key)) if self.point.name == CROWN else seen

    def margin(self, now: Frame) -> float:
        """1, or unknown."""
        return _FULLY if self.views(now) >= SEEN_BY else nan


@dataclass(frozen=True, slots=True)
class Inside:
    """Whether a point is in a zone; the margin is how far inside, in metres, at most 1."""

    point: PointOf
    zone: Zone
    text: str

    def margin(self, now: Frame) -> float:
        """Metres to the border."""
        x, y, z, radius = self.point.ball(now)
        depth = self.zone.inside_m(x, y, z)
        if abs(depth) <= radius:
            return nan if radius else -_BARELY
        return max(min(depth - radius, _FULLY), _BARELY) if depth > 0 else min(max(depth + radius, -_FULLY), -_BARELY)


@dataclass(frozen=True, slots=True)
class Mounted:
    """Whether a window is in a declared opening."""

    slot: int
    openings: tuple[Board, ...]
    text: str

    def margin(self, now: Frame) -> float:
        """By which share of :data:`MOUNTED_M` it is nearer to an opening."""
        if not self.openings:
            return -_FULLY
        thing: Thing = now.actors[self.slot]
        x, y, z, radius = thing.middle
        if radius > 0.0:
            return nan
        points = [(x, y, z)]
        board = None if thing.body is None else thing.body.board
        if board is not None:
            points += _corners(board)
        away = min(max(opening.distance_m(*p) for p in points) for opening in self.openings)
        margin = max((MOUNTED_M - away) / MOUNTED_M, -_FULLY) or -_BARELY
        return nan if margin > 0 and board is None else margin


def _corners(board: Board) -> Iterator[tuple[float, float, float]]:
    (x, y, z), (ax, ay, az), (bx, by, bz) = board.centre, board.along, board.across
    for a in (-board.half_along_m, board.half_along_m):
        for b in (-board.half_across_m, board.half_across_m):
            yield x + a * ax + b * bx, y + a * ay + b * by, z + a * az + b * bz


@dataclass(frozen=True, slots=True)
class Negated:
    """``not``"""

    body: Condition
    text: str

    def margin(self, now: Frame) -> float:
        """The other way round."""
        return -self.body.margin(now)


@dataclass(frozen=True, slots=True)
class Joined:
    """``and``, ``or``"""

    parts: tuple[Condition, ...]
    is_all: bool
    text: str

    def margin(self, now: Frame) -> float:
        """The smallest, or the largest; the rest is not asked for once there is nothing smaller."""
        if not self.is_all:
            return any_of([part.margin(now) for part in self.parts])
        least, is_unknown = _FULLY, False
        for part in self.parts:
            if least < 0.0 and isinstance(part, Visible):
                continue  # which is never false
            margin = part.margin(now)
            if margin < least:
                if margin <= -_FULLY:
                    return margin
                least = margin
            elif isnan(margin):
                is_unknown = True
        return nan if is_unknown and least > 0.0 else least


@dataclass(frozen=True, slots=True)
class Among:
    """Whom a quantifier speaks about."""

    slot: int
    classes: tuple[str, ...]
    """Of objects; empty for workers."""
    apart: tuple[int, ...]
    """Slots of those that it must not be."""
    domain: Domain

    def here(self, now: Frame) -> Sequence[Member]:
        """Those in the scene."""
        return self._without(now.present.workers if not self.classes else self._things(now), now)

    def all(self, now: Frame) -> Sequence[Member]:
        """Those in the scene, and workers who were lost."""
        return self._without(now.present.everybody if not self.classes else self._things(now), now)

    def margins(self, now: Frame, body: Condition) -> Iterator[tuple[Member, float]]:
        """Each of them with the margin of a condition about it."""
        actors, slot = now.actors, self.slot
        for member in self.all(now):
            actors[slot] = member
            yield member, body.margin(now)

    def _things(self, now: Frame) -> Sequence[Member]:
        things = now.present.things
        if len(self.classes) == 1:
            return things[self.classes[0]]
        return [thing for name in self.classes for thing in things[name]]

    def _without(self, members: Sequence[Member], now: Frame) -> Sequence[Member]:
        if not self.apart:
            return members
        apart = [now.actors[slot].key for slot in self.apart]
        return [member for member in members if member.key not in apart]


@dataclass(frozen=True, slots=True)
class Some:
    """``exists``"""

    among: Among
    body: Condition
    text: str

    def margin(self, now: Frame) -> float:
        """The largest."""
        return any_of([margin for _, margin in self.among.margins(now, self.body)])


@dataclass(frozen=True, slots=True)
class SomeOwn:
    """``exists hard_hat o of w``: one that is nobody else's, and that a camera saw not long ago.

    Of all workers in the scene and all objects, pairs for which the condition is true are given away by their margins,
    the largest first, each worker and each object once.
    """

    among: Among
    owner: int
    """Slot of the worker."""
    body: Condition
    number: int
    """Of the condition, for what is remembered of the instant."""
    text: str

    def margin(self, now: Frame) -> float:
        """The largest, where what belongs to another counts as false, by how much better it suits that one."""
        own: Person = now.actors[self.owner]
        pairs, given = self.table(now)
        if own.key not in pairs:  # one who was lost
            pairs = {own.key: self._row(now)}
        margins = []
        for key, margin in pairs[own.key]:
            holder, held = given.get(key, (own.key, 0.0))
            margins.append(margin if holder == own.key else min(margin - held, -_BARELY))
        return any_of(margins)

    def table(self, now: Frame) -> Ownership:
        """The margins of all workers in the scene with all objects, and whose own each object is."""
        known = now.tables.get((self.number, now.is_active))
        if known is not None:
            return known
        own = now.actors[self.owner]
        pairs = {}
        for person in now.present.workers:
            now.actors[self.owner] = person
            pairs[person.key] = self._row(now)
        now.actors[self.owner] = own
        given: dict[Key, tuple[Key, float]] = {}
        served = set()
        true = sorted((-margin, worker, key) for worker, row in pairs.items() for key, margin in row if margin > 0.0)
        for margin, worker, key in true:
            if key not in given and worker not in served:
                given[key] = worker, -margin
                served.add(worker)
        found = now.tables[self.number, now.is_active] = pairs, given
        return found

    def _row(self, now: Frame) -> list[tuple[Key, float]]:
        """The margins of the worker whom the frame means, with all objects."""
        actors, slot = now.actors, self.among.slot
        row = []
        for thing in self.among.all(now):
            if isinstance(thing, Thing) and thing.unseen_s <= OWN_S:
                actors[slot] = thing
                row.append((thing.key, self.body.margin(now)))
        return row


@dataclass(frozen=True, slots=True)
class Number:
    """``count``: at least those for whom the condition is true, at most those for whom it is not false."""

    among: Among
    body: Condition
    operator: str
    number: int
    text: str

    def between(self, now: Frame) -> tuple[int, int]:
        """At least, at most."""
        margins = [margin for _, margin in self.among.margins(now, self.body)]
        least = sum(margin > 0.0 for margin in margins)
        return least, least + sum(isnan(margin) for margin in margins)

    def margin(self, now: Frame) -> float:
        """How many more or fewer would change it, as a share of the number."""
        least, most = self.between(now)
        share = max(self.number, 1)
        if self.operator in ("==", "!="):
            equal = -_FULLY
            if least <= self.number <= most:
                equal = _FULLY if least == most else nan
            return equal if self.operator == "==" else -equal
        limit = self.number + {"<": -0.5, "<=": 0.5, ">": 0.5, ">=": -0.5}[self.operator]
        if self.operator in ("<", "<="):
            low, high = (limit - most) / share, (limit - least) / share
        else:
            low, high = (least - limit) / share, (most - limit) / share
        if low > 0.0:
            return min(low, _FULLY)
        return max(high, -_FULLY) if high < 0.0 else nan


@dataclass(frozen=True, slots=True)
class Defined:
    """The use of a definition; judged once an instant for the same workers and objects."""

    arguments: Callable[[list[Any]], object]
    """Takes those whom its arguments mean from the frame's actors."""
    body: Condition
    number: int
    """Of the definition."""
    text: str

    def margin(self, now: Frame) -> float:
        """That of the definition."""
        key = (self.number, now.is_active, self.arguments(now.actors))
        found = now.memo.get(key)
        if found is None:
            found = now.memo[key] = self.body.margin(now)
        return found


Condition: TypeAlias = Compare | Visible | Inside | Mounted | Negated | Joined | Some | SomeOwn | Number | Defined


def involved(condition: Condition, now: Frame) -> Iterator[tuple[str, Member]]:
    """Who makes a condition true, with the names that the rule gives them; nobody for what must not be.

    Of ``exists`` the one with the largest margin, of ``count`` all for whom it is true.
    """
    if isinstance(condition, Joined):
        for part in condition.parts:
            if part.margin(now) > 0.0:
                yield from involved(part, now)
    elif isinstance(condition, Defined):
        yield from involved(condition.body, now)
    elif isinstance(condition, Some | SomeOwn | Number):
        found = [(margin, actor) for actor, margin in condition.among.margins(now, condition.body) if margin > 0.0]
        if not isinstance(condition, Number) and found:
            found = [max(found, key=lambda pair: pair[0])]
        for _, actor in found:
            yield condition.among.domain.variable.text, actor
            now.actors[condition.among.slot] = actor
            yield from involved(condition.body, now)
