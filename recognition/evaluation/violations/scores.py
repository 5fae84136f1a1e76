"""Figures of decisions: confusion matrices and what follows from them, and paired differences between rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from recognition.evaluation.violations.truth import KINDS, SceneTruth
from rigcal.geometry import Bools, Floats, Ints

Counted = Callable[[SceneTruth], Bools]
"""Which decisions (F, K) of a sequence count."""
DRAWS, SEED = 10_000, 0
"""Of the bootstrap."""


class Confusion(NamedTuple):
    """A confusion matrix; shares that nothing defines are NaN."""

    true_positive: int
    false_positive: int
    false_negative: int
    true_negative: int

    @property
    def decisions(self) -> int:
        """How many."""
        return sum(self)

    @property
    def accuracy(self) -> float:
        """Share of the decisions that are right, as in the paper's table."""
        return float(accuracy(np.array(self)))

    @property
    def balanced_accuracy(self) -> float:
        """Mean of the shares that are right of violations and of safe instants."""
        return float(balanced_accuracy(np.array(self)))

    @property
    def precision(self) -> float:
        """Share of what was said to be a violation that is one."""
        return _share(self.true_positive, self.true_positive + self.false_positive)

    @property
    def recall(self) -> float:
        """Share of the violations that was found."""
        return _share(self.true_positive, self.true_positive + self.false_negative)

    @property
    def f1(self) -> float:
        """Harmonic mean of both."""
        twice = 2 * self.true_positive
        return _share(twice, twice + self.false_positive + self.false_negative)


def accuracy(counts: Ints | Floats) -> Floats:
    """(...) of confusion matrices (..., 4)."""
    tp, fp, fn, tn = np.moveaxis(np.asarray(counts, dtype=np.float64), -1, 0)
    return _shares(tp + tn, tp + fp + fn + tn)


def balanced_accuracy(counts: Ints | Floats) -> Floats:
    """(...) of confusion matrices (..., 4); NaN where there is no violation, or nothing else."""
    tp, fp, fn, tn = np.moveaxis(np.asarray(counts, dtype=np.float64), -1, 0)
    return (_shares(tp, tp + fn) + _shares(tn, tn + fp)) / 2


def outside_transitions(truth: SceneTruth) -> Bools:
    """Instants that are not near to a start or an end of their violation."""
    return ~truth.near


def everywhere(truth: SceneTruth) -> Bools:
    """All instants."""
    return np.ones_like(truth.active)


def confusions(truths: Sequence[SceneTruth], decided: Sequence[Bools], counted: Counted) -> Ints:
    """(S, K, 4) confusion matrices of S sequences, over all choices of cameras.

    Args:
        truths: Of the sequences.
        decided: (U, F, K) of each sequence.
        counted: Which decisions count.
    """
    result = np.zeros((len(truths), len(KINDS), 4), dtype=np.int64)
    for row, truth, said in zip(result, truths, decided, strict=True):
        active, counts = truth.active, counted(truth)
        for place, cell in enumerate((active & said, ~active & said, active & ~said, ~active & ~said)):
            row[:, place] = (cell & counts).sum(axis=(0, 1))
    return result


def pooled(counts: Ints) -> tuple[Confusion, ...]:
    """(K,) matrices of all sequences (S, K, 4) together."""
    return tuple(Confusion(*row) for row in counts.sum(axis=0).tolist())


class Difference(NamedTuple):
    """By how much one row is better than another, and its 95 % interval; NaN where nothing defines them."""

    value: float
    low: float
    high: float


def paired_differences(
    better: Ints, than: Ints, figure: Callable[[Ints | Floats], Floats], *, draws: int = DRAWS, seed: int = SEED
) -> tuple[Difference, ...]:
    """(1 + K,) differences of a figure: its mean over the violations, then each violation's.

    The interval is that of the percentile bootstrap over sequences (Efron, 1979): both rows are figured on the same
    draw of sequences, so that what makes a sequence hard for both does not count. Draws in which a figure is not
    defined, since no sequence of them has the violation, take no part in it. One sequence has no interval.

    Args:
        better: (S, K, 4) confusion matrices of a row.
        than: (S, K, 4) of the row that it is compared with, on the same sequences.
        figure: Of matrices (..., 4).
        draws: How many times sequences are drawn.
        seed: Of the draws.
    """
    sequences = len(better)
    often = np.random.default_rng(seed).multinomial(sequences, [1 / sequences] * sequences, size=draws)
    weights = np.concatenate([np.ones((1, sequences)), often])
    first, second = (np.tensordot(weights, counts, axes=1) for counts in (better, than))
    each = figure(first) - figure(second)
    drawn = np.concatenate([_mean_known(each)[:, None], each], axis=1)
    return tuple(_difference(column, has_interval=sequences > 1) for column in drawn.T)


def _difference(column: Floats, *, has_interval: bool) -> Difference:
    known = column[1:][np.isfinite(column[1:])] if has_interval else column[:0]
    low, high = np.percentile(known, [2.5, 97.5]).tolist() if len(known) else (np.nan, np.nan)
    return Difference(float(column[0]), low, high)


def _mean_known(values: Floats) -> Floats:
    """(N,) means of rows (N, K) over what is known of them."""
    known = np.isfinite(values)
    return _shares(np.where(known, values, 0.0).sum(axis=1), known.sum(axis=1).astype(np.float64))


def _shares(part: Floats, whole: Floats) -> Floats:
    return np.where(whole > 0, part / np.maximum(whole, 1e-300), np.nan)


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
