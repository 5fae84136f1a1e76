"""An evaluation as one JSON object: what ``recognition evaluate --json`` prints and the report is made of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import numpy as np

from recognition.evaluation.violations.alarms import Alarms, alarms_of
from recognition.evaluation.violations.evaluate import RowResult, ViolationEvaluation
from recognition.evaluation.violations.scores import (
    Confusion,
    Counted,
    Difference,
    accuracy,
    balanced_accuracy,
    confusions,
    everywhere,
    outside_transitions,
    paired_differences,
    pooled,
)
from recognition.evaluation.violations.truth import KINDS, NEAR_S, SEES_SHARE, SceneTruth, borders
from recognition.rules import RuleSet
from rigcal.geometry import Bools

PAPER_TABLE: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "baseline, one view": (81.7, 78.2, 84.5, 91.4),
        "two views": (84.0, 81.6, 87.2, 91.8),
        "four views": (92.0, 88.4, 91.4, 94.2),
    }
)
"""Accuracies in percent of Safe-Construct, table "Quantitative Comparison", in the order of :data:`KINDS`."""
NOT_COMPARABLE = "other data, not comparable"
COMPARED = (
    ("all_views", "two_views"),
    ("two_views", "baseline"),
    ("two_views", "one_view"),
    ("all_views", "baseline"),
    ("all_views", "one_view"),
    ("all_views", "paper_all_views"),
    ("two_views", "paper_two_views"),
)
"""Rows whose difference is figured: the better one should be the first."""
SEES_NOTE = f"a camera sees somebody of whom it shows {100 * SEES_SHARE:.0f} % of the pixels that there would be"
"""What the document means by a camera that sees those who take part."""
HIDDEN = (("up to 12 %", 0.0, 0.12), ("12 to 24 %", 0.12, 0.24), ("over 24 %", 0.24, 1.01))
"""Groups of instants by how much of the workers is hidden: thirds of the first eight validation sequences."""


def document_of(found: ViolationEvaluation, camera_ids: Sequence[str]) -> dict[str, Any]:
    """All figures, percentages to hundredths; those that nothing defines are None.

    Args:
        found: The evaluation.
        camera_ids: (V,) of the rigs.
    """
    return {
        "unit": "one decision for the whole scene for each instant and violation",
        "violations": list(KINDS),
        "transition_s": NEAR_S,
        "main_row": found.main.row.name,
        "sequences": [
            _sequence(truth, decided[0]) for truth, decided in zip(found.truths, found.main.decided, strict=True)
        ],
        "rules": {"ours": _rules(found.rules.ours), "paper": _rules(found.rules.paper)},
        "rows": [_row(result, found.truths, camera_ids) for result in found.rows],
        "differences": list(_differences(found)),
        "failures": [asdict(failure) for failure in found.failures],
        "paper_table": {
            "note": NOT_COMPARABLE,
            "accuracy_percent": {name: dict(zip(KINDS, row, strict=True)) for name, row in PAPER_TABLE.items()},
        },
    }


def _sequence(truth: SceneTruth, decided: Bools) -> dict[str, Any]:
    t_s = truth.t_s

    def spans(said: Bools) -> list[list[float]]:
        return [[round(float(t_s[a]), 3), round(float(t_s[b - 1] + truth.period_s), 3)] for a, b in borders(said)]

    return {
        "name": truth.name,
        "split": truth.split,
        "light": truth.light,
        "instants": len(truth.t_ns),
        "seconds": round(len(truth.t_ns) * truth.period_s, 3),
        "hidden_percent": _percent(float(truth.hidden.mean())),
        "true_s": {kind: [list(s) for s in own] for kind, own in zip(KINDS, truth.stretches, strict=True)},
        "decided_s": {kind: spans(decided[:, n]) for n, kind in enumerate(KINDS)},
    }


def _rules(rules: RuleSet) -> dict[str, str]:
    return {"name": rules.name, "digest": rules.digest}


def _row(result: RowResult, truths: Sequence[SceneTruth], camera_ids: Sequence[str]) -> dict[str, Any]:
    decided = result.decided
    alarms = [alarms_of(truths, decided, kind) for kind in range(len(KINDS))]
    views = ["+".join(c for c, used in zip(camera_ids, use, strict=True) if used) for use in result.row.uses]
    row = {
        "name": result.row.name,
        "title": result.row.title,
        "views": views,
        "outside_transitions": _figures(truths, decided, outside_transitions),
        "raw": _figures(truths, decided, everywhere),
        "alarms": {kind: _alarms(own) for kind, own in zip(KINDS, alarms, strict=True)},
        "false_alarms_per_hour": _known(sum(own.false_per_hour for own in alarms)),
        "by_light": dict(_by_light(truths, decided)),
        "by_hidden_share": dict(_by_hidden(truths, decided)),
        "recall_by_cameras_that_see_it": dict(_by_cameras(truths, decided, len(camera_ids))),
    }
    if len(views) > 1:
        row["by_views"] = {
            name: _figures(truths, [said[n : n + 1] for said in decided], outside_transitions)
            for n, name in enumerate(views)
        }
    return row


def _figures(truths: Sequence[SceneTruth], decided: Sequence[Bools], counted: Counted) -> dict[str, Any]:
    matrices = pooled(confusions(truths, decided, counted))
    each = {kind: _confusion(matrix) for kind, matrix in zip(KINDS, matrices, strict=True)}
    means = {
        name: _mean([own[name] for own in each.values()])
        for name in ("accuracy_percent", "balanced_accuracy_percent", "f1")
    }
    return {**each, "mean": means}


def _confusion(matrix: Confusion) -> dict[str, Any]:
    return {
        **matrix._asdict(),
        "accuracy_percent": _percent(matrix.accuracy),
        "balanced_accuracy_percent": _percent(matrix.balanced_accuracy),
        "precision_percent": _percent(matrix.precision),
        "recall_percent": _percent(matrix.recall),
        "f1": _known(matrix.f1),
    }


def _alarms(found: Alarms) -> dict[str, Any]:
    return {
        "violations": found.violations,
        "found": len(found.delays_s),
        "recall_percent": _percent(found.recall),
        "median_delay_s": _known(found.median_delay_s),
        "worst_delay_s": _known(found.worst_delay_s),
        "false_alarms": found.false_alarms,
        "safe_s": round(found.safe_s, 3),
        "false_alarms_per_hour": _known(found.false_per_hour),
        "not_excluded_per_hour": _known(found.likely_per_hour),
    }


def _by_light(truths: Sequence[SceneTruth], decided: Sequence[Bools]) -> Iterator[tuple[str, Any]]:
    for light in sorted({truth.light for truth in truths}):
        own = [n for n, truth in enumerate(truths) if truth.light == light]
        yield light, _figures([truths[n] for n in own], [decided[n] for n in own], outside_transitions)


def _by_hidden(truths: Sequence[SceneTruth], decided: Sequence[Bools]) -> Iterator[tuple[str, Any]]:
    for name, low, high in HIDDEN:

        def counted(truth: SceneTruth, low: float = low, high: float = high) -> Bools:
            inside = (truth.hidden >= low) & (truth.hidden < high)
            return inside[:, None] & ~truth.near

        yield name, _figures(truths, decided, counted)


def _by_cameras(truths: Sequence[SceneTruth], decided: Sequence[Bools], cameras: int) -> Iterator[tuple[str, Any]]:
    """Recall by how many cameras see those who take part, of whom they show :data:`SEES_SHARE`."""
    for number in range(cameras + 1):

        def counted(truth: SceneTruth, number: int = number) -> Bools:
            return np.asarray((truth.seen_by == number) & ~truth.near)

        matrices = pooled(confusions(truths, decided, counted))
        yield str(number), {kind: _recall(matrix) for kind, matrix in zip(KINDS, matrices, strict=True)}


def _recall(matrix: Confusion) -> dict[str, Any]:
    instants = matrix.true_positive + matrix.false_negative
    return {"instants": instants, "found": matrix.true_positive, "recall_percent": _percent(matrix.recall)}


def _differences(found: ViolationEvaluation) -> Iterator[dict[str, Any]]:
    for first, second in COMPARED:
        better, than = found.row(first), found.row(second)
        if better is None or than is None:
            continue
        own, other = (confusions(found.truths, row.decided, outside_transitions) for row in (better, than))
        yield {
            "row": first,
            "than": second,
            "sequences": len(found.truths),
            "balanced_accuracy_points": _named(paired_differences(own, other, balanced_accuracy)),
            "accuracy_points": _named(paired_differences(own, other, accuracy)),
        }


def _named(differences: Sequence[Difference]) -> dict[str, Any]:
    names = ("mean", *KINDS)
    return {
        name: {field: _percent(value) for field, value in each._asdict().items()}
        for name, each in zip(names, differences, strict=True)
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return round(float(np.mean(known)), 4) if known else None


def _known(value: float) -> float | None:
    """What JSON can hold."""
    return round(value, 4) if math.isfinite(value) else None


def _percent(share: float) -> float | None:
    return round(100 * share, 2) if math.isfinite(share) else None
