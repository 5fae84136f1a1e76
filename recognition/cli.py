"""The command line of recognition: each command parses, calls the library and prints.

Exit codes: 0 ok; 1 a check failed; 2 usage or bad input; 3 data was lost. Known errors are one message on standard
error, and with ``--json`` also one object on standard output.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recognition.errors import RigRefusedError
from rigcal.errors import RigcalError, writing

if TYPE_CHECKING:
    from recognition.detectors import Detector, ModelInfo
    from recognition.feeds import Feed
    from recognition.recording import Recorded
    from recognition.runtime import RunResult
    from rigcal.rig import Rig

app = typer.Typer(
    help="Recognise workers and objects in 3D with a calibrated rig, and record everything to MCAP.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=False,
)

DEFAULT_FPS = 30.0
"""Frame rate of image folders and detections that hold no times, where --fps and the rig file say nothing."""


class AssociationMethod(StrEnum):
    """How detections of different views are matched."""

    paper = "paper"


JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
RecordingArgument = Annotated[Path, typer.Argument(metavar="IN.mcap", help="A recording.")]


@app.callback()
def _program() -> None:
    """Recognise workers and objects in 3D with a calibrated rig, and record everything to MCAP."""


@app.command()
def run(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file, NAME.rig.json.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.mcap", help="The recording to write.")],
    source: Annotated[
        Path | None, typer.Option(metavar="CAPTURE", help="Folder with a video or a folder of images per camera.")
    ] = None,
    detections: Annotated[
        Path | None, typer.Option(metavar="FILE.npz", help="2D detections, instead of networks.")
    ] = None,
    object_model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Network of objects' boxes instead of the bundled one, .onnx or its .toml manifest.",
        ),
    ] = None,
    pose_model: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Network of people's joints instead of the bundled one, .onnx or its .toml."),
    ] = None,
    poses: Annotated[
        Path | None, typer.Option(metavar="OUT.npz", help="Also write every worker's joints in 3D.")
    ] = None,
    views: Annotated[str | None, typer.Option(metavar="cam0,cam2", help="Use only these cameras of the rig.")] = None,
    association: Annotated[
        AssociationMethod, typer.Option(help="How detections of different views are matched.")
    ] = AssociationMethod.paper,
    fps: Annotated[
        float | None,
        typer.Option(min=0.001, help="Frame rate where the images or detections hold no times [rig file's, else 30]."),
    ] = None,
    interpolate: Annotated[
        bool,
        typer.Option(
            "--interpolate", help="Move detections to the instants' common times; for cameras not triggered together."
        ),
    ] = False,
    realtime: Annotated[bool, typer.Option("--realtime", help="Pace files at their capture time.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Track workers and objects in 3D over a capture, and record frames, detections and scenes.

    Frames without --detections are looked at by the networks that come with the package; --pose-model replaces their
    people, --object-model their objects.

    Exit code 0: done; 2: bad input, or a rig file that must not be run.
    """
    from recognition.feeds import FeedOptions, open_feed
    from recognition.recording import Recorder
    from recognition.runtime import RunOptions
    from recognition.runtime import run as run_instants
    from rigcal.rigfile import read_rigfile, rig_of

    document = read_rigfile(rig)
    loaded = rig_of(document)
    _require_runnable(rig, loaded)
    use = _used(loaded, views)
    known = document.extensions.get("rigcal")
    declared = known.get("fps") if isinstance(known, dict) else None
    rate = fps or (float(declared) if isinstance(declared, (int, float)) else DEFAULT_FPS)
    detector = _detector(object_model, pose_model, needed=source is not None and detections is None)
    feed = open_feed(loaded, source, detections, detector, FeedOptions(use, rate, interpolate))
    networks = detector.model_info if detector else ()
    notices = _notices(networks)
    metadata = {
        "association": association.value,
        "views": ",".join(camera_id for camera_id, wanted in zip(loaded.camera_ids, use, strict=True) if wanted),
        "interpolate": str(interpolate).lower(),
        **feed.facts,
        **({"sync": json.dumps(feed.sync.document, ensure_ascii=False)} if feed.sync else {}),
        **{f"model.{m.family}": f"{m.name} {m.sha256}" for m in networks},
        **{f"notice.{m.family}": m.notice for m in networks if m.notice},
    }
    with writing(output):
        recorder = Recorder(output, rig=loaded, rig_json=rig.read_bytes(), metadata=metadata)
        with recorder, _progress(feed.total, quiet=as_json) as progress, _stop_on_interrupt() as stop:
            for warning in (*feed.warnings, *notices):
                recorder.log("warning", warning, feed.start_ns)
            options = RunOptions(realtime=realtime)
            result = run_instants(loaded, feed.instants, recorder, options, progress=progress, stop=stop)
        recorded = recorder.close()
    if poses is not None:
        _write_poses(result, loaded, poses)
    _tell(loaded, result, recorded, feed, notices, poses, as_json)


