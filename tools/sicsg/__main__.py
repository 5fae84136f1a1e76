"""SICSG's command line: scenes, training data, evaluation sequences, the demo site.

python -m tools.sicsg dataset --split train --scenes 400 --out out/sicsg/train
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True, add_completion=False, help=__doc__, pretty_exceptions_enable=False)
Jobs = Annotated[int, typer.Option(help="Processes that render at the same time.")]


@app.callback()
def main() -> None:
    """Keep the commands' names, however few there are."""


@app.command()
def dataset(
    out: Annotated[Path, typer.Option(help="Folder; what is there already is kept.")],
    split: Annotated[str, typer.Option(help="train or validation.")] = "train",
    scenes: Annotated[int, typer.Option(help="How many scenes.")] = 400,
    first: Annotated[int, typer.Option(help="Number of the first scene.")] = 0,
    cameras: Annotated[int, typer.Option(help="Cameras of each scene.")] = 4,
    moments: Annotated[int, typer.Option(help="Pictures of each camera.")] = 3,
    renderer: Annotated[str, typer.Option(help="gl (fast path) or cycles.")] = "gl",
    samples: Annotated[int, typer.Option(help="Samples a pixel of the path tracer.")] = 4,
    jobs: Jobs = 2,
) -> None:
    """Render training images with their COCO annotations."""
    from tools.sicsg.dataset import Recipe, make_dataset

    recipe = Recipe(split, scenes, renderer, cameras=cameras, moments=moments, first=first, samples=samples)
    typer.echo(make_dataset(recipe, out, jobs=jobs, say=typer.echo))


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder; what is there already is kept.")] = Path("rig_configs/demo"),
    kept: Annotated[
        Path, typer.Option(help="Where pictures are kept until all of them are there; may be deleted afterwards.")
    ] = Path("out/sicsg/demo"),
    jobs: Jobs = 2,
) -> None:
    """Make the demo site: board videos, probe log and work sequence, with their truth; goes on where it was stopped."""
    from tools.sicsg.demo.make import make_demo

    make_demo(out, kept, jobs=jobs, say=typer.echo)


@app.command()
def plan(
    split: Annotated[str, typer.Option(help="validation or test.")],
    count: Annotated[int, typer.Option(help="How many sequences.")] = 12,
) -> None:
    """Choose evaluation sequences and write their scene files, which are committed."""
    from tools.sicsg.planning import write_plan

    for path in write_plan(split, count):
        typer.echo(path)


@app.command()
def sequences(
    out: Annotated[Path, typer.Option(help="Folder; sequences that are there already are kept.")],
    split: Annotated[str, typer.Option(help="validation or test.")],
    only: Annotated[str, typer.Option(help="Only those whose name holds this, for example cycles.")] = "",
    jobs: Jobs = 2,
) -> None:
    """Render the evaluation sequences from their scene files."""
    from tools.sicsg.sequences import make_sequences

    make_sequences(split, out, only=only, jobs=jobs, say=typer.echo)


@app.command()
def sheet(
    dataset: Annotated[Path, typer.Argument(help="A data set's folder.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture to write.")],
    columns: Annotated[int, typer.Option(help="Pictures side by side.")] = 8,
    rows: Annotated[int, typer.Option(help="Pictures one below the other.")] = 10,
) -> None:
    """Write a contact sheet of a data set."""
    import cv2

    from tools.sicsg.sheet import contact_sheet

    page = contact_sheet(sorted((dataset / "images").glob("*.jpg")), columns, rows)
    cv2.imwrite(str(output), page, [cv2.IMWRITE_JPEG_QUALITY, 80])


if __name__ == "__main__":
    app()
