"""The rig file after the cameras that moved were placed again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rigcal.amend import amended
from rigcal.drift.replaced import replace_cameras
from rigcal.drift.rewrite import evidence_after, rewritten
from rigcal.drift.verdict import Drift, GroupDrift
from rigcal.errors import DriftError
from rigcal.evidence import Evidence
from rigcal.rigdocument import RigDocument


@dataclass(frozen=True, slots=True, eq=False)
class Resolved:
    """A rig file with the moved cameras placed again."""

    document: RigDocument
    evidence: Evidence | None
    """The sidecar, where there was one."""
    camera_ids: tuple[str, ...]
    """Cameras that were placed again."""


def resolve_drift(
    document: RigDocument, drift: Drift, evidence: Evidence | None, *, named: Sequence[str], utc: str
) -> Resolved:
    """Place the moved cameras again, all others held.

    Args:
        document: The rig file that was compared.
        drift: What :func:`rigcal.drift.find_drift` says of it; not all cameras stayed.
        evidence: The sidecar of the rig file, where there is one.
        named: Cameras that the user knows to have moved, where the views cannot tell.
        utc: Now, for the history.

    Raises:
        DriftError: where a lens changed, or nothing tells which camera moved.
    """
    if changed := drift.with_status("lens changed"):
        raise DriftError(
            f"{', '.join(changed)} cannot be placed again: the lens changed",
            where=f"camera {', '.join(changed)}",
            expected="the lens that was calibrated",
            got="another focal length or centre",
            do_next="lock zoom and focus, and calibrate the site again with rigcal calibrate",
        )
    work = Resolved(document, evidence, ())
    for group in drift.groups:
        stayed = _stayed(group, named)
        moved = [camera_id for camera_id in group.measured.poses.ids if camera_id not in stayed]
        if not moved:
            continue
        placed = replace_cameras(work.document, group.measured, stayed, moved)
        work = Resolved(
            work.document.model_copy(update=rewritten(work.document, placed)),
            evidence_after(work.evidence, placed) if work.evidence else None,
            (*work.camera_ids, *moved),
        )
    return replace(work, document=amended(work.document, {}, command="drift", utc=utc))


def _stayed(group: GroupDrift, named: Sequence[str]) -> tuple[str, ...]:
    """The cameras of a group that stayed, by the views or, where they cannot tell, by what the user knows."""
    sets, ids = (group.stayed, *group.alternatives), group.measured.poses.ids
    if len(sets) == 1:
        return group.stayed
    for held in sets:
        if {c for c in ids if c not in held} == set(named) & set(ids):
            return held
    choices = " or ".join(" and ".join(c for c in ids if c not in held) for held in sets)
    raise DriftError(
        f"the views cannot tell which camera moved: {choices}",
        where=f"cameras {', '.join(ids)}",
        expected="one set of cameras that still agree, larger than any other",
        got=f"{len(sets)} sets that agree as well" + (f"; {', '.join(named)} named" if named else ""),
        do_next=f"look which camera was touched and name it, as in --moved {ids[-1]}; or show the board to three or "
        "more cameras together",
    )
