"""A walk from a rule file: for each rule steps that must be safe, and steps that must be a violation.

The four violations of the Safe-Construct paper have steps of their own, which look like the violation and are none,
or the other way round; any other rule is walked by its sentence. With the rules of ``site.rules.toml`` the walk takes
ten minutes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from recognition.commissioning.results import found_within_s
from recognition.commissioning.walk import Step, Walk
from recognition.rules import Rule, RuleSet


class _Line(NamedTuple):
    violates: bool
    say: str
    prepare_s: float
    seconds: float


_SAFE, _WRONG = False, True
_SLACK_S = 5.0
"""A violation lasts so much longer than it may take to be found."""
_KNOWN: Mapping[tuple[str, str], Sequence[_Line]] = MappingProxyType(
    {
        ("no_hat", "hard_hat"): (
            _Line(_SAFE, "One worker, hard hat on, walks through the middle of the scene and back.", 20, 30),
            _Line(_WRONG, "The worker takes the hat off and keeps it in one hand.", 5, 15),
            _Line(_SAFE, "The worker puts the hat on again, bends down to the floor and stands up.", 5, 20),
            _Line(_WRONG, "The worker takes the hat off, lays it on the floor and turns round once.", 10, 15),
            _Line(_SAFE, "The worker puts the hat on again and stands still.", 10, 15),
        ),
        ("ladder", "ladder"): (
            _Line(_SAFE, "One holds the ladder with both hands; a second climbs two steps up and stays there.", 30, 20),
            _Line(_WRONG, "Who holds it lets go and steps 2 m back; the climber stays, both hands on it.", 5, 15),
            _Line(_SAFE, "The first holds the ladder again, from its other side.", 5, 20),
            _Line(_WRONG, "Who holds it lets go and turns away, one step off.", 5, 15),
            _Line(_SAFE, "The climber comes down; both stand beside the ladder.", 10, 20),
        ),
        ("window", "large_window"): (
            _Line(_SAFE, "Two workers lift the large window and carry it across the scene.", 30, 25),
            _Line(_WRONG, "One lets go; the other keeps it a hand's breadth above the floor.", 5, 15),
            _Line(_SAFE, "Both carry it on together.", 5, 20),
            _Line(_WRONG, "Now the other one lets go, and walks beside it.", 5, 15),
            _Line(_SAFE, "They set it down; one leans on it, the other steps away.", 10, 20),
        ),
        ("platform", "platform"): (
            _Line(_SAFE, "One worker steps onto the platform and works there.", 20, 25),
            _Line(_WRONG, "A second worker steps onto it as well.", 10, 15),
            _Line(_SAFE, "The second steps down and stands close beside it.", 10, 20),
            _Line(_WRONG, "The second steps onto it again, at the other end.", 10, 15),
            _Line(_SAFE, "Both step down, and work beside it.", 10, 25),
        ),
    }
)
"""By rule, and by a class that it must speak about."""


def derived_walk(rules: RuleSet) -> Walk:
    """The walk for a rule file."""
    return Walk(rules.name, tuple(step for rule in rules.rules for step in _steps(rule)))


def _steps(rule: Rule) -> Iterator[Step]:
    known = [lines for (name, about), lines in _KNOWN.items() if name == rule.name and about in rule.checked.classes]
    least_s = found_within_s(rule) + _SLACK_S
    for line in known[0] if known else _by_sentence(rule):
        seconds = max(line.seconds, least_s) if line.violates else line.seconds
        yield Step(line.say, (rule.name,), (rule.name,) if line.violates else (), line.prepare_s, seconds)


def _by_sentence(rule: Rule) -> Iterator[_Line]:
    wrong = f"Without danger to anybody, bring it about that {rule.sentence}."
    yield _Line(_SAFE, f"Work as usual where it could happen that {rule.sentence}, and do not let it happen.", 20, 25)
    for _ in range(2):
        yield _Line(_WRONG, wrong, 10, 15)
        yield _Line(_SAFE, "End it, and go on as usual.", 10, 20)
