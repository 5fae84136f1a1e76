"""Violations on sequences with truth, evaluated as the Safe-Construct paper does it.

The unit is one decision for the whole scene, for each instant and violation, shared by all views. Rows: the single-view
baseline, one view with our temporal filter, all pairs of views, all views, and the paper's method on the same
detections. What happens within half a second of a start or an end is told apart, differences between rows have
intervals, and the half of the sequences that is sealed is judged by committed rules only.
"""

from recognition.evaluation.violations.alarms import Alarms, Failure, alarms_of, failures_of
from recognition.evaluation.violations.clips import write_clips
from recognition.evaluation.violations.document import (
    COMPARED,
    NOT_COMPARABLE,
    PAPER_TABLE,
    SEES_NOTE,
    document_of,
)
from recognition.evaluation.violations.evaluate import RowResult, ViolationEvaluation, evaluate_violations
from recognition.evaluation.violations.flat import flat_scene
from recognition.evaluation.violations.recorded import ObservedSequence, find_sequences, observe
from recognition.evaluation.violations.rows import Row, Rules, decisions, held, rows_of, said, scenes, seen_with
from recognition.evaluation.violations.scores import (
    Confusion,
    Difference,
    accuracy,
    balanced_accuracy,
    confusions,
    everywhere,
    outside_transitions,
    paired_differences,
    pooled,
)
from recognition.evaluation.violations.sealed import LOG, SEALED, Code, require_committed, write_down
from recognition.evaluation.violations.truth import (
    KINDS,
    NEAR_S,
    SceneTruth,
    Stretch,
    Violations,
    read_scene_truth,
    read_violations,
)

__all__ = [
    "COMPARED",
    "KINDS",
    "LOG",
    "NEAR_S",
    "NOT_COMPARABLE",
    "PAPER_TABLE",
    "SEALED",
    "SEES_NOTE",
    "Alarms",
    "Code",
    "Confusion",
    "Difference",
    "Failure",
    "ObservedSequence",
    "Row",
    "RowResult",
    "Rules",
    "SceneTruth",
    "Stretch",
    "ViolationEvaluation",
    "Violations",
    "accuracy",
    "alarms_of",
    "balanced_accuracy",
    "confusions",
    "decisions",
    "document_of",
    "evaluate_violations",
    "everywhere",
    "failures_of",
    "find_sequences",
    "flat_scene",
    "held",
    "observe",
    "outside_transitions",
    "paired_differences",
    "pooled",
    "read_scene_truth",
    "read_violations",
    "require_committed",
    "rows_of",
    "said",
    "scenes",
    "seen_with",
    "write_clips",
    "write_down",
]
