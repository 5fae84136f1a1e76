"""What the terminal shows while a run goes on; everything on standard error."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from recognition.live import Entry, LiveFeed
    from recognition.observations import Scene
    from recognition.status import Seen

LINE_EVERY_S = 10.0
"""Where there is no terminal."""
_REFRESHES_PER_S = 2.0


class LastScene:
    """What the latest scene of a run says."""

    def __init__(self) -> None:
        self.seen: Seen | None = None

    def __call__(self, scene: Scene) -> None:
        from recognition.status import Seen

        self.seen = Seen(scene.status, scene.reason, len(scene.workers), len(scene.objects))


@contextmanager
def live_status(feed: LiveFeed) -> Iterator[LastScene]:
    """How a live run stands: a table on a terminal, else a line every ten seconds; what happens at once in any case."""
    from rich.console import Console

    console = Console(stderr=True)
    last = LastScene()
    shown = _table_shown(feed, last, console) if console.is_terminal else _lines_shown(feed, last)
    with shown:
        yield last


@contextmanager
def _table_shown(feed: LiveFeed, last: LastScene, console: object) -> Iterator[None]:
    from rich.live import Live

    from recognition.status import table

    with Live(
        console=console,  # type: ignore[arg-type]  # a rich.console.Console
        get_renderable=lambda: table(feed.status, last.seen),
        refresh_per_second=_REFRESHES_PER_S,
    ) as live:
        feed.announce = lambda entry: live.console.print(_words(entry), markup=False, highlight=False)
        yield


@contextmanager
def _lines_shown(feed: LiveFeed, last: LastScene) -> Iterator[None]:
    from recognition.status import line

    over = threading.Event()

    def tell() -> None:
        while not over.wait(LINE_EVERY_S):
            typer.echo(line(feed.status, last.seen), err=True)

    feed.announce = lambda entry: typer.echo(_words(entry), err=True)
    teller = threading.Thread(target=tell, name="status")
    teller.start()
    try:
        yield
    finally:
        over.set()
        teller.join()


def _words(entry: Entry) -> str:
    return entry.text if entry.level == "info" else f"{entry.level}: {entry.text}"


@contextmanager
def progress(total: int, *, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """A progress bar on standard error, on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = (TextColumn("recognising"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)
