"""``recognition replay``: a recording's detections through the same placing as live, without its networks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import JsonOption, RecordingArgument, app, print_json
from recognition.cli._chosen import AssociationMethod, write_poses_of

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
    from recognition.replay import replay as replay_recording
    from recognition.sources.recording import open_recording

    opened = open_recording(recording)
    options, warnings = _options(opened, association)
    result = replay_recording(opened, options, smooth=smooth)
    if result.incomplete:
        warnings.append(f"{result.incomplete} instants lost the detections of a camera and were left out")
    if poses is not None:
        write_poses_of(result.scenes, opened.rig, poses)
    _tell(recording, opened, options, result, warnings, poses, as_json)


def _options(opened: RecordedRun, association: AssociationMethod | None) -> tuple[PlacingOptions, list[str]]:
    """What to place with, and why the tracks may not be those of the run."""
    from recognition.placing import PlacingOptions
    from recognition.replay import recorded_options

    warnings = list(opened.warnings)
    recorded = recorded_options(opened)
    if recorded is None:
        warnings.append("the recording does not say how it was placed: tracks may differ from the run's")
    chosen = recorded or PlacingOptions()
    if association is not None and association.value != chosen.method:
        chosen = PlacingOptions(method=association.value)
    return chosen, warnings


def _tell(
    recording: Path,
    opened: RecordedRun,
    options: PlacingOptions,
    result: ReplayResult,
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
                "scenes": len(result.scenes),
                "incomplete": result.incomplete,
                "warnings": warnings,
                "workers": {str(track): count for track, count in result.worker_instants.items()},
                "objects": result.object_instants,
            }
        )
        return
    typer.echo(f"{result.instants} instants, {len(result.scenes)} of them in 3D, rig {opened.rig.verdict}")
    for warning in warnings:
        typer.echo(f"warning: {warning}")
    for track, count in result.worker_instants.items():
        typer.echo(f"  worker {track}: seen in 3D at {count} instants")
    for name, count in result.object_instants.items():
        typer.echo(f"  {name}: seen in 3D at {count} instants")
    if poses is not None:
        typer.echo(f"poses     {poses}")