@app.command()
def check(recording: RecordingArgument, as_json: JsonOption = False) -> None:
    """Read every byte of a recording: checksums, index, times, rig, calibration.

    Exit code 0: sound; 1: an error was found; 2: not a recording.
    """
    from recognition.recording import check_recording

    found = check_recording(recording)
    if as_json:
        _print_json(
            {
                "recording": str(recording),
                "ok": found.ok,
                "bytes": found.bytes,
                "duration_s": found.duration_s,
                "messages": dict(found.messages),
                "findings": [{"severity": f.severity, "text": f.text} for f in found.findings],
            }
        )
    else:
        typer.echo(f"{'OK' if found.ok else 'DAMAGED'}  {recording}")
        typer.echo(f"{sum(found.messages.values())} messages, {found.duration_s:.2f} s, {found.bytes / 1e6:.1f} MB")
        for topic, count in found.messages.items():
            typer.echo(f"  {count:8d}  {topic}")
        for finding in found.findings:
            typer.echo(f"{finding.severity}: {finding.text}")
    raise typer.Exit(0 if found.ok else 1)


@app.command()
def recover(
    recording: Annotated[Path, typer.Argument(metavar="IN.mcap", help="A killed or damaged recording, or its .part.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.mcap", help="The recording to write.")],
    as_json: JsonOption = False,
) -> None:
    """Copy everything sound of a recording into a new one; the source is only read.

    Exit code 0: nothing was lost; 3: something was, and how much is said; 2: nothing can be read.
    """
    from recognition.recording import recover_recording

    with writing(output):
        found = recover_recording(recording, output)
    if as_json:
        _print_json(
            {
                "recording": str(output),
                "lost": found.lost,
                "messages": dict(found.messages),
                "missing": dict(found.missing),
                "bytes_discarded": found.bytes_discarded,
                "losses": list(found.losses),
                "last_ns": found.last_ns,
            }
        )
    else:
        typer.echo(f"kept {sum(found.messages.values())} messages in {output}")
        for loss in found.losses:
            typer.echo(f"lost: {loss}")
    raise typer.Exit(3 if found.lost else 0)


def _require_runnable(path: Path, rig: Rig) -> None:
    if rig.verdict == "RECAPTURE":
        raise RigRefusedError(
            "this rig file failed its gates, and positions computed with it would be wrong",
            where=path,
            expected="verdict PASS or IMPORTED",
            got=f"verdict {rig.verdict}",
            do_next=f"see what to capture again: rigcal validate {path}",
        )


def _used(rig: Rig, views: str | None) -> tuple[bool, ...]:
    """(V,) which cameras are wanted."""
    if views is None:
        return (True,) * len(rig.cameras)
    wanted = [name.strip() for name in views.split(",") if name.strip()]
    unknown = [name for name in wanted if name not in rig.camera_ids]
    if unknown or not wanted:
        raise RigRefusedError(
            f"the rig has no camera {', '.join(unknown) or '(none given)'}",
            where="--views",
            expected=f"some of {','.join(rig.camera_ids)}",
            got=repr(views),
            do_next="name cameras as the rig file does, with commas between them",
        )
    return tuple(camera_id in wanted for camera_id in rig.camera_ids)


