"""The command that prints boards."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigcal.cli._app import BOARD_HELP, JsonOption, app, print_json, show
from rigcal.errors import writing

if TYPE_CHECKING:
    from rigcal.target import TargetPlan


@app.command()
def target(
    spec: Annotated[str, typer.Argument(metavar="SPEC", help=BOARD_HELP)],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.pdf", help="The PDF to write.")],
    page: Annotated[
        str, typer.Option(metavar="PAGE", help="A5 to A0, letter, legal, tabloid, or a size such as 600x400mm.")
    ] = "A4",
    landscape: Annotated[
        bool | None, typer.Option("--landscape/--portrait", help="How the page lies; found out when not given.")
    ] = None,
    margin: Annotated[str, typer.Option(metavar="LENGTH", help="Edge that the printer cannot print on.")] = "10mm",
    two_sided: Annotated[
        bool, typer.Option("--two-sided", help="Add the mirrored back of a charuco board, to be printed duplex.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a board as a true-to-scale PDF with rulers; on several sheets to be glued where one is too small."""
    from rigcal.board import parse_board
    from rigcal.target import TargetOptions, draw_target, parse_margin, parse_page, plan_target, symmetry_warning

    board = parse_board(spec)
    plan = plan_target(board, TargetOptions(parse_page(page), landscape, parse_margin(margin), two_sided))
    document = draw_target(plan)
    with writing(output):
        output.write_bytes(document)
    warning = symmetry_warning(board)
    if warning:
        typer.echo(f"warning: {warning}", err=True)
    if as_json:
        print_json(
            {
                "file": str(output),
                "board": board.spec,
                "page_mm": list(plan.frame.page_mm),
                "rows": plan.rows,
                "columns": plan.columns,
                "pattern_mm": list(plan.pattern.size_mm),
                "quiet_mm": round(plan.quiet_mm, 3),
                "fits_on": plan.fits_on,
                "warnings": [warning] if warning else [],
            }
        )
    else:
        for line in _summary(plan):
            show(line)
        show(f"target {output}")


def _summary(plan: TargetPlan) -> tuple[str, ...]:
    from rigcal.target import page_text

    width, height = plan.pattern.size_mm
    page = page_text(plan.frame.page_mm)
    lines = [f"{plan.board.spec}: the pattern measures {width:.6g} x {height:.6g} mm"]
    if plan.tiled:
        better = f"; --page {plan.fits_on} takes it on one" if plan.fits_on else ""
        lines.append(f"{len(plan.sheets)} sheets of {page}, {plan.rows} x {plan.columns} (rows x columns){better}")
    else:
        lines.append(f"one sheet of {page}" + (" and its back" if plan.two_sided else ""))
    return (*lines, "print at 100 %, then measure both rulers: 100 mm each")
