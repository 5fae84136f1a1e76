"""The report of clocks after a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigcal.cli._app import JsonOption, SiteOption, print_json, show, site_of
from rigcal.cli.sync._app import progress_bar, sync_app

if TYPE_CHECKING:
    from rigcal.site import Site
    from rigcal.sync.history.series import SyncHistory


@sync_app.command()
def report(
    recorded: Annotated[Path, typer.Argument(metavar="CAPTURE|MCAP", help="A capture folder, or a recording.")],
    rig: Annotated[
        Path | None, typer.Option("--rig", metavar="RIG", help="Rig file; a recording holds its own.")
    ] = None,
    site: SiteOption = None,
    log: Annotated[
        Path | None,
        typer.Option("--log", metavar="FILE.csv", help="Probe log; CAPTURE/clock_probes.csv is found by itself."),
    ] = None,
    content: Annotated[bool, typer.Option("--content", help="Also compare the pictures of a capture.")] = False,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.html", help="The page.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Show how clocks and frames held through a recording.

    One HTML page: offset, bound, missing frames and rate of each camera over time.

    Exit code 0: every camera held; 1: a camera is red; 2: bad input.
    """
    from rigcal.report.clocks import sync_report
    from rigcal.rigfile import write_atomically
    from rigcal.sync.check import Colour, worst
    from rigcal.sync.history.judged import colour_of
    from rigcal.sync.history.minutes import summary_per_minute

    history = _history(recorded, rig, site_of(site), log, content)
    path = output or recorded.with_name(f"{recorded.stem if recorded.is_file() else recorded.name}.sync.html")
    write_atomically(path, sync_report(history))
    colours = {camera.camera_id: colour_of(history, camera) for camera in history.cameras}
    if as_json:
        print_json({"report": str(path)} | summary_per_minute(history))
    else:
        for camera in history.cameras:
            show(f"{camera.camera_id} {colours[camera.camera_id]}: {'; '.join(camera.remarks) or 'nothing to remark'}")
        show(f"report {path}")
    raise typer.Exit(1 if worst(colours.values()) is Colour.RED else 0)


def _history(recorded: Path, rig: Path | None, site: Site | None, log: Path | None, content: bool) -> SyncHistory:
    from rigcal.cli.sync._content import By, compare, content_of
    from rigcal.rigfile import read_rigfile
    from rigcal.sync.history.build import history_of_capture, history_of_recording
    from rigcal.sync.log import probe_log_beside, read_exchanges
    from rigcal.sync.recording import read_recording

    beside = log or probe_log_beside(recorded)
    exchanges = read_exchanges(beside) if log or beside.exists() else None
    if recorded.is_file() or recorded.suffix == ".mcap":
        with progress_bar("reading the recording") as bar:
            task = bar.add_task("", total=None)
            recording = read_recording(
                recorded, progress=lambda done, total: bar.update(task, completed=done, total=total)
            )
        return history_of_recording(recording, site=site, log=exchanges)
    document = read_rigfile(rig) if rig else None
    found = content_of(recorded, document)
    lags = None
    if content:
        lags = compare(found, By.AUTO)
    return history_of_capture(found.capture, document=document, site=site, log=exchanges, content=lags)
