"""``recognition replay``: a recording's detections through the same placing as live, without its networks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import JsonOption, RecordingArgument, app, print_json
from recognition.cli._chosen import AssociationMethod, write_poses_of
from recognition.cli._show import progress

if TYPE_CHECKING:
    from recognition.placing import PlacingOptions
    from recognition.replay import ReplayResult
    from recognition.sources.recording import RecordedRun


@app.command()
def replay(
    recording: RecordingArgument,
    poses: Annotated[Path | None, typer.Option(metavar="OUT.npz", help="Write every worker's joints in 3D.")] = None,
    association: Annotated[
        AssociationMethod | None,
        typer.Option(help="Another method than the run's, with the options that it has by default."),
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth every track by what came after; without it tracks are the run's.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Place workers and objects again from the detections in a recording, to the last bit as the run did.

    IN.mcap is a file, the name NAME.mcap of the segments NAME.000.mcap and so on, or a folder with one recording.

    Exit code 0: done; 2: not a recording, or one without detections.
    """
    from recognition.replay import recorded_options
    from recognition.replay import replay as replay_recording
    from recognition.sources.recording import open_recording

    opened = open_recording(recording)
    recorded = recorded_options(opened)
    options = _options(recorded, association)
    with progress(None, quiet=as_json, label="placing") as bar:
        result = replay_recording(opened, options, smooth=smooth, keep_scenes=poses is not None, progress=bar)
    if poses is not None:
        write_poses_of(result.scenes, opened.rig, poses)
    warnings = list(opened.warnings)
    if recorded is None:
        warnings.append("the recording does not say how it was placed: tracks may differ from the run's")
    if result.incomplete:
        warnings.append(f"{result.incomplete} instants lost the detections of a camera and were left out")
    how = _likeness(recorded, options) + (", smoothed" if smooth else "")
    _tell(recording, opened, options, result, how, warnings, poses, as_json)


def _options(recorded: PlacingOptions | None, association: AssociationMethod | None) -> PlacingOptions:
    """What to place with: the run's own options, unless another method is asked for."""
    from recognition.placing import PlacingOptions

    chosen = recorded or PlacingOptions()
    if association is None or association.value == chosen.method:
        return chosen
    return PlacingOptions(method=association.value)


def _likeness(recorded: PlacingOptions | None, options: PlacingOptions) -> str:
    """How what was placed compares with the run, in words."""
    if recorded is None:
        return f"placed by the method {options.method}"
    if recorded != options:
        return f"placed by the method {options.method}, not the run's {recorded.method}"
    return f"placed as the run did, by the method {options.method}"


def _tell(
    recording: Path,
    opened: RecordedRun,
    options: PlacingOptions,
    result: ReplayResult,
    how: str,
    warnings: list[str],
    poses: Path | None,
    as_json: bool,
) -> None:
    if as_json:
        print_json(
            {
                "recording": str(recording),
                "files": [str(file) for file in opened.files],
                "poses": str(poses) if poses else None,
                "verdict": opened.rig.verdict,
                "association": options.method,
                "instants": result.instants,
                "how": how,
                "scenes": result.placed,
                "incomplete": result.incomplete,
                "warnings": warnings,
                "workers": {str(track): count for track, count in result.worker_instants.items()},
                "objects": dict(result.object_instants),
            }
        )
        return
    typer.echo(f"{result.instants} instants, {result.placed} of them in 3D, rig {opened.rig.verdict}; {how}")
    for warning in warnings:
        typer.echo(f"warning: {warning}")
    for track, count in result.worker_instants.items():
        typer.echo(f"  worker {track}: seen in 3D at {count} instants")
    for name, count in result.object_instants.items():
        typer.echo(f"  {name}: seen in 3D at {count} instants")
    if poses is not None:
        typer.echo(f"poses     {poses}")
