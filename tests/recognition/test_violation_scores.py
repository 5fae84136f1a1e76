"""Figures of decisions by hand, and paired intervals beside a bootstrap that is written out."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from violation_scenes import decided, truth

from recognition.evaluation.violations import (
    KINDS,
    Confusion,
    accuracy,
    alarms_of,
    balanced_accuracy,
    confusions,
    everywhere,
    failures_of,
    outside_transitions,
    paired_differences,
    pooled,
)

NO_HAT = KINDS.index("no_hat")


def test_figures_of_a_matrix_are_those_of_the_textbook():
    found = Confusion(true_positive=8, false_positive=2, false_negative=4, true_negative=86)
    assert found.decisions == 100
    assert found.accuracy == pytest.approx(0.94)
    assert found.balanced_accuracy == pytest.approx((8 / 12 + 86 / 88) / 2)
    assert (found.precision, found.recall) == (pytest.approx(0.8), pytest.approx(8 / 12))
    assert found.f1 == pytest.approx(2 * 0.8 * (8 / 12) / (0.8 + 8 / 12))


def test_what_nothing_defines_is_not_a_number():
    quiet = Confusion(0, 0, 0, 10)
    assert quiet.accuracy == 1.0
    assert all(math.isnan(value) for value in (quiet.balanced_accuracy, quiet.precision, quiet.recall, quiet.f1))
    assert math.isnan(Confusion(0, 0, 0, 0).accuracy)


def test_decisions_are_counted_apart_from_transitions_and_over_all_choices_of_cameras():
    known = truth({"no_hat": [(2.0, 4.0)]})
    late = decided(known, {"no_hat": [(2.4, 4.4)]})
    silent = np.zeros_like(late)
    outside = confusions([known], [np.concatenate([late, silent])], outside_transitions)
    raw = confusions([known], [np.concatenate([late, silent])], everywhere)
    counted = int((~known.near[:, NO_HAT]).sum())
    inside = 5  # 2.6 to 3.4 s
    assert pooled(outside)[NO_HAT] == (inside, 0, inside, 2 * (counted - inside))
    assert pooled(raw)[NO_HAT] == (8, 2, 2 + 10, 18 + 20)
    assert outside.shape == (1, 4, 4)


def test_paired_intervals_are_those_of_drawing_sequences_one_by_one():
    rng = np.random.default_rng(5)
    better, than = (rng.integers(1, 40, size=(7, len(KINDS), 4)) for _ in range(2))
    found = paired_differences(better, than, balanced_accuracy, draws=2000, seed=1)
    drawn = []
    other = np.random.default_rng(9)
    for _ in range(2000):
        chosen = other.integers(0, 7, size=7)
        first, second = (np.array([Confusion(*row).balanced_accuracy for row in counts[chosen].sum(axis=0)])
                         for counts in (better, than))  # fmt: skip
        drawn.append([(first - second).mean(), *(first - second)])
    low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
    assert [each.value for each in found[1:]] == pytest.approx(
        [Confusion(*a).balanced_accuracy - Confusion(*b).balanced_accuracy
         for a, b in zip(better.sum(axis=0), than.sum(axis=0), strict=True)]
    )  # fmt: skip
    assert [each.low for each in found] == pytest.approx(low, abs=0.02)
    assert [each.high for each in found] == pytest.approx(high, abs=0.02)


def test_what_makes_a_sequence_hard_for_both_does_not_widen_the_interval():
    hard = np.array([[[10, 0, 10 - n, n]] * len(KINDS) for n in (1, 3, 5, 7, 9)])
    better = hard + [0, 0, 0, 5]
    for each in paired_differences(better, better, accuracy, draws=200):
        assert (each.value, each.low, each.high) == (0.0, 0.0, 0.0)


def test_an_undefined_figure_has_no_difference_and_one_sequence_no_interval():
    without = np.array([[[0, 1, 0, 9], [3, 1, 2, 9], [3, 1, 2, 9], [3, 1, 2, 9]]] * 3)
    found = paired_differences(without, without, balanced_accuracy, draws=100)
    assert math.isnan(found[1 + NO_HAT].value)
    assert math.isnan(found[1 + NO_HAT].low)
    assert found[0].value == 0.0
    alone = paired_differences(without[:1], without[:1], accuracy, draws=100)
    assert alone[0].value == 0.0
    assert math.isnan(alone[0].low)


def test_violations_are_found_with_a_delay_and_alarms_are_false_where_nothing_is_near():
    known = truth({"no_hat": [(1.0, 2.0), (4.0, 5.0)]})
    said = decided(known, {"no_hat": [(1.4, 2.2), (3.0, 3.2)], "ladder": [(1.0, 1.2), (3.0, 4.0)]})
    found = alarms_of([known], [said], NO_HAT)
    assert (found.violations, found.delays_s, found.recall) == (2, (pytest.approx(0.4),), 0.5)
    assert found.false_alarms == 1  # at 3.0 s; until 2.2 s is the end of the first
    assert found.safe_s == pytest.approx(4.0)
    assert found.false_per_hour == pytest.approx(900.0)
    assert math.isnan(found.likely_per_hour)
    assert alarms_of([known], [said], KINDS.index("ladder")).false_alarms == 2
    none = alarms_of([known], [np.zeros_like(said)], NO_HAT)
    assert math.isnan(none.median_delay_s)
    assert none.likely_per_hour == pytest.approx(3600 * -math.log(0.05) / 4.0)


def test_failures_say_when_and_what():
    known = truth({"no_hat": [(2.0, 4.0)], "ladder": [(1.0, 3.0)], "window": [(2.0, 4.0)]}, frames=40)
    said = decided(
        known, {"no_hat": [(2.0, 3.0), (6.0, 6.4)], "window": [(2.0, 5.0)], "platform": [(1.0, 1.2)]}
    )[0]  # fmt: skip
    found = [(f.violation, f.kind, f.start_s, f.end_s) for f in failures_of(known, said)]
    assert found == [
        ("no_hat", "missed in part", 3.0, 3.4),
        ("no_hat", "false alarm", 6.0, 6.2),
        ("ladder", "missed", 1.6, 2.4),
        ("window", "too long", 4.6, 4.8),
        ("platform", "false alarm", 1.0, 1.0),
    ]
    assert failures_of(known, known.active) == ()
