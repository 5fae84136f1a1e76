"""The application that the commands join, the options that they share, and how they print."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rigcal.board import Board
    from rigcal.rigdocument import RigDocument
    from rigcal.site import Site

app = typer.Typer(
    help="Calibrate, check and report a rig of cameras; the result is one validated rig file.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=False,
)

BOARD_HELP = (
    "checkerboard:9x6:25mm (inner corners), charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000, or aprilgrid:6x6:88mm"
)
CaptureArgument = Annotated[
    Path, typer.Argument(metavar="CAPTURE", help="Folder with a folder of images or a video per camera.")
]
RigArgument = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file, NAME.rig.json.")]
BoardOption = Annotated[str | None, typer.Option("--board", metavar="SPEC", help=BOARD_HELP)]
SiteOption = Annotated[
    Path | None, typer.Option("--site", metavar="FILE", help="Site file, NAME.site.toml: cameras, board, limits.")
]
ModelOption = Annotated[
    str,
    typer.Option(
        "--model", help="Lens model where the site file names none: auto, opencv4, opencv5, opencv8 or fisheye4."
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
CacheOption = Annotated[bool, typer.Option("--cache/--no-cache", help="Keep and reuse board detections.")]


def write_report(document: RigDocument, rig: Path, output: Path) -> None:
    from rigcal.evidence import SUFFIX, beside, read_evidence
    from rigcal.report import html_report
    from rigcal.rigfile import write_atomically

    write_atomically(output, html_report(document, read_evidence(beside(rig, SUFFIX))))


def finish(document: RigDocument, output: Path, as_json: bool) -> None:
    from rigcal.evidence import beside
    from rigcal.report import text_report

    if as_json:
        print_json(with_files(document, output) | {"report": str(beside(output, ".report.html"))})
    else:
        show(text_report(document, file_name=output.name))
        show(f"rig file {output}\nreport   {beside(output, '.report.html')}")
    raise typer.Exit(0 if document.verdict == "PASS" else 1)


def with_files(document: RigDocument, output: Path) -> dict[str, Any]:
    return {"rig_file": str(output)} | document.model_dump(mode="json")


def now_utc() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def console(*, stderr: bool = False) -> Any:
    from rich.console import Console

    return Console(stderr=stderr, highlight=False, soft_wrap=False)


def show(what: object) -> None:
    if isinstance(what, str):
        typer.echo(what)
    else:
        console().print(what)


def print_json(value: Mapping[str, Any]) -> None:
    typer.echo(json.dumps(value, ensure_ascii=False))


def board_of(spec: str | None, site: Site | None) -> Board:
    from rigcal.board import parse_board
    from rigcal.errors import BoardSpecError

    if spec is not None:
        return parse_board(spec)
    if site is not None and site.calibration_board is not None:
        return site.calibration_board
    raise BoardSpecError("", problem="no board was given", expected="--board SPEC, or board = in the site file")


def site_of(path: Path | None) -> Site | None:
    from rigcal.site import load_site

    return load_site(path) if path is not None else None
