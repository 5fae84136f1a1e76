"""What ``recognition run`` tells at its end, for people or as one JSON object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import typer

from recognition.cli._app import print_json
from recognition.cli._judged import event_lines
from recognition.cli._running import Outcome
from recognition.cli._signals import Stop
from recognition.commissioning import STANDING_KEY
from recognition.events import event_document
from recognition.rules import RuleSet
from recognition.status import summary
from rigcal.rig import Rig


def tell_json(rig: Rig, told: Outcome, rules: RuleSet | None, written: Mapping[str, Path]) -> None:
    """The outcome as one object on standard output; ``written`` are the files and folders beside the recording."""
    result, recorded = told.result, told.recorded
    print_json(
        {
            "recording": str(recorded.path),
            "files": [str(path) for path in recorded.files],
            **{name: str(written[name]) if name in written else None for name in ("poses", "events_file", "evidence")},
            "verdict": rig.verdict,
            "instants": result.instants,
            "scenes": result.placed,
            "stopped": result.stopped,
            "rule": told.facts,
            "sync": told.sync.document if told.sync else None,
            "warnings": list(told.warnings),
            "notices": list(told.notices),
            "people_detected": dict(result.detections),
            "workers": {str(track): count for track, count in result.worker_instants.items()},
            "objects": dict(result.object_instants),
            "rules": {"name": rules.name, "digest": rules.digest} if rules else None,
            "commissioning": told.metadata.get(STANDING_KEY),
            "events": [event_document(event) for event in result.events],
            "monitoring": dict(result.statuses),
            "monitoring_s": told.seconds,
            "unmonitored": told.unmonitored,
            "live": told.live.document if told.live else None,
            "messages": dict(recorded.messages),
            "recording_stopped": recorded.stopped,
            "bytes": recorded.bytes,
        }
    )


def tell(rig: Rig, told: Outcome, stop: Stop, rules: RuleSet | None, written: Mapping[str, Path]) -> None:
    """The outcome for people; ``written`` as in :func:`tell_json`."""
    for line in _lines(rig, told, stop):
        typer.echo(line)
    for line in event_lines(told.result.events, rules, told.result.start_ns) if rules else ():
        typer.echo(line)
    recorded = told.recorded
    typer.echo(f"recording {recorded.path} ({recorded.bytes / 1e6:.1f} MB, open it in Foxglove)")
    for name, path in written.items():
        typer.echo(f"{name.removesuffix('_file'):<9} {path}")


def _lines(rig: Rig, told: Outcome, stop: Stop) -> Iterable[str]:
    result = told.result
    if result.stopped:
        yield f"stopped by {stop.by}" + ("" if told.recorded.stopped else ": everything up to here is in the recording")
    if told.unmonitored:
        yield f"NOTHING WAS MONITORED: {told.unmonitored}"
    blind = result.statuses.get("NOT MONITORED", 0) if told.live else 0
    facts = ", ".join(f"{key} {value}" for key, value in told.facts.items() if not key.startswith("source."))
    yield f"{result.instants} instants, {result.placed - blind} of them in 3D ({facts}), rig {rig.verdict}"
    yield from _monitoring(told)
    yield from summary(told.live) if told.live else ()
    yield from told.sync.lines() if told.sync else ()
    if told.recorded.stopped:
        yield f"NOT RECORDED TO THE END: {told.recorded.stopped}"
    for path in told.recorded.dropped:
        yield f"{path.name} was deleted to make room"
    yield from (f"warning: {warning}" for warning in told.warnings)
    yield from (f"notice: {notice}" for notice in told.notices)
    yield "people detected  " + ", ".join(f"{c} {n}" for c, n in result.detections.items())
    yield from (f"  worker {track}: seen in 3D at {n} instants" for track, n in result.worker_instants.items())
    yield from (f"  {name}: seen in 3D at {n} instants" for name, n in result.object_instants.items())


def _monitoring(told: Outcome) -> Iterable[str]:
    if told.seconds:
        yield ", ".join(f"{status} for {lasted_s:.1f} s" for status, lasted_s in told.seconds.items())
        return
    for status, count in told.result.statuses.items():
        if status != "MONITORED":
            yield f"{status} at {count} of {told.result.instants} instants"
