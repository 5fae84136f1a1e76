"""The command line of rigcal: each command parses, calls the library and prints.

Exit codes: 0 ok; 1 a check or gate failed; 2 usage or bad input. Known errors are one message on standard error, and
with ``--json`` also one object on standard output. Progress and logs go to standard error.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.errors import RigcalError, writing

if TYPE_CHECKING:
    from rigcal.board import Board
    from rigcal.detections import SiteDetections
    from rigcal.intrinsics import IntrinsicsResult
    from rigcal.pipeline import CalibrateOptions
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


@app.command()
def calibrate(
    capture: CaptureArgument,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.rig.json", help="The rig file to write.")],
    board: BoardOption = None,
    site: SiteOption = None,
    intrinsics: Annotated[
        Path | None,
        typer.Option(metavar="CAPTURE|FILE", help="Lenses from another capture, a lens file or a rig file."),
    ] = None,
    model: ModelOption = "auto",
    cache: CacheOption = True,
    as_json: JsonOption = False,
) -> None:
    """Calibrate every camera of a capture into one rig file, with a report and the residuals beside it.

    Exit code 0: PASS; 1: RECAPTURE, the file is still written; 2: bad input.
    """
    document = _calibrate("calibrate", capture, output, board, site, intrinsics, model, cache)
    _finish(document, output, as_json)


@app.command()
def extrinsics(
    capture: CaptureArgument,
    intrinsics: Annotated[
        Path, typer.Option(metavar="CAPTURE|FILE", help="Lenses from another capture, a lens file or a rig file.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.rig.json", help="The rig file to write.")],
    board: BoardOption = None,
    site: SiteOption = None,
    cache: CacheOption = True,
    as_json: JsonOption = False,
) -> None:
    """Place cameras whose lenses are known: calibrate with --intrinsics."""
    document = _calibrate("extrinsics", capture, output, board, site, intrinsics, "auto", cache)
    _finish(document, output, as_json)


@app.command()
def intrinsics(
    capture: CaptureArgument,
    board: BoardOption = None,
    site: SiteOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="OUT.json", help="The lens file to write.")
    ] = None,
    model: ModelOption = "auto",
    cache: CacheOption = True,
    as_json: JsonOption = False,
) -> None:
    """Calibrate the lens of each camera alone; the cameras need not see the board together."""
    from rigcal.lensfile import lens_document, write_lenses
    from rigcal.pipeline import calibrate_lenses
    from rigcal.report import lens_report

    declared = _site(site)
    detections = _detect(capture, _board(board, declared), declared, cache)
    lenses = calibrate_lenses(detections, declared, _options(model))
    document = lens_document(detections.board.spec, detections.cameras, lenses)
    if output is not None:
        with writing(output):
            write_lenses(document, output)
    if as_json:
        _print_json(document | {"lens_file": str(output) if output else None})
    else:
        _print(lens_report(document))
        if output is not None:
            _print(f"lens file {output}")


@app.command()
def validate(rig: RigArgument, as_json: JsonOption = False) -> None:
    """Check a rig file: its form, its digest and its gates.

    Exit code 0: PASS or IMPORTED; 1: a gate fails; 2: not a valid rig file.
    """
    from rigcal.report import text_report
    from rigcal.rigfile import read_rigfile

    document = read_rigfile(rig)
    if as_json:
        _print_json(
            {
                "rig_file": str(rig),
                "valid": True,
                "verdict": document.verdict,
                "digest": document.digest,
                "geometry_digest": document.geometry_digest,
                "failed_gates": [gate.model_dump() for gate in document.gates if not gate.passed],
            }
        )
    else:
        _print(text_report(document))
    raise typer.Exit(0 if document.verdict in ("PASS", "IMPORTED") else 1)


@app.command()
def report(
    rig: RigArgument,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.html", help="The page to write.")],
) -> None:
    """Write the calibration report as one self-contained HTML page."""
    from rigcal.rigfile import read_rigfile

    document = read_rigfile(rig)
    with writing(output):
        _write_report(document, rig, output)
    _print(f"report {output}")


@app.command("import")
def import_file(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="Calibration of another tool.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.rig.json", help="The rig file to write.")],
    from_format: Annotated[
        str | None, typer.Option("--from", metavar="FORMAT", help="Its format; found out when not given.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Turn another tool's calibration into a rig file, verdict IMPORTED."""
    from rigcal.formats import import_rig
    from rigcal.report import text_report
    from rigcal.rigfile import write_rigfile

    document = import_rig(source, from_format=from_format, created_utc=_now())
    with writing(output):
        document = write_rigfile(document, output)
    if as_json:
        _print_json(_with_files(document, output))
    else:
        _print(text_report(document))
        _print(f"rig file {output}")


