"""``recognition batch``: many recordings judged at once."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import JsonOption, app, print_json
from recognition.cli._show import echo
from rigcal.cores import core_count
from rigcal.errors import OptionsError

if TYPE_CHECKING:
    from recognition.batch import BatchResult, Orders, Row
    from recognition.cli._signals import Stop
    from recognition.crews import Crew


@app.command()
def batch(
    recordings: Annotated[
        list[str],
        typer.Argument(metavar="IN...", help="Recordings, folders with recordings, or patterns such as 'day/*.mcap'."),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT/", help="The folder of the results.")],
    rules: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Judge by this rule file [the one that each run was judged by]."),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes of this machine [one for each core].")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(metavar="SCHEDULER", help="Workers of a Dask cluster that runs, tcp://HOST:8786.")
    ] = None,
    dask_workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Workers of a Dask cluster of this machine, made for this.")
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth every track by what came after; without it tracks are the runs'.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Place and judge many recordings again, each as `recognition replay` does.

    OUT/batch.jsonl and OUT/batch.csv have a row for each recording, in the order of IN; OUT/NAME.events.json has the
    events of one. A recording that cannot be judged is a row that says why. The same command again, also after Ctrl-C
    or a crash, computes only what is not done, has changed or failed. --dask needs `pip install rigcal[dask]`.

    Exit code 0: all are judged; 1: some failed, or it was stopped before the end; 2: bad input.
    """
    from recognition.batch import Results, find_recordings, require_apart, run_batch
    from recognition.cli._signals import stop_on_signal

    crew = _crew(jobs, dask, dask_workers)
    orders = _orders(rules, smooth)
    found = find_recordings(recordings)
    require_apart(output, found)
    with Results(output) as results, stop_on_signal() as stop:
        with crew as workers:
            result = run_batch(
                found, orders, results, workers, on_row=lambda row, done: _show(row, done, len(found)), stop=stop
            )
        if as_json:
            _tell_json(output, result, stop)
        else:
            _tell(output, results.journal, result, stop)
    raise typer.Exit(1 if result.failed or result.left else 0)


def _crew(jobs: int | None, dask: str | None, dask_count: int | None) -> AbstractContextManager[Crew]:
    from recognition.crews import dask_scheduler, dask_workers, process_pool

    given = {"--jobs": jobs, "--dask": dask, "--dask-workers": dask_count}
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise OptionsError(
            names[1],
            expected=f"either it or {names[0]}",
            got=f"{names[1]} {given[names[1]]}, {names[0]} {given[names[0]]}",
            do_next="leave one of them out",
        )
    if dask is not None:
        return dask_scheduler(dask)
    if dask_count is not None:
        return dask_workers(dask_count)
    return process_pool(jobs or core_count())


def _orders(rules: Path | None, smooth: bool) -> Orders:
    from recognition.batch import Orders
    from recognition.judging import read_rulebook

    if rules is None:
        return Orders(smooth=smooth)
    return Orders(read_rulebook(rules).toml.decode("utf-8"), rules.name, smooth)


def _show(row: Row, done: int, total: int) -> None:
    found = row.error
    if row.events is not None:
        count = sum(row.events.values())
        found = f"{row.seconds:.1f} s, {count} {'event' if count == 1 else 'events'}"
    echo(f"{done:>{len(str(total))}}/{total}  {row.status:<6}  {row.name}: {found}")


def _tell_json(output: Path, result: BatchResult, stop: Stop) -> None:
    print_json(
        {
            "output": str(output),
            "recordings": len(result.rows) + result.left,
            "ok": len(result.rows) - result.failed,
            "failed": result.failed,
            "reused": result.reused,
            "left": result.left,
            "stopped": stop.by,
            "left_out": list(result.left_out),
            "rows": [asdict(row) for row in result.rows],
        }
    )


def _tell(output: Path, journal: Path, result: BatchResult, stop: Stop) -> None:
    done = len(result.rows)
    counts = f"{done - result.failed} ok, {result.failed} failed"
    reused = f", {result.reused} of them from before" if result.reused else ""
    if result.left:
        typer.echo(f"stopped by {stop.by}: {counts}{reused}, {result.left} not done")
        typer.echo(f"what is done is in {journal}; the same command again goes on from there")
        return
    from recognition.batch import ROWS, TABLE

    typer.echo(f"{done} recordings: {counts}{reused}")
    totals: dict[str, int] = {}
    for row in result.rows:
        for rule, count in (row.events or {}).items():
            totals[rule] = totals.get(rule, 0) + count
    for rule, count in totals.items():
        typer.echo(f"  {count:6d}  {rule}")
    if result.left_out:
        typer.echo(
            f"warning: rows of {len(result.left_out)} recordings of an earlier batch are left out: "
            f"{', '.join(result.left_out[:3])}{', ...' if len(result.left_out) > 3 else ''}"
        )
    typer.echo(f"rows      {output / ROWS}\ntable     {output / TABLE}")
