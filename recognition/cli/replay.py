"""``recognition replay``: a recording through the same rules as live, by its tracks or by its detections."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import JsonOption, RecordingArgument, app, print_json
from recognition.cli._chosen import AssociationMethod, write_poses_of
from recognition.cli._evidence import evidence_folder, require_encoder, write_evidence
from recognition.cli._judged import event_lines, write_log
from recognition.cli._show import progress
from rigcal.errors import OptionsError

if TYPE_CHECKING:
    from recognition.judging import Rulebook
    from recognition.placing import PlacingOptions
    from recognition.replay import ReplayResult
    from recognition.sources.recording import RecordedRun


@dataclass(frozen=True, slots=True)
class _Replayed:
    """What there is to tell."""

    recording: Path
    opened: RecordedRun
    options: PlacingOptions
    """That the tracks were placed with."""
    smooth: bool
    rulebook: Rulebook | None
    result: ReplayResult
    how: str
    """How it compares with the run."""
    warnings: tuple[str, ...]


@app.command()
def replay(
    recording: RecordingArgument,
    poses: Annotated[Path | None, typer.Option(metavar="OUT.npz", help="Write every worker's joints in 3D.")] = None,
    rules: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Judge by this rule file [the one that the run was judged by].")
    ] = None,
    events: Annotated[Path | None, typer.Option(metavar="OUT.json", help="Write the violations found.")] = None,
    evidence: Annotated[
        bool, typer.Option("--evidence", help="Also write NAME.evidence/: videos and pictures of violations.")
    ] = False,
    association: Annotated[
        AssociationMethod | None,
        typer.Option(help="Another method than the run's, with the options that it has by default."),
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth every track by what came after; without it tracks are the run's.")
    ] = False,
    place: Annotated[
        bool,
        typer.Option("--place", help="Place from the detections, also where the recording holds tracks."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Judge the workers and objects in a recording again, by the rules of the run or by others.

    The tracks are the run's own, as it recorded them. With --place, --association or --smooth, and where the recording
    holds none, they are placed again from the detections, as the run did to the last bit. The events of the run's own
    rules are the run's. Nothing is written into the recording.

    IN.mcap is a file, the name NAME.mcap of the segments NAME.000.mcap and so on, or a folder with one recording.

    Exit code 0: done; 2: not a recording, one without detections, or a rule file with a mistake.
    """
    from recognition.judging import read_rulebook, recorded_rulebook, watch_of
    from recognition.replay import recorded_options
    from recognition.replay import replay as replay_recording
    from recognition.sources.recording import open_recording

    given = None if rules is None else read_rulebook(rules)
    opened = open_recording(recording)
    recorded = recorded_options(opened)
    options = _options(recorded, association)
    places = place or association is not None
    rulebook = given or recorded_rulebook(opened)
    _require(rulebook, options == recorded, events, evidence)
    watch = None
    if rulebook is not None:
        watch = watch_of(rulebook.rules, opened.rig, opened.metadata, opened.geometry_digest)
    with progress(None, quiet=as_json, label="replaying") as bar:
        result = replay_recording(
            opened,
            options if places else None,
            smooth=smooth,
            keep_scenes=poses is not None,
            watch=watch,
            progress=bar,
        )
    told = _Replayed(
        recording,
        opened,
        options,
        smooth,
        rulebook,
        result,
        _likeness(recorded, options, result) + (", smoothed" if smooth else ""),
        (*opened.warnings, *_lacking(recorded, result)),
    )
    written = _written(told, poses, events, evidence, quiet=as_json)
    _tell_json(told, written) if as_json else _tell(told, written)


def _require(rulebook: Rulebook | None, is_as_run: bool, events: Path | None, evidence: bool) -> None:
    """Refuse what there are no rules for, and evidence of other tracks than the pictures would show."""
    for name, value in (("--events", events), ("--evidence", evidence)):
        if value and rulebook is None:
            raise OptionsError(
                name,
                expected="--rules FILE beside it, since the run was judged by none",
                got="no --rules",
                do_next=f"add --rules FILE, or leave {name} out",
            )
    if evidence and not is_as_run:
        raise OptionsError(
            "--evidence",
            expected="tracks placed as the run did",
            got="another --association",
            do_next="leave --association or --evidence out",
        )
    if evidence:
        require_encoder()


