"""A rule file: what is in it, read and checked."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NoReturn, TypeAlias, get_args

from recognition.errors import RulesError
from recognition.rules.checking import Checked, checked
from recognition.rules.document import Table
from recognition.rules.extents import Plan
from recognition.rules.naming import Declared, Definition
from recognition.rules.parsing import ExpressionError, parse_condition, parse_head, parse_when
from recognition.rules.syntax import When
from recognition.rules.vocabulary import CLASSES, RESERVED, SHAPES, Shape
from recognition.rules.zones import Opening, Zone

FORMAT, VERSION = "recognition.rules", 1
OnUnknown: TypeAlias = Literal["hold", "clear"]
Severity: TypeAlias = Literal["info", "warning", "alarm"]
FOR_S, CLEAR_S, MAX_HOLD_S = 0.3, 0.3, 10.0
"""Where a rule does not say."""
_DAY_S = 86_400.0
_LEAST_M = 0.05
"""Sides of zones and openings are longer."""
_NAME = re.compile(r"[a-z][a-z0-9_-]{0,63}", re.ASCII)


@dataclass(frozen=True, slots=True)
class Rule:
    """What must not be."""

    name: str
    sentence: str
    """What is wrong where it holds, for people."""
    when: str
    """The condition, as it is written."""
    for_s: float
    """How long it must hold before it is raised, s."""
    clear_s: float
    """How long it must not hold before it is ended, s."""
    on_unknown: OnUnknown
    """``hold``: while it is unknown a violation goes on, and none begins; ``clear``: unknown counts as false."""
    max_hold_s: float
    """How long it is held while it is unknown, s."""
    severity: Severity
    tree: When
    """The condition's tree."""
    checked: Checked
    """The condition, to be judged."""


@dataclass(frozen=True, slots=True)
class RuleSet:
    """The rules of a file; :func:`load_rules` makes it."""

    name: str
    version: int
    """Of the language."""
    digest: str
    """``sha256:`` and the SHA-256 of the file."""
    rules: tuple[Rule, ...]
    definitions: Mapping[str, Definition]
    zones: Mapping[str, Zone]
    openings: tuple[Opening, ...]
    classes: Mapping[str, Shape]
    """All that the rules may speak about."""

    def rule(self, name: str) -> Rule:
        """The rule of this name; KeyError where there is none."""
        for rule in self.rules:
            if rule.name == name:
                return rule
        raise KeyError(name)

    @property
    def needs_floor(self) -> tuple[tuple[str, str], ...]:
        """Rules that need the floor or the vertical, each with what of it does."""
        return tuple((rule.name, rule.checked.floor[0]) for rule in self.rules if rule.checked.floor)


def load_rules(path: Path) -> RuleSet:
    """Read and check a rule file.

    Raises:
        RulesError: where it cannot be read, or has a mistake; it says in which line and column.
    """
    try:
        raw = path.read_bytes()
        text = raw.decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        line = raw[: error.start].count(b"\n") + 1 if isinstance(error, UnicodeDecodeError) else 1
        raise RulesError(
            "cannot read it",
            where=path,
            line=line,
            column=1,
            expected="a text file in UTF-8",
            got=str(error),
            do_next="check the name of the file and how it was saved",
        ) from None
    return parse_rules(text, path)


def parse_rules(text: str, where: Path | str) -> RuleSet:
    """Read and check the text of a rule file.

    Args:
        text: TOML, as :mod:`recognition.rules` describes it.
        where: Name of the file, for messages and for the rules' own.

    Raises:
        RulesError: where it has a mistake; it says in which line and column.
    """
    file = Table.of(text, where)
    file.only("format", "version", "name", "classes", "definitions", "zones", "openings", "rules")
    file.text("format", one_of=(FORMAT,))
    version = file.number("version", None, least=0, most=1e6)
    if version != VERSION:
        file.fail("version", f"rules of version {version:g} cannot be read", f"{VERSION}", f"{version:g}",
                  "use the release of recognition that the file was written for")  # fmt: skip
    name = file.text("name", Path(where).name.removesuffix(".toml").removesuffix(".rules") or "rules")
    classes = dict(CLASSES)
    for own, shape in _classes(file.table("classes")):
        classes[own] = shape
    declared = Declared(
        MappingProxyType(classes),
        MappingProxyType({zone.name: zone for zone in _zones(file.table("zones"), classes)}),
        tuple(_openings(file.table("openings"))),
        MappingProxyType({d.name: d for d in _definitions(file.table("definitions"), classes)}),
    )
    rules = _rules(file, declared)
    digest = f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
    return RuleSet(
        name, VERSION, digest, rules, declared.definitions, declared.zones, declared.openings, declared.classes
    )


def _classes(table: Table) -> Iterator[tuple[str, Shape]]:
    for name in table.names():
        shape = table.text(name, one_of=SHAPES)
        if not name.isidentifier() or name in RESERVED:
            table.fail_key(name, "not a name for a class", "letters, digits and _", name, "choose another name")
        yield name, next(known for known in SHAPES if known == shape)


def _definitions(table: Table, classes: Mapping[str, Shape]) -> Iterator[Definition]:
    seen: dict[str, str] = {}
    for number, head in enumerate(table.names()):
        text = table.text(head)
        try:
            name, variables = parse_head(head)
        except ExpressionError as mistake:
            _refuse(table, table.places.key((*table.keys, head)) + 1 + mistake.at, mistake)
        if name.text in seen or name.text in classes:
            table.fail_key(head, f"the name {name.text} is taken", "one definition of a name",
                           seen.get(name.text, f"the class {name.text}"), "rename one of the two")  # fmt: skip
        seen[name.text] = head
        twice = [v.text for v, other in combinations(variables, 2) if v.text == other.text]
        if twice:
            table.fail_key(head, f"the variable {twice[0]} is there twice", "different variables", head,
                           "rename one of the two")  # fmt: skip
        try:
            body = parse_condition(text)
        except ExpressionError as mistake:
            _refuse(table, table.places.within((*table.keys, head), mistake.at), mistake)
        yield Definition(name.text, variables, text, body, number)


