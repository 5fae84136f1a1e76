"""``recognition rules``: whether a rule file is sound, what it says, and why a rule was true in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recognition.cli._app import JsonOption, app, print_json
from rigcal.errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recognition.events import Watch
    from recognition.observations import Scene
    from recognition.rules import BindingExplanation, Explanation, Rule, RuleSet

rules_app = typer.Typer(
    help="Check and explain rule files (NAME.rules.toml).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(rules_app, name="rules")


@rules_app.command()
def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Rule files.")], as_json: JsonOption = False
) -> None:
    """Read rule files, and say of each what is wrong with it, with line and column.

    Exit code 0: all are sound; 2: one is not.
    """
    from recognition.errors import RulesError
    from recognition.rules import load_rules

    documents: list[dict[str, Any]] = []
    for file in files:
        try:
            rules = load_rules(file)
        except RulesError as error:
            fields = ("what", "where", "expected", "got", "do_next", "line", "column")
            documents.append({"file": str(file), "ok": False} | {name: getattr(error, name) for name in fields})
            if not as_json:
                typer.echo(f"error: {error}", err=True)
            continue
        names = [rule.name for rule in rules.rules]
        documents.append({"file": str(file), "ok": True, "digest": rules.digest, "rules": names})
        if not as_json:
            floor = "needs the floor" if rules.needs_floor else "runs without a floor"
            typer.echo(f"OK  {file}: {', '.join(names)}; {floor}; {rules.digest}")
    is_ok = all(document["ok"] for document in documents)
    if as_json:
        print_json({"ok": is_ok, "files": documents})
    raise typer.Exit(0 if is_ok else 2)


@rules_app.command()
def explain(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A rule file.")],
    recording: Annotated[Path | None, typer.Argument(metavar="[IN.mcap]", help="A recording, to judge again.")] = None,
    at: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Time after the recording's first instant.")
    ] = None,
    event: Annotated[
        str | None, typer.Option(metavar="EVENT_ID", help="The instant at which these rules raised this event.")
    ] = None,
    only: Annotated[str | None, typer.Option("--rule", metavar="NAME", help="One rule alone.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Say every rule of a file in sentences; with a recording, why it was true, false or unknown, term by term.

    Exit code 0: done; 1: the recording has no such instant or event; 2: bad input.
    """
    from recognition.rules import load_rules

    rules = load_rules(file)
    chosen = _chosen(rules, only)
    if recording is None:
        _require(at is None and event is None, "--at", "a recording beside it", "none")
        _tell_sentences(rules, chosen, as_json)
        return
    _require((at is None) != (event is None), "--at", "either --at or --event", "both" if event else "neither")
    found = _watched(rules, recording, at, event)
    if found is None:
        wanted = f"instant at {at:g} s" if at is not None else f"event {event} by these rules"
        typer.echo(f"error: {recording} has no {wanted}", err=True)
        raise typer.Exit(1)
    watch, scene, start_ns = found
    _tell_reasons(chosen, watch, scene, start_ns, as_json)


def _require(holds: bool, option: str, expected: str, got: str) -> None:
    if not holds:
        raise OptionError(option, expected=expected, got=got)


def _chosen(rules: RuleSet, only: str | None) -> Sequence[Rule]:
    names = [rule.name for rule in rules.rules]
    _require(only is None or only in names, "--rule", f"one of {', '.join(names)}", str(only))
    return [rule for rule in rules.rules if only in (None, rule.name)]


def _tell_sentences(rules: RuleSet, chosen: Sequence[Rule], as_json: bool) -> None:
    from recognition.rules.sentences import described

    texts = {rule.name: list(described(rule, rules)) for rule in chosen}
    if as_json:
        print_json({"digest": rules.digest, "rules": texts})
        return
    for rule in chosen:
        typer.echo(f"{rule.name}: {rule.sentence}")
        for text in texts[rule.name]:
            typer.echo(f"  {text}")


def _watched(rules: RuleSet, recording: Path, at: float | None, event: str | None) -> tuple[Watch, Scene, int] | None:
    """Judge a recording up to an instant: the last one not later than ``at``, or the one that raised an event."""
    from recognition.judging import watch_of
    from recognition.replay import tracked_again
    from recognition.sources.recording import open_recording

    opened = open_recording(recording)
    watch = watch_of(rules, opened.rig, opened.metadata, opened.geometry_digest)
    start_ns: int | None = None
    last: Scene | None = None
    for scene in (instant.scene for instant in tracked_again(opened)):
        start_ns = scene.t_ns if start_ns is None else start_ns
        if at is not None and scene.t_ns - start_ns > at * 1e9:
            return None if last is None else (watch, last, start_ns)
        _, events = watch.step(scene)
        last = scene
        if event is not None and event in [found.event_id for found in events]:
            return watch, scene, start_ns
    if at is None or last is None or start_ns is None or last.t_ns - start_ns < at * 1e9 - 1e9:
        return None
    return watch, last, start_ns


def _tell_reasons(chosen: Sequence[Rule], watch: Watch, scene: Scene, start_ns: int, as_json: bool) -> None:
    after_s = (scene.t_ns - start_ns) * 1e-9
    why = {rule.name: watch.judge.explain(rule.name) for rule in chosen}
    if as_json:
        reasons = {name: [_binding(found) for found in bindings] for name, bindings in why.items()}
        print_json({"t_ns": scene.t_ns, "after_s": after_s, "status": scene.status, "rules": reasons})
        return
    typer.echo(f"{after_s:.3f} s after the first instant, {scene.status}")
    for rule in chosen:
        typer.echo(f"{rule.name}: {rule.sentence}")
        for found in why[rule.name]:
            _tell_binding(found, start_ns)


def _tell_binding(found: BindingExplanation, start_ns: int) -> None:
    verdict = found.verdict
    whom = ", ".join(f"{actor.role} = {actor.kind} {actor.track_id}" for actor in verdict.actors) or "the site"
    state = "not violated"
    if verdict.is_active and verdict.since_ns is not None:
        state = f"violated since {(verdict.since_ns - start_ns) * 1e-9:.2f} s"
    elif verdict.since_ns is not None:
        state = f"may be violated since {(verdict.since_ns - start_ns) * 1e-9:.2f} s"
    typer.echo(f"  {whom}: {state}")
    if found.why is None:
        typer.echo("    unknown: not in the scene")
    else:
        for line in found.why.lines(2):
            typer.echo(line)


def _binding(found: BindingExplanation) -> dict[str, Any]:
    verdict = found.verdict
    return {
        "actors": [actor._asdict() for actor in verdict.actors],
        "truth": verdict.truth,
        "is_active": verdict.is_active,
        "since_ns": verdict.since_ns,
        "why": None if found.why is None else _reason(found.why),
    }


def _reason(why: Explanation) -> dict[str, Any]:
    return {
        "text": why.text,
        "truth": why.truth,
        "margin": None if why.truth is None else why.margin,
        "detail": why.detail,
        "parts": [_reason(part) for part in why.parts],
    }
