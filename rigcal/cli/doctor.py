"""The command that looks at the machine."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import typer

from rigcal.cli._app import JsonOption, app, print_json, show


@app.command()
def doctor(as_json: JsonOption = False) -> None:
    """Check this machine: packages, engines, codecs, disk and clock; each with what to do next.

    Exit code 0: nothing failed; 1: something did.
    """
    from rigcal.doctor import examine_machine, healthy

    checks = examine_machine(Path.cwd(), datetime.now(UTC))
    if as_json:
        print_json({"healthy": healthy(checks), "checks": [asdict(check) for check in checks]})
    else:
        width = max(len(check.name) for check in checks)
        for check in checks:
            show(f"{check.status:<8} {check.name:<{width}}  {check.detail}")
            if check.do_next:
                show(f"{'':<8} {'':<{width}}  do next: {check.do_next}")
    raise typer.Exit(0 if healthy(checks) else 1)
