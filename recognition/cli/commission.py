"""``recognition commission``: a scripted walk on a new site, and a record of which rules work there."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import JsonOption, app, print_json
from recognition.cli._chosen import DEFAULT_FPS, declared_fps, detector_of, require_output, require_runnable
from recognition.cli._show import progress
from recognition.errors import CommissionError
from rigcal.errors import OptionError, OptionsError, writing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recognition.commissioning import CommissionRecord, Performed, Walk
    from recognition.live import LiveInput
    from recognition.rules import RuleSet
    from recognition.sources.recording import RecordedRun
    from rigcal.rigdocument import RigDocument


@app.command()
def commission(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file, NAME.rig.json.")],
    rules: Annotated[Path, typer.Option(metavar="FILE", help="Rule file, NAME.rules.toml.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="OUT.commission.json", help="The record [NAME.commission.json]."),
    ] = None,
    by: Annotated[str | None, typer.Option("--by", metavar="NAME", help="Who answers for the record.")] = None,
    source: Annotated[
        list[str] | None,
        typer.Option(metavar="CAPTURE|URL", help="As of `recognition run`: live cameras, or a capture of the walk."),
    ] = None,
    site: Annotated[Path | None, typer.Option(metavar="FILE", help="Site file: live sources.")] = None,
    recording: Annotated[
        Path | None, typer.Option(metavar="IN.mcap", help="A recording of the walk, instead of cameras.")
    ] = None,
    script: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The walk, NAME.walk.toml [one made from the rules].")
    ] = None,
    clock: Annotated[
        bool, typer.Option("--clock", help="Keep to the times of the walk, instead of waiting for Enter.")
    ] = False,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="Those who walk are not real people; the record says so.")
    ] = False,
    plan: Annotated[bool, typer.Option("--plan", help="Print the walk, to be edited, and do nothing else.")] = False,
    pose_model: Annotated[Path | None, typer.Option(metavar="FILE", help="As of `recognition run`.")] = None,
    object_model: Annotated[Path | None, typer.Option(metavar="FILE", help="As of `recognition run`.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Walk through what the rules allow and forbid, and write down which of them work with these people and networks.

    Live cameras are recorded to OUT.mcap beside the record, with the walk as it was done in OUT.walk.toml, from which
    --recording and --script make a record again. A rule passes where all its violations are found within 2 s and it is
    silent in all other steps.

    Exit code 0: every rule passes; 1: one fails or was not tried; 2: bad input.
    """
    from recognition.commissioning import (
        as_done,
        derived_walk,
        load_walk,
        record_beside,
        require_suited,
        walk_text,
        write_record,
    )
    from recognition.judging import read_rulebook
    from rigcal.rigfile import read_rigfile

    book = read_rulebook(rules).rules
    walk = derived_walk(book) if script is None else load_walk(script)
    require_suited(walk, book, script or rules)
    if plan:
        typer.echo(walk_text(walk), nl=False)
        return
    if not by:
        raise OptionError("--by", expected="the name of who answers for the record", got=by)
    document, path = read_rigfile(rig), output or record_beside(rig)
    if recording is not None:
        if source or site:
            raise OptionsError(
                "--recording",
                expected="no --source or --site beside it",
                got="both",
                do_next="leave --source and --site out to look at a recording of the walk",
            )
        recorded, performed = _opened(recording, document), None
    else:
        asks = not clock and sys.stdin.isatty()
        recorded, performed = _walk_now(rig, document, walk, path, source or [], site, asks, pose_model, object_model)
    record, start_ns = _judged(recorded, document, book, walk, performed, by=by, simulated=simulated, quiet=as_json)
    written = write_record(record, path)
    if performed is not None:
        done = _beside(path, ".walk.toml")
        with writing(done):
            done.write_text(walk_text(as_done(walk.name, performed, start_ns)), encoding="utf-8")
    _tell(written, path, as_json)
    raise typer.Exit(0 if written.passes else 1)


def _opened(recording: Path, document: RigDocument) -> RecordedRun:
    """A recording, which must be of this rig."""
    import json

    from recognition.recording import read_rig_attachment
    from recognition.sources.recording import open_recording

    opened = open_recording(recording)
    own = json.loads(read_rig_attachment(opened.files[0]))["geometry_digest"]
    if own != document.geometry_digest:
        raise CommissionError(
            "the recording is of another rig",
            where=recording,
            expected=f"geometry {document.geometry_digest}",
            got=own,
            do_next="give the rig file that it was recorded with, or walk again",
        )
    return opened


