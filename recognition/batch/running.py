"""A batch from recordings to rows: what was computed before is kept, the rest is handed out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from recognition.batch.finding import Found
from recognition.batch.judged import Judged, Orders, Task, failed, judge_recording
from recognition.batch.results import Results
from recognition.batch.rows import Row
from recognition.crews import Crew, WorkerLostError, carried_out

OnRow = Callable[[Row, int], None]
"""Told of every row, and how many there are now."""


@dataclass(frozen=True, slots=True)
class BatchResult:
    """What a batch came to."""

    rows: tuple[Row, ...]
    """Of the recordings that are done, in their order."""
    reused: int
    """How many of them an earlier batch had computed."""
    left: int
    """How many are not done, because somebody stopped it."""
    left_out: tuple[str, ...]
    """Names of recordings that an earlier batch into this folder had, and this one has not."""

    @property
    def failed(self) -> int:
        """How many could not be judged."""
        return sum(row.status == "failed" for row in self.rows)


def run_batch(
    found: Sequence[Found],
    orders: Orders,
    results: Results,
    crew: Crew,
    *,
    on_row: OnRow = lambda _row, _done: None,
    stop: Callable[[], bool] = lambda: False,
) -> BatchResult:
    """Judge recordings; whoever does it and in whatever order, the results are the same.

    Args:
        found: The recordings.
        orders: What to do with each.
        results: Where the results go; what an earlier batch left there is used.
        crew: Who does it.
        on_row: Told of every row as it comes.
        stop: Whether somebody wants it to end; it is asked five times a second.

    Raises:
        BatchError: where the crew is gone.
        OutputError: where results cannot be written.
    """
    tasks = [Task(one, orders, results.earlier(one.name)) for one in found]
    rows: dict[str, Row] = {}
    reused = 0
    for task, result in carried_out(judge_recording, tasks, crew, stop=stop):
        judged = result if isinstance(result, Judged) else Judged(failed(task, None, _words(result)), None)
        reused += judged.is_earlier
        results.add(judged.row, judged.events)
        rows[task.found.name] = judged.row
        on_row(judged.row, len(rows))
    in_order = tuple(rows[one.name] for one in found if one.name in rows)
    if len(in_order) == len(found):
        results.finish(in_order)
    return BatchResult(in_order, reused, len(found) - len(in_order), results.left_out(found))


def _words(failure: object) -> str:
    """Why there is no result, where it is not the recording's fault."""
    if isinstance(failure, WorkerLostError):
        return (
            "the worker's process was killed twice, the second time with no other recording at work: it crashed, or "
            "the system had no memory for it (its log says which)"
        )
    return f"a mistake of the program, please report it: {type(failure).__name__}: {failure}"
