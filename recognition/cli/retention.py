"""``recognition retain``: delete what was recorded more than so many days ago."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from recognition.cli._app import JsonOption, app, print_json


@app.command()
def retain(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of the recordings.")],
    days: Annotated[float, typer.Option(metavar="N", help="How many days to keep, counted from the last writing.")],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be deleted, and delete nothing.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Delete recordings older than N days, with their evidence and logs, and say what was deleted.

    A recording of segments loses the old ones; one that is being written is left alone.

    Exit code 0: done; 1: something could not be deleted; 2: no folder of recordings.
    """
    from recognition.retention import delete, plan_retention

    plan = plan_retention(folder, days=days, now_s=time.time())
    results = [(one, None) for one in plan.doomed] if dry_run else list(delete(plan))
    failed = [(one, why) for one, why in results if why is not None]
    if as_json:
        rows = [
            {"path": str(one.path), "bytes": one.bytes, "age_days": one.age_s / 86400, "failed": why}
            for one, why in results
        ]
        left = [str(path) for path in plan.left]
        print_json({"dry_run": dry_run, "files": rows, "left": left, "recordings_kept": plan.kept})
    else:
        for one, why in results:
            word = f"NOT deleted ({why})" if why else "would delete" if dry_run else "deleted"
            typer.echo(f"{word}  {one.path}  {one.bytes / 1e6:.1f} MB, {one.age_s / 86400:.1f} days old")
        for path in plan.left:
            typer.echo(f"left  {path}: it begins like a deleted recording; delete it if it shows people")
        size = sum(one.bytes for one, why in results if why is None) / 1e6
        count = len(results) - len(failed)
        typer.echo(
            f"{'would delete' if dry_run else 'deleted'} {count} files, {size:.1f} MB; recordings kept: {plan.kept}"
        )
    raise typer.Exit(1 if failed else 0)
