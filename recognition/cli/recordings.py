"""``recognition check`` and ``recover``: what a recording holds, and what can be saved of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recognition.cli._app import JsonOption, RecordingArgument, app, print_json
from rigcal.errors import writing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recognition.recording import Finding, RecordingCheck


@app.command()
def check(recording: RecordingArgument, as_json: JsonOption = False) -> None:
    """Read every byte of a recording: checksums, index, times, video, rig, clocks, and how its segments follow.

    IN.mcap is a file, the name NAME.mcap of the segments NAME.000.mcap and so on, or a folder with one recording.

    Exit code 0: sound; 1: an error was found; 2: not a recording.
    """
    from recognition.recording import check_run

    found = check_run(recording)
    if as_json:
        print_json(_document(recording, found.segments, found.findings, is_ok=found.ok))
    else:
        for segment in found.segments:
            _tell(segment)
        _tell_findings(found.findings)
        if len(found.segments) > 1:
            typer.echo(f"{'OK' if found.ok else 'DAMAGED'}  {recording}, {len(found.segments)} segments")
    raise typer.Exit(0 if found.ok else 1)


def _document(
    recording: Path, segments: Sequence[RecordingCheck], between: Sequence[Finding], *, is_ok: bool
) -> dict[str, Any]:
    topics = {topic: 0 for segment in segments for topic in segment.messages}
    for segment in segments:
        for topic, count in segment.messages.items():
            topics[topic] += count
    findings = [
        {"severity": f.severity, "text": f.text, "file": str(segment.path)}
        for segment in segments
        for f in segment.findings
    ]
    return {
        "recording": str(recording),
        "ok": is_ok,
        "files": [str(segment.path) for segment in segments],
        "bytes": sum(segment.bytes for segment in segments),
        "duration_s": sum(segment.duration_s for segment in segments),
        "messages": topics,
        "facts": list(segments[0].facts),
        "findings": [*findings, *({"severity": f.severity, "text": f.text, "file": None} for f in between)],
    }


def _tell(found: RecordingCheck) -> None:
    typer.echo(f"{'OK' if found.ok else 'DAMAGED'}  {found.path}")
    typer.echo(f"{sum(found.messages.values())} messages, {found.duration_s:.2f} s, {found.bytes / 1e6:.1f} MB")
    for topic, count in found.messages.items():
        typer.echo(f"  {count:8d}  {topic}")
    for fact in found.facts:
        typer.echo(fact)
    _tell_findings(found.findings)


def _tell_findings(findings: Sequence[Finding]) -> None:
    for finding in findings:
        typer.echo(f"{finding.severity}: {finding.text}")


@app.command()
def recover(
    recording: Annotated[Path, typer.Argument(metavar="IN.mcap", help="A killed or damaged recording, or its .part.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.mcap", help="The recording to write.")],
    as_json: JsonOption = False,
) -> None:
    """Copy everything sound of a recording into a new one; the source is only read.

    Exit code 0: nothing was lost; 3: something was, and how much is said; 2: nothing can be read.
    """
    from recognition.recording import recover_recording

    with writing(output):
        found = recover_recording(recording, output)
    if as_json:
        print_json(
            {
                "recording": str(output),
                "lost": found.lost,
                "messages": dict(found.messages),
                "missing": dict(found.missing),
                "bytes_discarded": found.bytes_discarded,
                "losses": list(found.losses),
                "last_ns": found.last_ns,
            }
        )
    else:
        typer.echo(f"kept {sum(found.messages.values())} messages in {output}")
        for loss in found.losses:
            typer.echo(f"lost: {loss}")
    raise typer.Exit(3 if found.lost else 0)
