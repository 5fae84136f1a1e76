"""How import and export name the formats: from the registry, which is loaded only when somebody asks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from rigcal.cli._app import show

if TYPE_CHECKING:
    from rigcal.formats import Format


class NamesFormats(TyperCommand):
    """A command whose help ends with the formats."""

    def get_help(self, ctx: Any) -> str:
        """The help of the command, and below it the formats."""
        return f"{super().get_help(ctx)}\n\nFormats:\n{_table()}"


def _table() -> str:
    from rigcal.formats import FORMATS

    width = max(map(len, FORMATS))
    return "\n".join(
        f"  {form.name:{width}}  {_directions(form):14}  {'folder' if form.is_folder else 'file':6}  {form.description}"
        for form in FORMATS.values()
    )


def _directions(form: Format) -> str:
    if form.can_import and form.can_export:
        return "import, export"
    return "import only" if form.can_import else "export only"


def _show_list(is_asked: bool) -> None:
    if is_asked:
        show(_table())
        raise typer.Exit


def _show_meaning(name: str | None) -> None:
    if name is None:
        return
    from rigcal.errors import UnknownFormatError
    from rigcal.formats import FORMATS

    if name not in FORMATS:
        problem = f"there is no format {name!r}"
        raise UnknownFormatError(problem, where="--explain", formats=list(FORMATS), got=name, option="--explain")
    show(FORMATS[name].meaning)
    raise typer.Exit


ListOption = Annotated[
    bool, typer.Option("--list", is_eager=True, callback=_show_list, help="List the formats and leave.")
]
ExplainOption = Annotated[
    str | None,
    typer.Option(
        "--explain",
        metavar="FORMAT",
        is_eager=True,
        callback=_show_meaning,
        help="Say what a format's numbers mean, and leave.",
    ),
]
