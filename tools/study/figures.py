"""Lines of the study to curves, and to the largest error that costs nothing to speak of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recognition.evaluation.violations import KINDS, balanced_accuracy, paired_differences
from rigcal.geometry import Floats, Ints
from tools.study.trial import Tally, Trial

Line = dict[str, Any]
METHOD = (
    *(f"recognition/{name}" for name in ("association", "placing.py", "rules", "tracking", "triangulation")),
    *(f"recognition/{name}.py" for name in ("observed", "optics")),
    *(f"tools/study/{name}.py" for name in ("detector", "errors", "exact", "faults", "measured", "trial", "world")),
)
"""Sources that decide; lines of another state of them are another study's."""
COST = 0.02
"""What an error may cost of the mean balanced accuracy, for it to count as nothing to speak of."""


def method_digest() -> str:
    """Of the sources that decide."""
    root, total = Path(__file__).parents[2], hashlib.sha256()
    for part in [root / name for name in METHOD]:
        for path in sorted(part.rglob("*.py")) if part.is_dir() else [part]:
            total.update(path.read_bytes())
    return total.hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Study:
    """What all lines of a study have in common."""

    rules: str
    """Digest of the rule file."""
    method: str
    """Of :func:`method_digest`."""


def line_of(study: Study, trial: Trial, sequence: str, found: Tally, about: Mapping[str, float]) -> Line:
    """One trial on one sequence, as a line of JSON; ``about`` is what else was measured of it."""
    figures = {name: np.asarray(value).tolist() for name, value in asdict(found).items()}
    return {**asdict(study), **asdict(trial), "sequence": sequence, **figures, "about": dict(about)}


def key_of(line: Line) -> tuple[Any, ...]:
    """What a line is of, whatever it says."""
    return tuple(line[name] for name in ("rules", "method", "axis", "level", "detector", "seed", "sequence"))


def key_to_be(study: Study, trial: Trial, sequence: str) -> tuple[Any, ...]:
    """The key of a line that is not written yet."""
    return key_of({**asdict(study), **asdict(trial), "sequence": sequence})


def read_lines(path: Path) -> list[Line]:
    """Lines of a file; none where there is no file. A last line that was cut off is passed over."""
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]


def newest(lines: Sequence[Line]) -> list[Line]:
    """Those of the same rules and method as the last one."""
    return [line for line in lines if all(line[name] == lines[-1][name] for name in ("rules", "method"))]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Balanced accuracy against one kind of error, with one detector."""

    axis: str
    detector: str
    levels: tuple[float, ...]
    accuracy: Floats
    """(L, K) NaN where nothing defines it."""
    cost: Floats
    """(L, 3) by how much the mean over the violations is below that without error, and its 95 % interval over
    sequences; the interval is NaN where there is one sequence."""
    unknown: Floats
    """(L, K) share of the decisions that were unknown, and so no violation."""
    about: Mapping[str, Floats]
    """(L,) root mean squares of what else was measured: ``scene_mm``, how far the scene's centre is misplaced, or bit
    rates."""
    trials: int
    """At each level: seeds and sequences."""
    decisions: Ints
    """(K, 2) behind each point: of violations, and of none."""

    @property
    def mean(self) -> Floats:
        """(L,)"""
        return np.asarray(np.nanmean(self.accuracy, axis=1))

    @property
    def bearable(self) -> tuple[float, float]:
        """The largest level before the first that costs more than :data:`COST`, and that level; inf where none does."""
        costly = np.flatnonzero(self.cost[:, 0] > COST)
        if not len(costly):
            return self.levels[-1], float("inf")
        return self.levels[max(costly[0] - 1, 0)], self.levels[costly[0]]


def curves_of(lines: Sequence[Line]) -> Iterator[Curve]:
    """Curves of all kinds of error and detectors; levels that were not tried on what the first was are left out."""
    kinds = dict.fromkeys((line["axis"], line["detector"]) for line in lines)
    for axis, detector in kinds:
        own = [line for line in lines if (line["axis"], line["detector"]) == (axis, detector)]
        by_level: dict[float, dict[tuple[int, str], Line]] = {}
        for line in own:
            by_level.setdefault(line["level"], {})[line["seed"], line["sequence"]] = line
        levels = list(by_level)
        common = set.intersection(*(set(tried) for tried in by_level.values()))
        if common:
            yield _curve(axis, detector, levels, [{key: by_level[level][key] for key in common} for level in levels])


def _curve(axis: str, detector: str, levels: Sequence[float], tried: Sequence[dict[tuple[int, str], Line]]) -> Curve:
    counts = [_by_sequence(own) for own in tried]
    cost = [paired_differences(counts[0], each, balanced_accuracy)[0] for each in counts]
    pooled = np.array([each.sum(axis=0) for each in counts])
    unknown = np.array([np.sum([line["unknown"] for line in own.values()], axis=0) for own in tried])
    names = dict.fromkeys(name for own in tried for line in own.values() for name in line["about"])
    return Curve(
        axis,
        detector,
        tuple(levels),
        balanced_accuracy(pooled),
        np.array(cost),
        unknown / np.maximum(pooled.sum(axis=2), 1),
        {name: np.array([_root_mean_square(name, own) for own in tried]) for name in names},
        len(tried[0]),
        np.stack([pooled[0][:, [0, 2]].sum(axis=1), pooled[0][:, [1, 3]].sum(axis=1)], axis=1),
    )


def _root_mean_square(name: str, tried: Mapping[tuple[int, str], Line]) -> float:
    known = [line["about"][name] for line in tried.values() if name in line["about"]]
    return float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")


def _by_sequence(tried: dict[tuple[int, str], Line]) -> Ints:
    """(S, K, 4) matrices of each sequence, over its seeds."""
    names = sorted({sequence for _, sequence in tried})
    return np.array(
        [np.sum([line["counts"] for (_, own), line in tried.items() if own == name], axis=0) for name in names],
        dtype=np.int64,
    ).reshape(len(names), len(KINDS), 4)
