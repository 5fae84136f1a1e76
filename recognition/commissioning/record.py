"""The commissioning record ``NAME.commission.json``: which rules work on a site, and with what that was found out.

It is bound to what it was made with by digests, and to itself by its own: one that was edited is refused.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from recognition.commissioning.results import Outcome, RuleResult, Verdict
from recognition.commissioning.walk import Performed
from recognition.errors import CommissionError
from recognition.judging import MODEL_KEY
from recognition.replay import recorded_cameras
from recognition.rules import RuleSet
from recognition.sources.recording import RecordedRun
from rigcal.errors import writing
from rigcal.rigfile import digest, readable_json, write_atomically

VERSION: Literal[1] = 1
People = Literal["real", "simulated"]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Network(_Strict):
    """A network that took part."""

    family: str
    name: str
    """Of its file."""
    sha256: str


class RecordedStep(_Strict):
    """A rule in a step."""

    step: int
    outcome: Outcome
    delay_s: float | None


class RecordedRule(_Strict):
    """A rule, and how it did."""

    rule: str
    verdict: Verdict
    worst_delay_s: float | None
    """Of the violations that were found."""
    steps: tuple[RecordedStep, ...]


class RecordedWalk(_Strict):
    """A step that was done."""

    say: str
    about: tuple[str, ...]
    violates: tuple[str, ...]
    start_s: float
    """After the recording's first instant."""
    end_s: float


class CommissionRecord(_Strict):
    """A commissioning record."""

    format: Literal["recognition.commission"] = "recognition.commission"
    version: Literal[1] = VERSION
    site: str
    author: Annotated[str, Field(min_length=1)]
    at_utc: str
    """When, ISO 8601."""
    people: People
    """Who walked."""
    rules_name: str
    rules_digest: str
    rig_digest: str
    """The rig file's ``geometry_digest``."""
    rig_verdict: str
    networks: tuple[Network, ...]
    cameras: tuple[str, ...]
    """Those that were used."""
    recording: str
    """Name of the recording of the walk."""
    walk: tuple[RecordedWalk, ...]
    results: tuple[RecordedRule, ...]
    digest: str = ""
    """SHA-256 of everything else; empty until written."""

    @property
    def passes(self) -> bool:
        """Whether every rule passes."""
        return all(result.verdict == "pass" for result in self.results)


def record_of(
    results: Sequence[RuleResult],
    performed: Sequence[Performed],
    start_ns: int,
    recorded: RecordedRun,
    rules: RuleSet,
    rig_digest: str,
    *,
    author: str,
    at_utc: str,
    people: People,
) -> CommissionRecord:
    """The record of a walk.

    Args:
        results: Of every rule.
        performed: The steps that were done.
        start_ns: Time of the recording's first instant.
        recorded: The recording, which says what networks and cameras it was made with.
        rules: That were watched.
        rig_digest: The rig file's ``geometry_digest``.
        author: Who answers for it.
        at_utc: When, ISO 8601.
        people: Who walked.
    """
    ids, use = recorded.rig.camera_ids, recorded_cameras(recorded)
    return CommissionRecord(
        site=recorded.rig.site,
        author=author,
        at_utc=at_utc,
        people=people,
        rules_name=rules.name,
        rules_digest=rules.digest,
        rig_digest=rig_digest,
        rig_verdict=recorded.rig.verdict,
        networks=networks_of(recorded.metadata),
        cameras=tuple(camera_id for camera_id, used in zip(ids, use, strict=True) if used),
        recording=recorded.files[0].name,
        walk=tuple(
            RecordedWalk(
                say=done.step.say,
                about=done.step.about,
                violates=done.step.violates,
                start_s=round((done.start_ns - start_ns) * 1e-9, 3),
                end_s=round((done.end_ns - start_ns) * 1e-9, 3),
            )
            for done in performed
        ),
        results=tuple(
            RecordedRule(
                rule=result.rule,
                verdict=result.verdict,
                worst_delay_s=result.worst_delay_s,
                steps=tuple(RecordedStep(step=s.step, outcome=s.outcome, delay_s=s.delay_s) for s in result.steps),
            )
            for result in results
        ),
    )


def networks_of(metadata: Mapping[str, str]) -> tuple[Network, ...]:
    """The networks of a run, by family, of the metadata of its recording."""
    found = []
    for key, text in sorted(metadata.items()):
        if key.startswith(MODEL_KEY):
            name, _, sha256 = text.rpartition(" ")
            found.append(Network(family=key.removeprefix(MODEL_KEY), name=name, sha256=sha256))
    return tuple(found)


def write_record(record: CommissionRecord, path: Path) -> CommissionRecord:
    """Write a record with its digest.

    Returns:
        The record as it was written.

    Raises:
        OutputError: where it cannot be written.
    """
    content = record.model_dump(mode="json")
    content["digest"] = digest(content)
    with writing(path):
        write_atomically(path, readable_json(content) + "\n")
    return CommissionRecord.model_validate_json(json.dumps(content))


def read_record(path: Path) -> CommissionRecord:
    """Read a record.

    Raises:
        CommissionError: where it cannot be read, is of a newer version, or was changed since it was written.
    """
    content = _content(path)
    version = content.get("version")
    if isinstance(version, int) and version > VERSION:
        raise _refused(path, "this record is of a newer version", f"version {VERSION}", f"version {version}")
    try:
        record = CommissionRecord.model_validate_json(json.dumps(content))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise _refused(path, f"this is no commissioning record: {place}", first["msg"], first["input"]) from error
    if record.digest != digest(content):
        raise _refused(path, "this record was changed since it was written", digest(content), record.digest)
    return record


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise _refused(path, "cannot read this commissioning record", "a file of JSON", error) from error
    if not isinstance(content, dict):
        raise _refused(path, "this is no commissioning record", "a JSON object", type(content).__name__)
    return content


def _refused(path: Path, problem: str, expected: str, got: object) -> CommissionError:
    shown = repr(got) if isinstance(got, dict | list) else str(got)
    return CommissionError(
        problem,
        where=path,
        expected=expected,
        got=shown if len(shown) <= 100 else shown[:97] + "...",
        do_next="walk again: recognition commission --help",
    )
