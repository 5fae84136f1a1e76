"""Whether a recording is whole and fit for use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from mmap import mmap
from pathlib import Path
from types import MappingProxyType

from recognition.recording.container import MAGIC, PART_SUFFIX, mapped, not_mcap, recover_command
from recognition.recording.content import ContentVisitor, rig_findings, time_findings
from recognition.recording.findings import Finding, error, warning
from recognition.recording.structure import structure_findings
from recognition.recording.survey import Survey, survey


@dataclass(frozen=True, slots=True)
class RecordingCheck:
    """What a recording holds, and what is wrong with it."""

    findings: tuple[Finding, ...]
    messages: Mapping[str, int]
    """Messages per topic."""
    duration_s: float
    """From the first log time to the last."""
    bytes: int
    """Size of the file."""

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not any(finding.severity == "error" for finding in self.findings)


def check_recording(path: Path) -> RecordingCheck:
    """Read every byte of a recording and hold it against its checksums, its index and its rig.

    Raises:
        RecordingError: where there is no such file, or it is no MCAP file.
    """
    with mapped(path) as data:
        visitor = ContentVisitor()
        found = survey(data, visitor)
        require_mcap(path, data, found)
        structure = tuple(structure_findings(data, found))
        findings = [*structure, *rig_findings(found, visitor.frames), *visitor.findings(), *time_findings(found)]
        size = len(data)
    if structure or path.suffix == PART_SUFFIX:
        findings.insert(0, error(f"unfinished or damaged: run `{recover_command(path)}`"))
    if not any(channel.log_ns for channel in found.channels.values()):
        findings.append(warning("the recording holds no messages"))
    times = [t_ns for channel in found.channels.values() for t_ns in channel.log_ns]
    duration_s = (max(times) - min(times)) / 1e9 if times else 0.0
    return RecordingCheck(tuple(findings), message_counts(found), duration_s, size)


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
