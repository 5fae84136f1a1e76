"""The walk: steps one after the other, each with what it is about and which rules it breaks; as a file one can edit.

::

    format = "recognition.walk"
    version = 1
    name = "hall-3"

    [[steps]]
    say = "The second worker lets go of the ladder and steps back."
    about = ["ladder"]        # rules that must be able to tell, one way or the other
    violates = ["ladder"]     # rules that must find something; all others must not
    prepare_s = 5             # to get there; nothing is judged meanwhile
    seconds = 15              # as long as it is judged
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from recognition.errors import CommissionError
from recognition.rules import RuleSet

FORMAT, VERSION = "recognition.walk", 1
LEAST_S, MOST_S = 1.0, 3600.0
"""How long a step is judged."""


@dataclass(frozen=True, slots=True)
class Step:
    """One thing that is done."""

    say: str
    """What to do, for those who do it."""
    about: tuple[str, ...]
    """Rules that must be able to tell whether it is a violation."""
    violates: tuple[str, ...]
    """Rules that it violates; no other may find anything."""
    prepare_s: float
    """Time to get there, which is not judged."""
    seconds: float
    """How long it is judged."""


@dataclass(frozen=True, slots=True)
class Walk:
    """Steps, in order."""

    name: str
    steps: tuple[Step, ...]

    @property
    def seconds(self) -> float:
        """How long it takes by the clock."""
        return sum(step.prepare_s + step.seconds for step in self.steps)


@dataclass(frozen=True, slots=True)
class Performed:
    """A step that was done."""

    step: Step
    start_ns: int
    """Rig time from which on it is judged."""
    end_ns: int


def by_the_clock(walk: Walk, start_ns: int) -> tuple[Performed, ...]:
    """The steps of a walk that began at a rig time and kept to its own times."""
    found, at_s = [], 0.0
    for step in walk.steps:
        first_s = at_s + step.prepare_s
        at_s = first_s + step.seconds
        found.append(Performed(step, start_ns + round(first_s * 1e9), start_ns + round(at_s * 1e9)))
    return tuple(found)


def as_done(name: str, performed: Sequence[Performed], start_ns: int) -> Walk:
    """The walk that keeps by the clock to what was done: for the recording that begins at ``start_ns``."""
    steps, before_ns = [], start_ns
    for done in performed:
        prepare_s = max(done.start_ns - before_ns, 0) * 1e-9
        steps.append(replace(done.step, prepare_s=prepare_s, seconds=(done.end_ns - done.start_ns) * 1e-9))
        before_ns = done.end_ns
    return Walk(name, tuple(steps))


def require_suited(walk: Walk, rules: RuleSet, where: Path | str) -> None:
    """Refuse a walk that names rules which a rule file does not have.

    Raises:
        CommissionError: for the first such name.
    """
    names = [rule.name for rule in rules.rules]
    for number, step in enumerate(walk.steps, start=1):
        for name in (*step.about, *step.violates):
            if name not in names:
                raise CommissionError(
                    f"step {number} of the walk names the rule {name}, which there is not",
                    where=where,
                    expected=f"rules of {rules.name}: {', '.join(names)}",
                    got=name,
                    do_next="correct the step, or give the rules that the walk was written for",
                )


def load_walk(path: Path) -> Walk:
    """Read a walk.

    Raises:
        CommissionError: where it cannot be read, or is no walk.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise _refused(path, "cannot read this walk", "a text file in TOML", error) from error
    form = content.get("format"), content.get("version")
    if form != (FORMAT, VERSION):
        raise _refused(path, "this is no walk", f'format = "{FORMAT}", version = {VERSION}', form)
    _known(path, content, ("format", "version", "name", "steps"), "the walk")
    steps = content.get("steps")
    if not isinstance(steps, list) or not steps or not all(isinstance(step, dict) for step in steps):
        raise _refused(path, "the walk has no steps", "[[steps]]", type(steps).__name__)
    name = content.get("name", path.name.removesuffix(".toml").removesuffix(".walk"))
    return Walk(str(name), tuple(_step(path, step, number) for number, step in enumerate(steps, start=1)))


def walk_text(walk: Walk) -> str:
    """A walk as :func:`load_walk` reads it."""
    head = [f'format = "{FORMAT}"', f"version = {VERSION}", f"name = {_quoted(walk.name)}", ""]
    for step in walk.steps:
        head += ["[[steps]]", f"say = {_quoted(step.say)}"]
        head += [f"{key} = [{', '.join(map(_quoted, getattr(step, key)))}]" for key in ("about", "violates")]
        head += [f"{key} = {round(getattr(step, key), 3):g}" for key in ("prepare_s", "seconds")] + [""]
    return "\n".join(head)


def _quoted(text: str) -> str:
    """A basic string of TOML, which is one of JSON where DEL does not occur."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _step(path: Path, own: Mapping[str, Any], number: int) -> Step:
    what = f"step {number}"
    _known(path, own, ("say", "about", "violates", "prepare_s", "seconds"), what)
    say = own.get("say")
    if not isinstance(say, str) or not say:
        raise _refused(path, f"{what} does not say what to do", "say = a text", say)
    lists = {key: own.get(key, []) for key in ("about", "violates")}
    for key, names in lists.items():
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise _refused(path, f"{what} names no rules", f'{key} = ["RULE", ...]', names)
    violates = tuple(lists["violates"])
    return Step(
        say,
        tuple(dict.fromkeys((*lists["about"], *violates))),
        violates,
        _seconds(path, own, "prepare_s", what, 0.0),
        _seconds(path, own, "seconds", what, LEAST_S),
    )


def _seconds(path: Path, own: Mapping[str, Any], key: str, what: str, least: float) -> float:
    value = own.get(key, 0.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= MOST_S:
        raise _refused(path, f"{what} has no such {key}", f"seconds from {least:g} to {MOST_S:g}", value)
    return float(value)


def _known(path: Path, own: Mapping[str, Any], keys: tuple[str, ...], what: str) -> None:
    unknown = [key for key in own if key not in keys]
    if unknown:
        raise _refused(path, f"{what} has an entry that is not known", ", ".join(keys), unknown[0])


def _refused(path: Path, problem: str, expected: str, got: object) -> CommissionError:
    return CommissionError(
        problem,
        where=path,
        expected=expected,
        got=got,
        do_next="correct it, or begin with the walk that `recognition commission --plan` prints",
    )
