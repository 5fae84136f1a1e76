"""Evidence at the end of a run or a replay, and by its own command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from recognition.cli._show import progress

if TYPE_CHECKING:
    from recognition.events import Event
    from recognition.evidence import Exhibit
    from recognition.rules import RuleSet
    from recognition.sources.recording import RecordedRun
    from recognition.viewing import Codec


def evidence_folder(recording: Path) -> Path:
    """``NAME.evidence`` beside the recording, which goes with it when that is deleted."""
    from recognition.alarms import beside, recording_named
    from recognition.retention import EVIDENCE_SUFFIX

    return beside(recording_named(recording), EVIDENCE_SUFFIX)


def require_encoder(codec: Codec = "h264") -> None:
    """Refuse at the start what would be found out at the end: RecognitionError where FFmpeg cannot encode video."""
    from recognition.viewing import encoder_of

    encoder_of(codec)


def write_evidence(
    recording: Path,
    events: Sequence[Event],
    folder: Path | None = None,
    *,
    rules: RuleSet | None = None,
    show_faces: bool = False,
    codec: Codec = "h264",
    quiet: bool,
) -> tuple[Exhibit, ...]:
    """Write the evidence of events of a recording to a folder, without one to ``NAME.evidence``.

    Without ``rules`` those of the recording count.
    """
    from recognition.evidence import EvidenceOptions, write_exhibits
    from recognition.sources.recording import open_recording

    target, opened = folder or evidence_folder(recording), open_recording(recording)
    options = EvidenceOptions(show_faces, codec)
    with progress(len(events), quiet=quiet, label="evidence") as bar:
        return write_exhibits(opened, events, target, options, rules=rules or _own_rules(opened), progress=bar)


def _own_rules(opened: RecordedRun) -> RuleSet | None:
    """The rules of the run; None where there are none, or this version does not understand them."""
    from recognition.errors import RulesError
    from recognition.judging import recorded_rulebook

    try:
        own = recorded_rulebook(opened)
    except RulesError:
        return None
    return None if own is None else own.rules
