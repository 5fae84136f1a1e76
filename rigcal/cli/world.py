"""The world frame of a rig: z up, the floor at 0."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli._app import (
    BoardOption,
    CacheOption,
    JsonOption,
    RigArgument,
    app,
    now_utc,
    print_json,
    show,
    write_report,
)
from rigcal.cli._rigviews import board_of_rig, views_of_rig
from rigcal.errors import writing

if TYPE_CHECKING:
    from rigcal.rigdocument import RigDocument
    from rigcal.world import World

_SHOWN = 8
"""Residuals shown, the greatest first."""


@app.command()
def world(
    rig: RigArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT.rig.json", help="The rig file to write; may be RIG.")
    ],
    floor_board: Annotated[
        Path | None,
        typer.Option(metavar="CAPTURE", help="Images of the board lying on the floor, in one or more places."),
    ] = None,
    board: BoardOption = None,
    thickness: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="From the floor to the board's printed side, such as 5mm.")
    ] = None,
    points: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Measured points: name,x_m,y_m,z_m; needs --pixels.")
    ] = None,
    pixels: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Where cameras see the points: name,camera,u_px,v_px.")
    ] = None,
    plumb: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv", help="A hanging line: name,camera,u_px,v_px with names top, bottom and floor."
        ),
    ] = None,
    height: Annotated[
        str | None,
        typer.Option(metavar="CAMERA:LENGTH", help="A camera's height above the floor, for --plumb: cam0:2.41m."),
    ] = None,
    cache: CacheOption = True,
    as_json: JsonOption = False,
) -> None:
    """Put z up and the floor at 0, from a board on the floor, from measured points, or from a plumb line.

    Exit code 0: written; 1: written, and a gate of the rig fails; 2: bad input.
    """
    from rigcal.rigfile import read_rigfile

    given = {"--floor-board": floor_board, "--points": points, "--plumb": plumb}
    _check_options(
        given,
        {"--board": board, "--thickness": thickness},
        {"--pixels": pixels},
        {"--height": height},
    )
    document = read_rigfile(rig)
    if floor_board is not None:
        found = _from_floor_board(document, floor_board, board, thickness, cache)
    elif plumb is not None:
        found = _from_plumb_line(document, plumb, height)
    else:
        found = _from_points(document, points, pixels)
    written = _write(document, found, rig, output)
    if as_json:
        print_json(_as_json(document, found, written, output))
    else:
        _show(document, found, written, output)
    raise typer.Exit(0 if written.verdict in ("PASS", "IMPORTED") else 1)


def _check_options(methods: Mapping[str, object], *belonging: Mapping[str, object]) -> None:
    """Exactly one method, and no option that belongs to another."""
    from rigcal.errors import OptionError, WorldError

    chosen = [name for name, value in methods.items() if value is not None]
    if len(chosen) != 1:
        raise WorldError(
            "there must be one way to find the floor and the vertical",
            expected="one of --floor-board CAPTURE, --points FILE.csv with --pixels FILE.csv, and --plumb FILE.csv",
            got=", ".join(chosen) or "none of them",
            do_next="lay the board flat on the floor where a camera sees it, and give those images with --floor-board",
        )
    for method, options in zip(methods, belonging, strict=True):
        for name, value in options.items():
            if value is not None and method not in chosen:
                raise OptionError(name, expected=f"{name} only together with {method}", got=chosen[0])


def _from_floor_board(
    document: RigDocument, capture: Path, board: str | None, thickness: str | None, cache: bool
) -> World:
    from rigcal.world import world_from_floor_board

    thickness_m = _length("--thickness", thickness) if thickness else 0.0
    detections = views_of_rig(capture, board_of_rig(board, document), document, cache)
    return world_from_floor_board(detections, document, thickness_m)


def _from_points(document: RigDocument, points: Path | None, pixels: Path | None) -> World:
    from rigcal.errors import OptionError
    from rigcal.rigfile import rig_of
    from rigcal.world import read_pixels, read_points, world_from_points

    if points is None or pixels is None:
        raise OptionError("--pixels", expected="--pixels FILE.csv together with --points", got="--points alone")
    seen = read_pixels(pixels, document.camera_ids)
    return world_from_points(rig_of(document), read_points(points), seen, where=pixels)


def _from_plumb_line(document: RigDocument, plumb: Path, height: str | None) -> World:
    from rigcal.errors import OptionError
    from rigcal.rigfile import rig_of
    from rigcal.world import read_pixels, world_from_plumb_line

    above = None
    if height is not None:
        camera_id, _, text = height.rpartition(":")
        if camera_id not in document.camera_ids:
            expected = f"CAMERA:LENGTH with CAMERA one of {', '.join(document.camera_ids)}"
            raise OptionError("--height", expected=expected, got=height)
        above = camera_id, _length("--height", text)
    seen = read_pixels(plumb, document.camera_ids)
    return world_from_plumb_line(rig_of(document), seen, above, where=plumb)


def _length(option: str, text: str) -> float:
    from rigcal.board import parse_length
    from rigcal.errors import OptionError

    expected = "a length above 0 with its unit: 5mm, 2.41m"
    return parse_length(text, lambda problem: OptionError(option, expected=expected, got=problem))


def _write(document: RigDocument, found: World, rig: Path, output: Path) -> RigDocument:
    """The rig file with the world frame, its report, and the residuals beside it where they are elsewhere."""
    from rigcal.amend import amended
    from rigcal.evidence import SUFFIX, beside, read_evidence, write_evidence
    from rigcal.rigdocument import PoseEntry
    from rigcal.rigfile import write_rigfile

    evidence = read_evidence(beside(rig, SUFFIX))
    own = document.extensions.get("rigcal")
    extensions = document.extensions | {"rigcal": (own if isinstance(own, dict) else {}) | {"world": _figures(found)}}
    changes = {"world_from_rig": PoseEntry.of(found.world_from_rig), "extensions": extensions}
    content = amended(document, changes, command="world", utc=now_utc())
    with writing(output):
        if evidence is not None and output.resolve() != rig.resolve():
            write_evidence(evidence, beside(output, SUFFIX))
        written = write_rigfile(content, output)
        write_report(written, output, beside(output, ".report.html"))
    return written


def _figures(found: World) -> dict[str, Any]:
    """How the world was measured: kept in the rig file and printed."""
    from dataclasses import asdict

    return {
        "method": found.method,
        "tilt_sigma_deg": found.tilt_sigma_deg,
        "height_sigma_m": found.height_sigma_m,
        "scale_percent": found.scale_percent,
        "scale_sigma_percent": found.scale_sigma_percent,
        "residuals": [asdict(residual) for residual in found.residuals],
    }


def _as_json(document: RigDocument, found: World, written: RigDocument, output: Path) -> dict[str, Any]:
    from rigcal.rigfile import rig_of

    return {
        "rig_file": str(output),
        "verdict": written.verdict,
        "digest": written.digest,
        "geometry_digest": written.geometry_digest,
        "world_from_rig": written.model_dump(mode="json")["world_from_rig"],
        "camera_heights_m": found.camera_heights_m(rig_of(document)),
        **_figures(found),
    }


def _show(document: RigDocument, found: World, written: RigDocument, output: Path) -> None:
    from rigcal.report.text import plain, table
    from rigcal.rigfile import rig_of

    show(
        f"World from the {found.method}: vertical +- {found.tilt_sigma_deg:.2f} degrees, floor "
        f"+- {1e3 * found.height_sigma_m:.1f} mm at the origin (one sigma)"
    )
    show(
        table(
            ["camera", "height, m"],
            [[plain(c), f"{h:.3f}"] for c, h in found.camera_heights_m(rig_of(document)).items()],
        )
    )
    greatest = sorted(found.residuals, key=lambda residual: -abs(residual.off_m))
    rows = [
        [plain(r.name), f"{1e3 * r.off_m:.1f}", "" if r.tilt_deg is None else f"{r.tilt_deg:.2f}"]
        for r in greatest[:_SHOWN]
    ]
    show(table(["residual of", "off, mm", "tilt, deg"], rows))
    if len(greatest) > _SHOWN:
        show(f"and {len(greatest) - _SHOWN} smaller ones")
    if found.scale_percent is not None and found.scale_sigma_percent is not None:
        show(_scale_sentence(found.scale_percent, found.scale_sigma_percent))
    show(f"rig file {output}: {written.verdict}")


def _scale_sentence(percent: float, sigma_percent: float) -> str:
    figure = f"Measured lengths are {percent:+.2f} +- {sigma_percent:.2f} % longer than the rig's"
    if abs(percent) <= 3 * sigma_percent:
        return f"{figure}: the board's size agrees."
    entered = "small" if percent > 0 else "large"
    return f"{figure}: the board was entered {abs(percent):.1f} % too {entered}, or the points are measured wrong."
