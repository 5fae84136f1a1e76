"""``recognition demo``: the demo site recognised, judged and shown, beside the truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import app
from recognition.cli.render import render
from recognition.cli.run import run
from recognition.errors import SourceError

if TYPE_CHECKING:
    from recognition.evaluation.found import Findings, Sought
    from recognition.events import Event

SITE = Path(__file__).resolve().parents[2] / "rig_configs" / "demo"
"""Of a checkout; an installed package is without it."""


@app.command()
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Where everything goes.")] = Path(
        "out/recognition-demo"
    ),
) -> None:
    """Recognise the demo site of a checkout: record, judge, render, and say what was found beside the truth.

    A simulated site, 30 seconds of four cameras: its rig is calibrated, its rules are rig_configs/site.rules.toml.
    The calibration and the clocks are shown by `make demo`.

    Exit code 0: done, whatever was found; 2: this is not a checkout.
    """
    from recognition.evaluation.found import compare_events
    from recognition.evaluation.violations import read_violations
    from recognition.events import read_events

    rig, work, rules = SITE / "demo.rig.json", SITE / "work", SITE.parent / "site.rules.toml"
    _require_site(rig, work, rules)
    recording, events, video = (output / name for name in ("demo.mcap", "demo.events.json", "demo.mp4"))
    _say(f"recognition run {rig} --source {work} -o {recording} --rules {rules} --events {events} --evidence")
    try:
        run(rig, recording, source=[str(work)], rules=rules, events=events, evidence=True)
    except typer.Exit as ended:
        if ended.exit_code:
            raise
    _say(f"recognition render {recording} -o {video}")
    render(recording, video)
    _say("beside the truth")
    truth = read_violations(work)
    for line in _lines(compare_events(truth, read_events(events).events), truth.epoch_ns):
        typer.echo(line)


def _require_site(*parts: Path) -> None:
    missing = [part for part in parts if not part.exists()]
    if missing:
        raise SourceError(
            "the demo site is not here",
            where=SITE,
            expected=f"{', '.join(part.name for part in parts)}, which a checkout of the repository has",
            got=f"no {', '.join(part.name for part in missing)}",
            do_next="run it in a checkout, or on a capture of your own: recognition run RIG --source CAPTURE",
        )


def _say(words: str) -> None:
    typer.echo(f"\n== {words}")


def _lines(found: Findings, epoch_ns: int) -> Iterator[str]:
    yield f"{found.in_time} of {len(found.sought)} violations found within 1 s of their start, {len(found.false)} false"
    yield from (f"  {_sought(one)}" for one in found.sought)
    yield from (f"  {_false(event, epoch_ns)}" for event in found.false)


def _sought(one: Sought) -> str:
    when = f"{one.kind}, {one.stretch.start_s:.1f} s to {one.stretch.end_s:.1f} s: "
    if one.delay_s is None:
        return f"{when}MISSED"
    side = "after" if one.delay_s >= 0 else "before"
    late = "" if one.is_in_time else "NOT IN TIME, "
    return f"{when}{late}raised {abs(one.delay_s):.2f} s {side} its start"


def _false(event: Event, epoch_ns: int) -> str:
    from recognition.events import actors_text

    after_s = (event.start_ns - epoch_ns) * 1e-9
    return f"FALSE {event.rule} at {after_s:.1f} s ({actors_text(event)})"
