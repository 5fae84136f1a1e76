"""The group that the commands of clocks join, and what they share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli._app import app, console

if TYPE_CHECKING:
    from rigcal.rigdocument import RigDocument
    from rigcal.sync.record import CameraClock, ClockLimits

sync_app = typer.Typer(
    help="Measure and check the clocks of the cameras.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(sync_app, name="sync")

RigOption = Annotated[Path, typer.Option("--rig", metavar="RIG", help="Rig file that the clocks belong to.")]
OutputOption = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="OUT.rig.json", help="Write here instead of over RIG.")
]


def write_clocks(
    document: RigDocument, clocks: list[CameraClock], limits: ClockLimits, command: str, output: Path
) -> RigDocument:
    """The rig file with these clocks, and its report beside it."""
    from rigcal.cli._app import now_utc, write_report
    from rigcal.errors import writing
    from rigcal.evidence import beside
    from rigcal.rigfile import write_rigfile
    from rigcal.sync.record import with_clocks

    changed = with_clocks(document, clocks, limits, command=command, utc=now_utc())
    with writing(output):
        written = write_rigfile(changed, output)
        write_report(written, output, beside(output, ".report.html"))
    return written


def clock_gates_of(document: RigDocument) -> list[dict[str, Any]]:
    """The gates of clocks, for --json."""
    from rigcal.sync.record import CLOCK_GATE

    return [gate.model_dump(mode="json") for gate in document.gates if gate.name == CLOCK_GATE]


def show_failed_gates(document: RigDocument) -> None:
    from rigcal.cli._app import show
    from rigcal.report.text import plain
    from rigcal.sync.record import CLOCK_GATE

    for gate in document.gates:
        if gate.name == CLOCK_GATE and not gate.passed and gate.advice:
            show(plain(f"{gate.camera}: {gate.advice}"))


def clocks_pass(document: RigDocument) -> bool:
    from rigcal.sync.record import CLOCK_GATE

    return all(gate.passed for gate in document.gates if gate.name == CLOCK_GATE)


def progress_bar(label: str) -> Any:
    """A bar on a terminal; nothing in a pipe."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    terminal = console(stderr=True)
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal)