def _rules(file: Table, declared: Declared) -> tuple[Rule, ...]:
    tables = file.tables("rules")
    definitions = file.table("definitions")
    if not tables:
        file.fail("rules", "the file has no rule", "[[rules]]", "none", "add one")
    rules: list[Rule] = []
    for table in tables:
        rule = _rule(table, declared, definitions)
        if rule.name in [other.name for other in rules]:
            table.fail("name", f"two rules are named {rule.name}", "one name for each", rule.name, "rename one")
        rules.append(rule)
    used = {name for rule in rules for name in rule.checked.used}
    for head, definition in zip(definitions.names(), declared.definitions.values(), strict=True):
        if definition.name not in used:
            definitions.fail_key(head, f"no rule uses the definition {definition.name}", "definitions in use", head,
                                 "leave it out, or use it")  # fmt: skip
    return tuple(rules)


def _rule(table: Table, declared: Declared, definitions: Table) -> Rule:
    table.only("name", "sentence", "when", "for_s", "clear_s", "on_unknown", "max_hold_s", "severity")
    name = table.text("name")
    if not _NAME.fullmatch(name):
        table.fail("name", "not a name for a rule", "small letters, digits, _ and -, a letter first", name, "mend it")
    when = table.text("when")
    try:
        tree = parse_when(when)
        found = checked(tree, when, declared)
    except ExpressionError as mistake:
        if mistake.source is None:
            _refuse(table, table.places.within((*table.keys, "when"), mistake.at), mistake)
        number = list(declared.definitions).index(mistake.source)
        head = definitions.names()[number]
        _refuse(definitions, definitions.places.within((*definitions.keys, head), mistake.at), mistake)
    on_unknown = table.text("on_unknown", "hold", one_of=get_args(OnUnknown))
    severity = table.text("severity", "warning", one_of=get_args(Severity))
    return Rule(
        name=name,
        sentence=table.text("sentence"),
        when=when,
        for_s=table.number("for_s", FOR_S, least=0, most=_DAY_S, unit="s"),
        clear_s=table.number("clear_s", CLEAR_S, least=0, most=_DAY_S, unit="s"),
        on_unknown="hold" if on_unknown == "hold" else "clear",
        max_hold_s=table.number("max_hold_s", MAX_HOLD_S, least=0, most=_DAY_S, unit="s"),
        severity=next(known for known in get_args(Severity) if known == severity),
        tree=tree,
        checked=found,
    )


def _refuse(table: Table, offset: int, mistake: ExpressionError) -> NoReturn:
    table.fail_at(offset, mistake.problem, mistake.expected, mistake.got, mistake.do_next)


def _zones(table: Table, classes: Mapping[str, Shape]) -> Iterator[Zone]:
    for name in table.names():
        own = table.table(name)
        own.only("polygon_m", "height_m")
        if not name.isidentifier() or name in RESERVED or name in classes:
            table.fail_key(name, "not a name for a zone", "letters, digits and _, and no other word of rules", name,
                           "choose another name")  # fmt: skip
        corners = own.points("polygon_m")
        problem = _problem(corners)
        if problem:
            own.fail("polygon_m", f"the zone {name} {problem}", "three corners or more, in turn", list(corners),
                     "walk around the zone from corner to corner")  # fmt: skip
        low, high = own.numbers("height_m", 2, (-inf, inf))
        if low >= high:
            own.fail("height_m", f"the zone {name} has no height", "[low, high] in metres over the floor",
                     [low, high], "exchange the two")  # fmt: skip
        yield Zone(name, corners, low, high)


def _problem(corners: Plan) -> str:
    """Why corners are no polygon; empty where they are one."""
    if len(corners) < 3:
        return "has too few corners"
    sides = list(zip(corners, (*corners[1:], corners[0]), strict=True))
    if any(abs(ax - bx) < _LEAST_M and abs(ay - by) < _LEAST_M for (ax, ay), (bx, by) in sides):
        return "has a corner twice"
    if any(_cross(a, b) for a, b in combinations(sides, 2)):
        return "crosses itself"
    if abs(sum(ax * by - bx * ay for (ax, ay), (bx, by) in sides)) / 2 < _LEAST_M**2:
        return "has no area"
    return ""


def _cross(first: Plan, second: Plan) -> bool:
    """Whether two sides cross, other than at a common corner."""
    (a, b), (c, d) = first, second
    return _turn(a, b, c) * _turn(a, b, d) < 0 and _turn(c, d, a) * _turn(c, d, b) < 0


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _openings(table: Table) -> Iterator[Opening]:
    for name in table.names():
        own = table.table(name)
        own.only("from_m", "to_m", "height_m")
        ax, ay = own.numbers("from_m", 2)
        bx, by = own.numbers("to_m", 2)
        low, high = own.numbers("height_m", 2)
        if max(abs(bx - ax), abs(by - ay)) < _LEAST_M:
            own.fail("to_m", f"the opening {name} has no width", "another place than from_m", [bx, by],
                     "name both ends of its lower edge")  # fmt: skip
        if high - low < _LEAST_M:
            own.fail("height_m", f"the opening {name} has no height", "[low, high] in metres over the floor",
                     [low, high], "exchange the two")  # fmt: skip
        yield Opening(name, (ax, ay), (bx, by), low, high)
