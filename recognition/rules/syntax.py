"""What an expression says, as it is written: the tree that :mod:`recognition.rules.parsing` makes.

``at`` and ``end`` are offsets into the expression's text.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class Name:
    """A word."""

    text: str
    at: int


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with its unit."""

    value: float
    unit: Name
    at: int
    text: str


@dataclass(frozen=True, slots=True)
class Place:
    """``w.head``, ``o``, or the name of a zone."""

    base: Name
    part: Name | None

    @property
    def text(self) -> str:
        """As it is written."""
        return self.base.text if self.part is None else f"{self.base.text}.{self.part.text}"


@dataclass(frozen=True, slots=True)
class Domain:
    """``w``, ``hard_hat o of w``, ``l in {ladder, step_ladder}``, ``v != w``: whom a quantifier speaks about."""

    variable: Name
    classes: tuple[Name, ...]
    """Of objects; empty for workers."""
    apart: tuple[Name, ...]
    """Variables that it must not be."""
    owner: Name | None
    """The worker of whom it must be the own."""


@dataclass(frozen=True, slots=True)
class Use:
    """``worn(w)``, ``visible(w.head)``: a predicate or a definition with its arguments."""

    name: Name
    arguments: tuple[Place, ...]
    at: int
    end: int


@dataclass(frozen=True, slots=True)
class Measure:
    """``dist(w.feet, l.axis, xy)``"""

    name: Name
    arguments: tuple[Place, ...]
    way: Name | None
    at: int
    end: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """``dist(w.head, o) < 0.10 H exit 0.13 H``"""

    measure: Measure
    operator: str
    limit: Quantity
    leave: Quantity | None
    at: int
    end: int


@dataclass(frozen=True, slots=True)
class Exists:
    """``exists v != w: holds(v, l)``"""

    domain: Domain
    body: Expression
    at: int
    end: int


@dataclass(frozen=True, slots=True)
class Count:
    """``count(w: touches(w, o)) < 2``"""

    domain: Domain
    body: Expression
    operator: str
    number: Quantity
    at: int
    end: int


@dataclass(frozen=True, slots=True)
class Not:
    """``not worn(w)``"""

    body: Expression
    at: int
    end: int


@dataclass(frozen=True, slots=True)
class Several:
    """Conditions joined by ``and``, or by ``or``."""

    word: str
    parts: tuple[Expression, ...]
    at: int
    end: int


Expression: TypeAlias = Use | Comparison | Exists | Count | Not | Several


@dataclass(frozen=True, slots=True)
class When:
    """``each w: ...``: for whom a rule is judged one by one, and what must not be."""

    each: tuple[Domain, ...]
    body: Expression
