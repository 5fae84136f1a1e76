"""The command line of recognition: each command parses, calls the library and prints.

Exit codes: 0 ok; 1 a check failed; 2 usage or bad input; 3 data was lost. Known errors are one message on standard
error, and with ``--json`` also one object on standard output.
"""

from __future__ import annotations

import os
import sys

import typer

from recognition.cli import (
    answers,
    batch,
    commission,
    demo,
    evaluate,
    evidence,
    recordings,
    render,
    replay,
    retention,
    rules,
    run,
)
from recognition.cli._app import app, print_json
from rigcal.errors import RigcalError

__all__ = [
    "answers",
    "app",
    "batch",
    "commission",
    "demo",
    "evaluate",
    "evidence",
    "main",
    "recordings",
    "render",
    "replay",
    "retention",
    "rules",
    "run",
]


def main() -> None:
    """Entry point of the console script; a known error becomes its message and exit code 2."""
    # Before numpy loads, as for rigcal: the matrices are small, and threads of BLAS would take the cameras' processors.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        app()
    except RigcalError as error:
        typer.echo(f"error: {error}", err=True)
        if "--json" in sys.argv:
            fields = ("what", "where", "expected", "got", "do_next")
            print_json({"ok": False, "error": {name: getattr(error, name) for name in fields}})
        raise SystemExit(2) from None