def _detector(object_model: Path | None, pose_model: Path | None, *, needed: bool) -> Detector | None:
    if not needed:
        return None
    from recognition.detectors import load_bundled, load_detector

    if object_model is not None and pose_model is not None:
        return load_detector(object_model, pose_model)
    bundled = load_bundled()
    if object_model is None and pose_model is None:
        return bundled
    return load_detector(object_model, pose_model, rest=bundled)


def _notices(networks: Sequence[ModelInfo]) -> tuple[str, ...]:
    """What whoever uses the result must know of its networks, each once with the files that it is of."""
    texts = dict.fromkeys(network.notice for network in networks if network.notice)
    return tuple(
        f"{', '.join(network.name for network in networks if network.notice == text)} (bundled): {text}"
        for text in texts
    )


def _write_poses(result: RunResult, rig: Rig, path: Path) -> None:
    from recognition.poses import Poses, write_poses

    with writing(path):
        write_poses(Poses.of(result.scenes, rig.world_from_rig), path)


def _tell(
    rig: Rig,
    result: RunResult,
    recorded: Recorded,
    feed: Feed,
    notices: Sequence[str],
    poses: Path | None,
    as_json: bool,
) -> None:
    if as_json:
        _print_json(
            {
                "recording": str(recorded.path),
                "poses": str(poses) if poses else None,
                "verdict": rig.verdict,
                "instants": result.instants,
                "scenes": len(result.scenes),
                "stopped": result.stopped,
                "rule": feed.facts,
                "sync": feed.sync.document if feed.sync else None,
                "warnings": list(feed.warnings),
                "notices": list(notices),
                "people_detected": dict(result.detections),
                "workers": {str(track): count for track, count in result.worker_instants.items()},
                "objects": result.object_instants,
                "messages": dict(recorded.messages),
                "bytes": recorded.bytes,
            }
        )
        return
    if result.stopped:
        typer.echo("stopped by the keyboard: everything up to here is in the recording")
    facts = ", ".join(f"{k} {v}" for k, v in feed.facts.items())
    typer.echo(f"{result.instants} instants, {len(result.scenes)} of them in 3D ({facts}), rig {rig.verdict}")
    for line in feed.sync.lines() if feed.sync else ():
        typer.echo(line)
    for warning in feed.warnings:
        typer.echo(f"warning: {warning}")
    for notice in notices:
        typer.echo(f"notice: {notice}")
    typer.echo("people detected  " + ", ".join(f"{c} {n}" for c, n in result.detections.items()))
    for track, count in result.worker_instants.items():
        typer.echo(f"  worker {track}: seen in 3D at {count} instants")
    for name, count in result.object_instants.items():
        typer.echo(f"  {name}: seen in 3D at {count} instants")
    typer.echo(f"recording {recorded.path} ({recorded.bytes / 1e6:.1f} MB, open it in Foxglove)")
    if poses is not None:
        typer.echo(f"poses     {poses}")


@contextmanager
def _stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed: asked between instants, so that no message is cut in the middle."""
    pressed: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: pressed.append(number))
    try:
        yield lambda: bool(pressed)
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _progress(total: int, *, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """A progress bar on standard error, on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = (TextColumn("recognising"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)


def _print_json(value: dict[str, Any]) -> None:
    typer.echo(json.dumps(value, ensure_ascii=False))


def main() -> None:
    """Entry point of the console script; a known error becomes its message and exit code 2."""
    try:
        app()
    except RigcalError as error:
        typer.echo(f"error: {error}", err=True)
        if "--json" in sys.argv:
            fields = ("what", "where", "expected", "got", "do_next")
            _print_json({"ok": False, "error": {name: getattr(error, name) for name in fields}})
        raise SystemExit(2) from None
