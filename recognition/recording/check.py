"""Whether a recording is whole and fit for use: what ``recognition check`` says of a file, or of a run's segments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from mmap import mmap
from pathlib import Path
from types import MappingProxyType

from recognition.recording.container import (
    MAGIC,
    PART_SUFFIX,
    is_being_written,
    mapped,
    not_mcap,
    recover_command,
)
from recognition.recording.content import ContentVisitor, time_findings
from recognition.recording.findings import Finding, error, warning
from recognition.recording.naming import recording_files, unfinished_notes
from recognition.recording.origin import Edges, facts, rig_findings, rules_findings, sequence_findings
from recognition.recording.structure import structure_findings
from recognition.recording.survey import Survey, survey


@dataclass(frozen=True, slots=True)
class RecordingCheck:
    """What a recording holds, and what is wrong with it."""

    path: Path
    findings: tuple[Finding, ...]
    messages: Mapping[str, int]
    """Messages per topic."""
    duration_s: float
    """From the first log time to the last."""
    bytes: int
    """Size of the file."""
    facts: tuple[str, ...]
    """What it says of its rig, its clocks and its place in a run."""

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return is_ok(self.findings)


@dataclass(frozen=True, slots=True)
class SequenceCheck:
    """What the segments of a run hold, and what is wrong with them."""

    segments: tuple[RecordingCheck, ...]
    findings: tuple[Finding, ...]
    """On how the segments follow each other."""

    @property
    def ok(self) -> bool:
        """Whether there is no error, in any segment or between them."""
        return is_ok(self.findings) and all(segment.ok for segment in self.segments)


def is_ok(findings: Iterable[Finding]) -> bool:
    """Whether there is no error among the findings."""
    return not any(finding.severity == "error" for finding in findings)


def check_recording(path: Path) -> RecordingCheck:
    """Read every byte of a file and hold it against its checksums, its index and its rig.

    Raises:
        RecordingError: where there is no such file, or it is no MCAP file.
    """
    return _checked(path)[0]


def check_run(path: Path) -> SequenceCheck:
    """Check a recording that may have segments, and whether all of it is finished.

    Args:
        path: A file, the name ``NAME.mcap`` of segments, or a folder with one recording.

    Raises:
        RecordingError: as for :func:`check_recording`, or where there is no recording.
    """
    found = check_sequence(recording_files(path))
    return replace(found, findings=(*found.findings, *(error(note) for note in unfinished_notes(path))))


def check_sequence(files: Sequence[Path]) -> SequenceCheck:
    """Check the segments of a run, in order, and how they follow each other; or a single file.

    Raises:
        RecordingError: as for :func:`check_recording`.
    """
    checked = [_checked(file) for file in files]
    between = sequence_findings([edges for _, edges in checked]) if len(checked) > 1 else ()
    return SequenceCheck(tuple(check for check, _ in checked), tuple(between))


def _checked(path: Path) -> tuple[RecordingCheck, Edges]:
    with mapped(path) as data:
        visitor = ContentVisitor()
        found = survey(data, visitor)
        require_mcap(path, data, found)
        structure = tuple(structure_findings(data, found))
        origin = [*rig_findings(found, visitor.frames), *rules_findings(found)]
        findings = [*structure, *origin, *visitor.findings(), *time_findings(found)]
        size = len(data)
    if structure or path.suffix == PART_SUFFIX:
        findings.insert(0, _unfinished(path))
    if not any(channel.log_ns for channel in found.channels.values()):
        findings.append(warning("the recording holds no messages"))
    times = [t_ns for channel in found.channels.values() for t_ns in channel.log_ns]
    duration_s = (max(times) - min(times)) / 1e9 if times else 0.0
    check = RecordingCheck(path, tuple(findings), message_counts(found), duration_s, size, tuple(facts(found)))
    return check, Edges.of(found)


def _unfinished(path: Path) -> Finding:
    if is_being_written(path):
        return error("a run is still recording it: check it when that has ended")
    return error(f"unfinished or damaged: run `{recover_command(path)}`")


def require_mcap(path: Path, data: mmap, found: Survey) -> None:
    """Raise RecordingError where a file has neither the magic nor anything that can be read."""
    if data[: len(MAGIC)] != MAGIC and found.header is None and not found.index:
        raise not_mcap(path, f"{len(data)} bytes that begin with {data[: len(MAGIC)]!r}")


def message_counts(found: Survey) -> Mapping[str, int]:
    """Messages per topic."""
    counts: dict[str, int] = {}
    for channel in found.channels.values():
        counts[channel.topic] = counts.get(channel.topic, 0) + len(channel.log_ns)
    return MappingProxyType(counts)
