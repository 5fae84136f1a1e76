"""Commands that turn a capture into lenses or a rig file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigcal.cli._app import (
    BoardOption,
    CacheOption,
    CaptureArgument,
    JsonOption,
    ModelOption,
    SiteOption,
    app,
    board_of,
    finish,
    now_utc,
    print_json,
    show,
    site_of,
    write_report,
)
from rigcal.cli._capture import find_boards
from rigcal.errors import writing

if TYPE_CHECKING:
    from rigcal.detections import SiteDetections
    from rigcal.intrinsics import IntrinsicsResult
    from rigcal.pipeline import CalibrateOptions, Known
    from rigcal.rigdocument import RigDocument
    from rigcal.site import Site


DistanceOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CAM,CAM:LENGTH",
        help="Tape between two cameras' lenses, such as cam0,cam1:2.41m: checks the scale. May be repeated.",
    ),
]
BowOption = Annotated[bool, typer.Option("--board-bow", help="Also estimate how far the board bends.")]
SquareOption = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH", help="Side of a square (or tag) as measured on the printed board, such as 59.6mm: a check."
    ),
]


@dataclass(frozen=True, slots=True)
class _Lengths:
    """Lengths as they stand on the command line."""

    distances: tuple[str, ...]
    square: str | None


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
    distance: DistanceOption = None,
    measured_square: SquareOption = None,
    board_bow: BowOption = False,
    clocks: Annotated[
        Path | None,
        typer.Option(metavar="RIG", help="Rig file whose clocks, of `rigcal sync`, put the capture's frames together."),
    ] = None,
    cache: CacheOption = True,
    as_json: JsonOption = False,
) -> None:
    """Calibrate every camera of a capture into one rig file, with a report and the residuals beside it.

    Exit code 0: PASS; 1: RECAPTURE, the file is still written; 2: bad input.
    """
    lengths = _Lengths(tuple(distance or ()), measured_square)
    options = _options(model, lenses_free=intrinsics is None, bow=board_bow)
    document = _calibrate("calibrate", capture, output, board, site, intrinsics, options, lengths, cache, clocks)
    finish(document, output, as_json)


@app.command()
def extrinsics(
    capture: CaptureArgument,
    intrinsics: Annotated[
        Path, typer.Option(metavar="CAPTURE|FILE", help="Lenses from another capture, a lens file or a rig file.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.rig.json", help="The rig file to write.")],
    board: BoardOption = None,
    site: SiteOption = None,
    distance: DistanceOption = None,
    measured_square: SquareOption = None,
    cache: CacheOption = True,
    as_json: JsonOption = False,
) -> None:
    """Place cameras whose lenses are known: calibrate with --intrinsics."""
    lengths = _Lengths(tuple(distance or ()), measured_square)
    options = _options("auto", lenses_free=False)
    document = _calibrate("extrinsics", capture, output, board, site, intrinsics, options, lengths, cache)
    finish(document, output, as_json)


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

    declared = site_of(site)
    detections = find_boards(capture, board_of(board, declared), declared, cache)
    lenses = calibrate_lenses(detections, declared, _options(model))
    document = lens_document(detections.board.spec, detections.cameras, lenses)
    if output is not None:
        with writing(output):
            write_lenses(document, output)
    if as_json:
        print_json(document | {"lens_file": str(output) if output else None})
    else:
        show(lens_report(document))
        if output is not None:
            show(f"lens file {output}")


def _calibrate(
    command: str,
    capture: Path,
    output: Path,
    board: str | None,
    site_path: Path | None,
    intrinsics_path: Path | None,
    options: CalibrateOptions,
    lengths: _Lengths,
    cache: bool,
    clocks_path: Path | None = None,
) -> RigDocument:
    from rigcal.captures import open_capture
    from rigcal.evidence import SUFFIX, beside, write_evidence
    from rigcal.measured import require_cameras
    from rigcal.outcome import document_of, evidence_of
    from rigcal.pictures import with_pictures, worst_views
    from rigcal.pipeline import calibrate_site
    from rigcal.rigfile import read_rigfile, rig_of, write_rigfile
    from rigcal.site import GateLimits
    from rigcal.sync.record import clock_limits, with_clocks_of

    site = site_of(site_path)
    known = _known(site, lengths)
    clocked = read_rigfile(clocks_path) if clocks_path else None
    clocks = {camera.id: camera.clock for camera in rig_of(clocked).cameras} if clocked else None
    detections = find_boards(capture, board_of(board, site), site, cache, clocks)
    require_cameras(known.distances, detections.camera_ids)
    lenses = _lenses(detections, site, intrinsics_path, options, cache)
    result = calibrate_site(detections, site.gates if site else GateLimits(), lenses, options, known=known)
    document = document_of(
        result,
        site=site,
        site_name=site.site if site else capture.resolve().name,
        created_utc=now_utc(),
        command=command,
        options={
            "board": detections.board.spec,
            "model": options.model,
            "board_bow": options.refine.bow,
            "intrinsics_given": intrinsics_path is not None,
            "clocks_given": clocked.digest if clocked else None,
            "distances": [distance.spec for distance in known.distances],
            "measured_square": known.square.text if known.square else None,
        },
    )
    if clocked is not None:
        document = with_clocks_of(document, clocked, clock_limits(document, site))
    with writing(output):
        evidence = evidence_of(result)
        evidence = with_pictures(evidence, open_capture(capture), worst_views(evidence))
        write_evidence(evidence, beside(output, SUFFIX))
        document = write_rigfile(document, output)
        write_report(document, output, beside(output, ".report.html"))
    return document


def _known(site: Site | None, lengths: _Lengths) -> Known:
    from rigcal.measured import parse_distance, parse_measured_length
    from rigcal.pipeline import Known

    return Known(
        (*(site.measured_distances if site else ()), *(parse_distance(text) for text in lengths.distances)),
        parse_measured_length(lengths.square, "--measured-square") if lengths.square is not None else None,
        site.sisters if site else (),
    )


def _lenses(
    detections: SiteDetections, site: Site | None, given: Path | None, options: CalibrateOptions, cache: bool
) -> tuple[IntrinsicsResult, ...]:
    from rigcal.lensfile import KnownLens, read_lenses
    from rigcal.pipeline import calibrate_lenses, hold_lenses

    if given is None:
        return calibrate_lenses(detections, site, options)
    if given.is_dir():
        lenses = calibrate_lenses(find_boards(given, detections.board, site, cache), site, options)
        known: Mapping[str, KnownLens] = {
            lens.camera_id: KnownLens(lens.camera, lens.rmse_px, lens.covariance) for lens in lenses
        }
    else:
        known = read_lenses(given)
    return hold_lenses(detections, known, options)


def _options(model: str, *, lenses_free: bool = True, bow: bool = False) -> CalibrateOptions:
    from rigcal.pipeline import CalibrateOptions
    from rigcal.refine import RefineOptions

    return CalibrateOptions(model, refine=RefineOptions(free_lenses=lenses_free, bow=bow))