def _options(recorded: PlacingOptions | None, association: AssociationMethod | None) -> PlacingOptions:
    """What to place with: the run's own options, unless another method is asked for."""
    from recognition.placing import PlacingOptions

    chosen = recorded or PlacingOptions()
    if association is None or association.value == chosen.method:
        return chosen
    return PlacingOptions(method=association.value)


def _likeness(recorded: PlacingOptions | None, options: PlacingOptions, result: ReplayResult) -> str:
    """Where the tracks are from, in words."""
    if not result.is_placed_again:
        return "the tracks that the run recorded" + (f", placed by the method {recorded.method}" if recorded else "")
    if recorded is None:
        return f"placed by the method {options.method}"
    if recorded != options:
        return f"placed by the method {options.method}, not the run's {recorded.method}"
    return f"placed as the run did, by the method {options.method}"


def _lacking(recorded: PlacingOptions | None, result: ReplayResult) -> list[str]:
    warnings = []
    if recorded is None and result.is_placed_again:
        warnings.append("the recording does not say how it was placed: tracks may differ from the run's")
    if result.incomplete:
        lost = "lost the detections of a camera" if result.is_placed_again else "are lost"
        warnings.append(f"{result.incomplete} instants {lost} and were left out")
    return warnings


def _written(
    told: _Replayed, poses: Path | None, events: Path | None, evidence: bool, *, quiet: bool
) -> dict[str, Path]:
    """Write what is wanted."""
    written: dict[str, Path] = {}
    result, rig = told.result, told.opened.rig
    if poses is not None:
        write_poses_of(result.scenes, rig, poses)
        written["poses"] = poses
    if told.rulebook is not None and events is not None:
        write_log(
            events,
            recording=told.recording,
            rules=told.rulebook.rules,
            rig=rig,
            geometry_digest=told.opened.geometry_digest,
            metadata=told.opened.metadata,
            association=told.options.method,
            smoothed=told.smooth,
            monitoring=result.statuses,
            events=result.events,
        )
        written["events_file"] = events
    if evidence:
        rules = told.rulebook.rules if told.rulebook else None
        write_evidence(told.recording, result.events, rules=rules, quiet=quiet)
        written["evidence"] = evidence_folder(told.recording)
    return written


def _tell_json(told: _Replayed, written: dict[str, Path]) -> None:
    from recognition.events import event_document

    result, rules = told.result, told.rulebook.rules if told.rulebook else None
    print_json(
        {
            "recording": str(told.recording),
            "files": [str(file) for file in told.opened.files],
            **{name: str(written[name]) if name in written else None for name in ("poses", "events_file", "evidence")},
            "verdict": told.opened.rig.verdict,
            "association": told.options.method,
            "instants": result.instants,
            "how": told.how,
            "placed_again": result.is_placed_again,
            "scenes": result.placed,
            "incomplete": result.incomplete,
            "warnings": list(told.warnings),
            "workers": {str(track): count for track, count in result.worker_instants.items()},
            "objects": dict(result.object_instants),
            "monitoring": dict(result.statuses),
            "rules": {"name": rules.name, "digest": rules.digest} if rules else None,
            "events": [event_document(event) for event in result.events],
        }
    )


def _tell(told: _Replayed, written: dict[str, Path]) -> None:
    result = told.result
    typer.echo(f"{result.instants} instants, {result.placed} of them in 3D, rig {told.opened.rig.verdict}; {told.how}")
    for warning in told.warnings:
        typer.echo(f"warning: {warning}")
    for track, count in result.worker_instants.items():
        typer.echo(f"  worker {track}: seen in 3D at {count} instants")
    for name, count in result.object_instants.items():
        typer.echo(f"  {name}: seen in 3D at {count} instants")
    for line in event_lines(result.events, told.rulebook.rules, result.start_ns) if told.rulebook else ():
        typer.echo(line)
    for name, path in written.items():
        typer.echo(f"{name.removesuffix('_file'):<9} {path}")
