"""The command line of rigcal: each command parses, calls the library and prints.

Exit codes: 0 ok; 1 a check or gate failed; 2 usage or bad input. Known errors are one message on standard error, and
with ``--json`` also one object on standard output. Progress and logs go to standard error.
"""

from __future__ import annotations

import os
import sys

import typer

from rigcal.cli import calibrate, doctor, drift, files, target, world
from rigcal.cli._app import app, print_json
from rigcal.cli.sync import probe, report, serve, verify, video
from rigcal.errors import RigcalError

__all__ = [
    "app",
    "calibrate",
    "doctor",
    "drift",
    "files",
    "main",
    "probe",
    "report",
    "serve",
    "target",
    "verify",
    "video",
    "world",
]


def main() -> None:
    """Entry point of the console script; a known error becomes its message and exit code 2."""
    # Before numpy loads: the matrices here are small, and on a loaded machine threads of BLAS that wait for each other
    # made a calibration of four cameras take 52 s instead of 7.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        app()
    except RigcalError as error:
        typer.echo(f"error: {error}", err=True)
        if "--json" in sys.argv:
            fields = ("what", "where", "expected", "got", "do_next")
            print_json({"valid": False, "error": {name: getattr(error, name) for name in fields}})
        raise SystemExit(2) from None
