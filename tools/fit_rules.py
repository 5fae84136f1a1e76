"""Fits the thresholds of the paper's literal rules, equations 6 to 9, on the validation half.

For each violation the threshold of its equation runs over a grid, in shares of a worker's height, and the paper's
method decides every instant of every sequence with all cameras. The threshold with the best balanced accuracy outside
of transitions is taken; of several the one in the middle of the longest stretch of them, farthest from a change.

    python -m tools.fit_rules out/sicsg/sequences --rules rig_configs/paper.rules.toml --write

The paper publishes only that the first is "one-tenth of the worker height", of a neck that COCO-17 does not have.
"""

from __future__ import annotations

import argparse
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recognition.detectors import load_bundled
from recognition.evaluation.violations import (
    KINDS,
    ObservedSequence,
    balanced_accuracy,
    confusions,
    find_sequences,
    held,
    observe,
    outside_transitions,
    said,
    scenes,
)
from recognition.observations import Scene
from recognition.rules import parse_rules
from rigcal.geometry import Floats

SPLIT = "validation"
GRID = tuple(round(0.02 * step, 2) for step in range(2, 101))
"""Thresholds that are tried, in heights: 0.04 to 2.00."""
_LIMIT = re.compile(r"(<\s*)(\d+(?:\.\d+)?)(\s*H\b)")


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A sequence as the paper's method places it, which no threshold changes."""

    sequence: ObservedSequence
    scenes: tuple[Scene, ...]

    @classmethod
    def of(cls, sequence: ObservedSequence) -> Placed:
        """With all cameras."""
        use = (True,) * len(sequence.rig.cameras)
        return cls(sequence, tuple(scenes(iter(sequence.instants), sequence.rig, use, "paper")))


def taus_of(text: str) -> dict[str, float]:
    """The threshold of each violation in a rule file, in heights.

    Raises:
        SystemExit: where a violation does not have exactly one.
    """
    found = {}
    for kind, expressions in _expressions(text).items():
        limits = [float(match[2]) for expression in expressions for match in _LIMIT.finditer(expression)]
        if len(limits) != 1:
            raise SystemExit(f"rule {kind}: expected one threshold `< number H`, as in the paper, got {limits}")
        found[kind] = limits[0]
    return found


def with_taus(text: str, taus: Mapping[str, float]) -> str:
    """The rule file with other thresholds, all else as it was."""
    for kind, expressions in _expressions(text).items():
        for expression in expressions:
            changed = _LIMIT.sub(rf"\g<1>{taus[kind]:.2f}\g<3>", expression)
            text = text.replace(f'"{expression}"', f'"{changed}"')
    return text


def _expressions(text: str) -> dict[str, list[str]]:
    """Of each violation, its condition and the definitions that it uses."""
    content = tomllib.loads(text)
    when = {rule["name"]: rule["when"] for rule in content["rules"]}
    found = {}
    for kind in KINDS:
        names = {head: head.partition("(")[0] for head in content.get("definitions", {})}
        used = [content["definitions"][head] for head, name in names.items() if f"{name}(" in when[kind]]
        found[kind] = [when[kind], *used]
    return found


def curves(text: str, placed: Sequence[Placed], grid: Sequence[float]) -> Floats:
    """(T, K) balanced accuracy of each violation with each threshold."""
    truths = [each.sequence.truth for each in placed]
    result = []
    for tau in grid:
        rules = parse_rules(with_taus(text, dict.fromkeys(KINDS, tau)), "a fit")
        decided = [
            held(each.sequence.truth, said(iter(each.scenes), rules, each.sequence.rig))[None] for each in placed
        ]
        result.append(balanced_accuracy(confusions(truths, decided, outside_transitions).sum(axis=0)))
    return np.array(result)


def best(grid: Sequence[float], curve: Floats) -> float:
    """The threshold in the middle of the longest stretch of the best ones.

    Raises:
        SystemExit: where nothing defines the curve, since the sequences never hold the violation.
    """
    if not np.isfinite(curve).any():
        raise SystemExit("the sequences do not hold every violation, and instants without it: give more of them")
    top = curve >= np.nanmax(curve) - 1e-9
    edges = np.flatnonzero(np.diff(np.concatenate([[False], top, [False]]).astype(int))).reshape(-1, 2)
    first, end = max(edges.tolist(), key=lambda edge: edge[1] - edge[0])
    return grid[(first + end - 1) // 2]


def main() -> None:
    """Fit, tell, and write where that was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="folder with validation/NAME, or of sequences")
    parser.add_argument("--rules", type=Path, default=Path("rig_configs/paper.rules.toml"))
    parser.add_argument("--cache", type=Path, default=Path(".cache/evaluation"))
    parser.add_argument("--write", action="store_true", help="put the thresholds into the rule file")
    asked = parser.parse_args()
    text, detector = asked.rules.read_text(encoding="utf-8"), load_bundled()
    before = taus_of(text)
    folders = find_sequences(asked.dataset, SPLIT)
    placed = [Placed.of(observe(folder, SPLIT, detector, asked.cache)) for folder in folders]
    found = curves(text, placed, GRID)
    taus = {kind: best(GRID, found[:, number]) for number, kind in enumerate(KINDS)}
    print(f"{len(placed)} sequences of {SPLIT}: {', '.join(each.sequence.truth.name for each in placed)}")
    for number, kind in enumerate(KINDS):
        reached = 100 * float(np.nanmax(found[:, number]))
        print(f"{kind:<10} {before[kind]:.2f} H -> {taus[kind]:.2f} H   balanced accuracy {reached:.1f} %")
    if asked.write:
        asked.rules.write_text(with_taus(text, taus), encoding="utf-8")
        print(f"written to {asked.rules}; commit it before the sealed half is run")


if __name__ == "__main__":
    main()
