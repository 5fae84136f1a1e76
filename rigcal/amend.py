"""Rewriting a rig file: its gates are run again, and its history says which command did it and from which file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rigcal.gates import AT_LEAST
from rigcal.rigdocument import GateEntry, HistoryEntry, RigDocument


def amended(document: RigDocument, changes: dict[str, Any], *, command: str, utc: str) -> RigDocument:
    """A rig file's content after a command changed some of it.

    Args:
        document: As it was read, with its digest.
        changes: New values of top-level entries, ``gates`` among them where a gate's figure changed.
        command: For the history.
        utc: Now, ISO 8601.

    Returns:
        The content with every gate judged again, the verdict that follows (an imported rig stays imported), and one
        more entry of history. Its digests are set when it is written.
    """
    content = {name: getattr(document, name) for name in RigDocument.model_fields} | changes
    gates = judged_again(content["gates"])
    verdict = "PASS" if all(gate.passed for gate in gates) else "RECAPTURE"
    return RigDocument.model_validate(
        content
        | {
            "gates": gates,
            "verdict": document.verdict if document.verdict == "IMPORTED" else verdict,
            "history": (
                *document.history,
                HistoryEntry(command=command, utc=utc, parent_digest=document.digest or None),
            ),
            "geometry_digest": "",
            "digest": "",
        }
    )


def judged_again(gates: Sequence[GateEntry]) -> tuple[GateEntry, ...]:
    """Each gate's figure held against its limit; an advice goes with a failure."""
    return tuple(
        gate.model_copy(update={"passed": passed, "advice": None if passed else gate.advice})
        for gate in gates
        for passed in [_passes(gate)]
    )


def _passes(gate: GateEntry) -> bool:
    if gate.value is None:
        return False
    return gate.value >= gate.limit if gate.name in AT_LEAST else gate.value <= gate.limit
