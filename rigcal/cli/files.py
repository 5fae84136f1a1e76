"""Commands on files: check and report a rig file, and exchange it with other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigcal.cli._app import JsonOption, RigArgument, app, now_utc, print_json, show, with_files, write_report
from rigcal.cli._formats import ExplainOption, ListOption, NamesFormats
from rigcal.errors import writing


@app.command()
def validate(rig: RigArgument, as_json: JsonOption = False) -> None:
    """Check a rig file: its form, its digest and its gates.

    Exit code 0: PASS or IMPORTED; 1: a gate fails; 2: not a valid rig file.
    """
    from rigcal.report import text_report
    from rigcal.rigfile import read_rigfile

    document = read_rigfile(rig)
    if as_json:
        print_json(
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
        show(text_report(document))
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
        write_report(document, rig, output)
    show(f"report {output}")


@app.command("import", cls=NamesFormats)
def import_file(
    source: Annotated[Path, typer.Argument(metavar="FILE|FOLDER", help="Calibration of another tool.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.rig.json", help="The rig file to write.")],
    from_format: Annotated[
        str | None, typer.Option("--from", metavar="FORMAT", help="Its format; found out when not given.")
    ] = None,
    unit: Annotated[
        str | None, typer.Option("--unit", metavar="m|cm|mm", help="Its unit of length, where it does not say one.")
    ] = None,
    world: Annotated[
        bool, typer.Option("--world", help="Its common frame has z up and the floor at 0: keep it as the world.")
    ] = False,
    as_json: JsonOption = False,
    _list: ListOption = False,
    _explain: ExplainOption = None,
) -> None:
    """Turn another tool's calibration into a rig file, verdict IMPORTED."""
    from rigcal.formats import import_rig
    from rigcal.report import text_report
    from rigcal.rigfile import write_rigfile

    document = import_rig(source, from_format=from_format, created_utc=now_utc(), unit=unit, common_is_world=world)
    with writing(output):
        document = write_rigfile(document, output)
    if as_json:
        print_json(with_files(document, output))
    else:
        show(text_report(document))
        show(f"rig file {output}")


@app.command("export", cls=NamesFormats)
def export_file(
    rig: RigArgument,
    to_format: Annotated[str, typer.Option("--to", metavar="FORMAT", help="One of the formats below.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="The file or folder to write.")],
    as_json: JsonOption = False,
    _list: ListOption = False,
    _explain: ExplainOption = None,
) -> None:
    """Write a rig for another tool; refused where that format cannot hold a coefficient or a name."""
    from rigcal.formats import FORMATS, export_rig
    from rigcal.rigfile import read_rigfile

    document = read_rigfile(rig)
    with writing(output):
        conventions = export_rig(document, output, to_format)
    if as_json:
        print_json({"file": str(output), "format": to_format, "conventions": list(conventions)})
    else:
        for line in conventions:
            show(f"  {line}")
        show(f"{to_format} {'folder' if FORMATS[to_format].is_folder else 'file'} {output}")
