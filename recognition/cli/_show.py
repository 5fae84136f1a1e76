"""What the terminal shows while a run goes on; everything on standard error.

A terminal that was closed, a reader that went away or a full disk under a log file ends no run: what cannot be shown is
in the recording.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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

    live = Live(
        console=console,  # type: ignore[arg-type]  # a rich.console.Console
        get_renderable=lambda: table(feed.status, last.seen),
        refresh_per_second=_REFRESHES_PER_S,
    )

    def announce(entry: Entry) -> None:
        with suppress(OSError):
            live.console.print(_words(entry), markup=False, highlight=False)

    feed.announce = announce
    live.start()
    try:
        yield
    finally:
        with suppress(OSError):
            live.stop()


@contextmanager
def _lines_shown(feed: LiveFeed, last: LastScene) -> Iterator[None]:
    from recognition.status import line

    over = threading.Event()

    def tell() -> None:
        while not over.wait(LINE_EVERY_S):
            echo(line(feed.status, last.seen))

    feed.announce = lambda entry: echo(_words(entry))
    teller = threading.Thread(target=tell, name="status")
    teller.start()
    try:
        yield
    finally:
        over.set()
        teller.join()


def echo(text: str) -> None:
    """A line on standard error, where there is one."""
    with suppress(OSError):
        typer.echo(text, err=True)


def _words(entry: Entry) -> str:
    return entry.text if entry.level == "info" else f"{entry.level}: {entry.text}"


@contextmanager
def progress(total: int | None, *, quiet: bool, label: str = "recognising") -> Iterator[Callable[[int], None] | None]:
    """A progress bar on standard error, on a terminal; ``total`` None: nobody knows how much there is to do."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)