@app.command("export")
def export_file(
    rig: RigArgument,
    to_format: Annotated[str, typer.Option("--to", metavar="FORMAT", help="kalibr, colmap or anipose.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="The file to write.")],
    as_json: JsonOption = False,
) -> None:
    """Write a rig for another tool; refused where that format cannot hold a coefficient."""
    from rigcal.formats import export_rig
    from rigcal.rigfile import read_rigfile

    document = read_rigfile(rig)
    with writing(output):
        conventions = export_rig(document, output, to_format)
    if as_json:
        _print_json({"file": str(output), "format": to_format, "conventions": list(conventions)})
    else:
        for line in conventions:
            _print(f"  {line}")
        _print(f"{to_format} file {output}")


def _calibrate(
    command: str,
    capture: Path,
    output: Path,
    board: str | None,
    site_path: Path | None,
    intrinsics_path: Path | None,
    model: str,
    cache: bool,
) -> RigDocument:
    from rigcal.evidence import SUFFIX, beside, write_evidence
    from rigcal.outcome import document_of, evidence_of
    from rigcal.pipeline import calibrate_site
    from rigcal.rigfile import write_rigfile
    from rigcal.site import GateLimits

    site = _site(site_path)
    options = _options(model, lenses_free=intrinsics_path is None)
    detections = _detect(capture, _board(board, site), site, cache)
    lenses = _lenses(detections, site, intrinsics_path, options, cache)
    result = calibrate_site(detections, site.gates if site else GateLimits(), lenses, options)
    document = document_of(
        result,
        site=site,
        site_name=site.site if site else capture.resolve().name,
        created_utc=_now(),
        command=command,
        options={"board": detections.board.spec, "model": model, "intrinsics_given": intrinsics_path is not None},
    )
    with writing(output):
        write_evidence(evidence_of(result), beside(output, SUFFIX))
        document = write_rigfile(document, output)
        _write_report(document, output, beside(output, ".report.html"))
    return document


def _lenses(
    detections: SiteDetections, site: Site | None, given: Path | None, options: CalibrateOptions, cache: bool
) -> tuple[IntrinsicsResult, ...]:
    from rigcal.lensfile import KnownLens, read_lenses
    from rigcal.pipeline import calibrate_lenses, hold_lenses

    if given is None:
        return calibrate_lenses(detections, site, options)
    if given.is_dir():
        lenses = calibrate_lenses(_detect(given, detections.board, site, cache), site, options)
        known: Mapping[str, KnownLens] = {lens.camera_id: KnownLens(lens.camera, lens.rmse_px) for lens in lenses}
    else:
        known = read_lenses(given)
    return hold_lenses(detections, known, options)


def _detect(path: Path, board: Board, site: Site | None, cache: bool) -> SiteDetections:
    """Open a capture and find the boards in it, with a progress bar on a terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from rigcal.cache import default_cache
    from rigcal.captures import open_capture
    from rigcal.detect import detect_boards
    from rigcal.diagnose import check_boards
    from rigcal.instants import find_instants

    capture = open_capture(path, camera_order=[camera.id for camera in site.cameras] if site else None)
    columns = (TextColumn("finding boards"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = _console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        detections = detect_boards(
            capture,
            board,
            instants=find_instants(capture),
            cache=default_cache() if cache else None,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    check_boards(capture, detections)
    _check_sizes(detections, site)
    return detections


def _check_sizes(detections: SiteDetections, site: Site | None) -> None:
    from rigcal.errors import ImageSizeError

    for camera in detections.cameras:
        declared = site.camera(camera.camera_id) if site else None
        if declared and declared.size_wh and declared.size_wh != camera.size_wh:
            raise ImageSizeError(
                camera.camera_id,
                where="this capture",
                expected_wh=declared.size_wh,
                got_wh=camera.size_wh,
                source="the site file",
            )


def _board(spec: str | None, site: Site | None) -> Board:
    from rigcal.board import parse_board
    from rigcal.errors import BoardSpecError

    if spec is not None:
        return parse_board(spec)
    if site is not None and site.calibration_board is not None:
        return site.calibration_board
    raise BoardSpecError("", problem="no board was given", expected="--board SPEC, or board = in the site file")


def _site(path: Path | None) -> Site | None:
    from rigcal.site import load_site

    return load_site(path) if path is not None else None


def _options(model: str, *, lenses_free: bool = True) -> CalibrateOptions:
    from rigcal.pipeline import CalibrateOptions
    from rigcal.refine import RefineOptions

    return CalibrateOptions(model, refine=RefineOptions(free_lenses=lenses_free))


def _write_report(document: RigDocument, rig: Path, output: Path) -> None:
    from rigcal.evidence import SUFFIX, beside, read_evidence
    from rigcal.report import html_report
    from rigcal.rigfile import write_atomically

    write_atomically(output, html_report(document, read_evidence(beside(rig, SUFFIX))))


def _finish(document: RigDocument, output: Path, as_json: bool) -> None:
    from rigcal.evidence import beside
    from rigcal.report import text_report

    if as_json:
        _print_json(_with_files(document, output) | {"report": str(beside(output, ".report.html"))})
    else:
        _print(text_report(document, file_name=output.name))
        _print(f"rig file {output}\nreport   {beside(output, '.report.html')}")
    raise typer.Exit(0 if document.verdict == "PASS" else 1)


def _with_files(document: RigDocument, output: Path) -> dict[str, Any]:
    return {"rig_file": str(output)} | document.model_dump(mode="json")


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _console(*, stderr: bool = False) -> Any:
    from rich.console import Console

    return Console(stderr=stderr, highlight=False, soft_wrap=False)


def _print(what: object) -> None:
    if isinstance(what, str):
        typer.echo(what)
    else:
        _console().print(what)


def _print_json(value: Mapping[str, Any]) -> None:
    typer.echo(json.dumps(value, ensure_ascii=False))


def main() -> None:
    """Entry point of the console script; a known error becomes its message and exit code 2."""
    try:
        app()
    except RigcalError as error:
        typer.echo(f"error: {error}", err=True)
        if "--json" in sys.argv:
            fields = ("what", "where", "expected", "got", "do_next")
            _print_json({"valid": False, "error": {name: getattr(error, name) for name in fields}})
        raise SystemExit(2) from None
