"""A simulated sequence as a walk of `recognition commission`: its steps are what its truth says.

    python -m tools.truth_walk SEQUENCE > NAME.walk.toml
    recognition commission RIG --rules FILE --recording IN.mcap --script NAME.walk.toml --simulated --by NAME

A step lasts from one start or end of a violation to the next, but for the half second before that in which a rule may
see it come.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from recognition.commissioning import Step, Walk, walk_text
from recognition.evaluation.violations import KINDS, NEAR_S

_LEAST_S = 1.0
"""Steps are not shorter; what is between them is passed over."""


def walk_of(name: str, facts: Mapping[str, Any]) -> Walk:
    """The steps of a sequence with this truth; rules that it never violates must be silent all the time."""
    return Walk(name, tuple(_steps(name, facts)))


def _steps(name: str, facts: Mapping[str, Any]) -> Iterator[Step]:
    first_s, last_s = facts["instants_s"][0], facts["instants_s"][-1]
    violations = [(each["kind"], each["start_s"], each["end_s"]) for each in facts["violations"]]
    about = tuple(kind for kind in KINDS if kind in {kind for kind, _, _ in violations})
    inner = {border for _, *borders in violations for border in borders if first_s < border < last_s}
    waited_s = 0.0
    for start_s, end_s in pairwise([first_s, *sorted(inner), last_s]):
        seconds = end_s - start_s - (NEAR_S if end_s < last_s else 0.0)
        if seconds < _LEAST_S:
            waited_s += end_s - start_s
            continue
        now = {kind for kind, begins_s, ends_s in violations if begins_s <= start_s and end_s <= ends_s}
        violates = tuple(kind for kind in KINDS if kind in now)
        say = f"{name}, {start_s:.2f} to {end_s:.2f} s: {' and '.join(violates) or 'safe'}"
        yield Step(say, about, violates, waited_s, seconds)
        waited_s = end_s - start_s - seconds


def main() -> None:
    """Print the walk of a sequence."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=Path, help="folder with truth.json")
    folder = parser.parse_args().sequence
    facts = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    print(walk_text(walk_of(folder.resolve().name, facts)), end="")


if __name__ == "__main__":
    main()