def _walk_now(
    rig_path: Path, document: RigDocument, walk: Walk, output: Path, source: Sequence[str], site_path: Path | None,
    asks: bool, pose_model: Path | None, object_model: Path | None,
) -> tuple[RecordedRun, tuple[Performed, ...] | None]:  # fmt: skip
    """Record the walk; its steps as they were done, None where its own times count."""
    from recognition.cli import _running as running
    from recognition.cli._alarming import Alarming
    from recognition.cli._signals import stop_on_signal
    from recognition.cli._walking import Walking
    from recognition.feeds import FeedOptions
    from recognition.live import chosen_sources, live_cameras
    from recognition.recording import DiskBudget
    from recognition.runtime import RunOptions
    from rigcal.rigfile import rig_of
    from rigcal.site import Site, load_site

    rig = rig_of(document)
    require_runnable(rig_path, rig)
    site = load_site(site_path) if site_path is not None else None
    use = (True,) * len(rig.cameras)
    where = chosen_sources(source, rig, use, site)
    if where is None:
        raise OptionError("--source", expected="live cameras, a capture, --site with sources or --recording", got=None)
    target = _beside(output, ".mcap")
    require_output(target, is_live=isinstance(where, dict))
    job = running.Job(
        rig_path=rig_path,
        output=target,
        rig=rig,
        feed=FeedOptions(use, declared_fps(document, site) or DEFAULT_FPS),
        options=RunOptions(use=use, keep_scenes=False),
        storage=running.Storage(None, DiskBudget()),
        detector=detector_of(object_model, pose_model, needed=True),
        clock_age_s=site.clock_age_s if site else Site.model_fields["clock_age_s"].default,
        quiet=False,
        rulebook=None,
        geometry_digest=document.geometry_digest,
        alarming=Alarming(None, target),
    )
    with writing(target), stop_on_signal() as stop:
        if not isinstance(where, dict):
            running.run_files(job, where, None, stop)
            return _opened(target, document), None
        cameras: LiveInput = live_cameras(rig, where)
        walking = Walking(stop)
        with walking.beside(walk, cameras.now_ns, asks=asks):
            running.run_streams(job, cameras, stop)
    return _opened(target, document), tuple(walking.performed)


def _judged(
    recorded: RecordedRun, document: RigDocument, rules: RuleSet, walk: Walk, performed: tuple[Performed, ...] | None,
    *, by: str, simulated: bool, quiet: bool,
) -> tuple[CommissionRecord, int]:  # fmt: skip
    """The record, and the time of the recording's first instant."""
    from recognition.commissioning import Witness, by_the_clock, record_of, results_of
    from recognition.replay import replay

    witness = Witness(rules, recorded.rig)
    with progress(None, quiet=quiet, label="judging") as bar:
        replay(recorded, keep_scenes=False, watch=witness, progress=bar)
    start_ns = witness.glances[0].t_ns
    done = by_the_clock(walk, start_ns) if performed is None else performed
    record = record_of(
        results_of(rules, witness.glances, done), done, start_ns, recorded, rules, document.geometry_digest,
        author=by, at_utc=datetime.now(UTC).isoformat(timespec="seconds"), people="simulated" if simulated else "real",
    )  # fmt: skip
    return record, start_ns


def _tell(record: CommissionRecord, path: Path, as_json: bool) -> None:
    if as_json:
        print_json({"ok": record.passes, "record": str(path)} | record.model_dump(mode="json"))
        return
    for result in record.results:
        found = [step for step in result.steps if step.outcome in ("found", "late")]
        slowest = "" if result.worst_delay_s is None else f", the slowest after {result.worst_delay_s:.1f} s"
        typer.echo(f"{result.verdict:<9} {result.rule}: {len(found)} violations found{slowest}")
        for step in result.steps:
            if step.outcome not in ("found", "silent"):
                after = "" if step.delay_s is None else f" after {step.delay_s:.1f} s"
                typer.echo(f"          step {step.step}: {step.outcome}{after} ({record.walk[step.step - 1].say})")
    typer.echo(f"record    {path}")


def _beside(record: Path, ending: str) -> Path:
    """Of the record ``NAME.commission.json``: ``NAME.commission`` with another ending."""
    return record.with_name(record.name.removesuffix(".json") + ending)
