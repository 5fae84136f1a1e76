"""All rows over all sequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from recognition.errors import DatasetError
from recognition.evaluation.violations.alarms import Failure, failures_of
from recognition.evaluation.violations.recorded import ObservedSequence
from recognition.evaluation.violations.rows import Row, Rules, Use, decisions, rows_of
from recognition.evaluation.violations.truth import SceneTruth
from rigcal.geometry import Bools


@dataclass(frozen=True, slots=True, eq=False)
class RowResult:
    """What a row decided."""

    row: Row
    decided: tuple[Bools, ...]
    """Of each sequence: (U, F, K), for each choice of cameras."""


@dataclass(frozen=True, slots=True, eq=False)
class ViolationEvaluation:
    """What every row decided on the same sequences."""

    truths: tuple[SceneTruth, ...]
    rules: Rules
    rows: tuple[RowResult, ...]

    def row(self, name: str) -> RowResult | None:
        """The row of this name; None where these cameras have none."""
        return next((result for result in self.rows if result.row.name == name), None)

    @property
    def main(self) -> RowResult:
        """Ours with all cameras; of one camera ours with that."""
        return self.row("all_views") or self.rows[1]

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Where :attr:`main` is wrong outside of transitions, by sequence, violation and time."""
        return tuple(
            failure
            for truth, decided in zip(self.truths, self.main.decided, strict=True)
            for failure in failures_of(truth, decided[0])
        )


def evaluate_violations(sequences: Iterable[ObservedSequence], rules: Rules, use: Use) -> ViolationEvaluation:
    """Decide every instant and violation by every row.

    Args:
        sequences: What the networks saw, of rigs with the same cameras.
        rules: Ours and the paper's.
        use: (V,) which cameras.

    Raises:
        DatasetError: where there is no sequence, or one has another number of cameras.
        RigRefusedError: where a rule needs the floor and a rig has no world frame.
    """
    rows = rows_of(use)
    truths: list[SceneTruth] = []
    decided: list[list[Bools]] = [[] for _ in rows]
    for sequence in sequences:
        if len(sequence.rig.cameras) != len(use):
            raise DatasetError(
                "the sequences have different cameras",
                where=sequence.truth.name,
                expected=f"{len(use)} cameras, as the first has",
                got=len(sequence.rig.cameras),
                do_next="evaluate them apart",
            )
        truths.append(sequence.truth)
        for own, row in zip(decided, rows, strict=True):
            own.append(decisions(row, sequence, rules))
    if not truths:
        raise DatasetError(
            "there is nothing to evaluate", expected="a sequence", got="none", do_next="name a folder that holds some"
        )
    results = tuple(RowResult(row, tuple(own)) for row, own in zip(rows, decided, strict=True))
    return ViolationEvaluation(tuple(truths), rules, results)
