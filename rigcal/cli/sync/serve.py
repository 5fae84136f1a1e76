"""The responder that runs on the hosts of cameras."""

from __future__ import annotations

import signal
import threading
from typing import Annotated

import typer

from rigcal.cli._app import show
from rigcal.cli.sync._app import sync_app


@sync_app.command()
def serve(
    port: Annotated[int, typer.Option("--port", metavar="PORT", help="UDP port; the probe looks at 12123.")] = 12123,
    address: Annotated[
        str | None, typer.Option("--address", metavar="ADDRESS", help="Listen at this address only.")
    ] = None,
) -> None:
    """Answer probes on a camera's host, until Ctrl-C.

    Run it on every computer that stamps frames; one that runs an NTP server already need not. Exit code 0: stopped by
    Ctrl-C; 2: the port cannot be used.
    """
    from rigcal.sync.network import serve as answer

    stop = threading.Event()
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: stop.set())
    served = answer(address, port, stop=stop, on_ready=_ready)
    show(f"answered {served.answered} requests, ignored {served.ignored} packets that were none")


def _ready(places: tuple[str, ...]) -> None:
    show(f"telling the time at {', '.join(places)}; Ctrl-C stops")
