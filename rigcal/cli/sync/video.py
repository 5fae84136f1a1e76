"""Clocks from what the cameras saw, into the rig file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli._app import BoardOption, CaptureArgument, JsonOption, print_json, show
from rigcal.cli.sync._app import OutputOption, clock_gates_of, show_failed_gates, sync_app, write_clocks
from rigcal.cli.sync._content import By, compare, content_of, decides, readouts

if TYPE_CHECKING:
    from rigcal.cli.sync._content import Content
    from rigcal.rigdocument import RigDocument
    from rigcal.sync.content.lags import CameraLag, ContentLags


@sync_app.command()
def video(
    capture: CaptureArgument,
    rig: Annotated[
        Path | None, typer.Option("--rig", metavar="RIG", help="Rig file that the clocks belong to.")
    ] = None,
    by: Annotated[By, typer.Option("--by", help="What to compare.")] = By.AUTO,
    board: BoardOption = None,
    detections: Annotated[
        Path | None, typer.Option("--detections", metavar="FILE.npz", help="2D joints of people, per instant and view.")
    ] = None,
    readout: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MS", help="Readout time where known: 20ms or CAMERA=20ms; 0ms: global shutter. Repeatable."
        ),
    ] = None,
    timestamps: Annotated[
        bool, typer.Option("--timestamps", help="Videos without stamps: write their times as CAPTURE/timestamps.csv.")
    ] = False,
    output: OutputOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the clocks from what the cameras saw.

    That is a board that moves, people (--detections), or a light that is switched on and off a few times. Unlike a
    probe this sees the whole chain, the camera's own latency too. Offsets are relative to the rig's
    reference camera. Without --rig whole frames are compared by a light or the motion, and nothing is written.

    Exit code 0: the clock of every camera was decided; 1: some were not (the others are written); 2: bad input.
    """
    from rigcal.cli._rigviews import board_of_rig
    from rigcal.rigfile import read_rigfile

    document = read_rigfile(rig) if rig is not None else None
    content = content_of(capture, document)
    if document is not None:
        content = replace(
            content,
            board=board_of_rig(board, document) if board or by is By.BOARD else content.board,
            detections=detections,
            readout_s=readouts(readout, document.camera_ids),
        )
    lags = compare(content, by)
    written, path = None, output or rig
    if document is not None and path is not None and decides(lags) and lags.method != "motion energy":
        written = _write(document, lags, path)
    table = _write_timestamps(content) if timestamps else None
    if as_json:
        print_json(_as_json(lags, content, written, path, table))
    else:
        _show(lags, content, written, path, table)
    raise typer.Exit(0 if all(camera.confident for camera in lags.cameras) else 1)


def _write(document: RigDocument, lags: ContentLags, path: Path) -> RigDocument:
    from rigcal.sync.record import clock_limits, clocks_of_content

    return write_clocks(
        document, list(clocks_of_content(lags, document)), clock_limits(document, None), "sync video", path
    )


def _write_timestamps(content: Content) -> Path | None:
    """Stamps of videos that hold none but their own, so that every command groups frames by the clocks."""
    from rigcal.rigfile import write_atomically
    from rigcal.stamps import TIMESTAMPS

    if content.stamps.shared:
        return None
    path = content.capture.path / TIMESTAMPS
    rows = [
        f"{camera.id},{t:.9f}"
        for camera, times in zip(content.capture.cameras, content.stamps.times_s, strict=True)
        for t in times.tolist()
    ]
    write_atomically(path, "\n".join(["cam_id,frame_time", *rows]) + "\n")
    return path


def _as_json(
    lags: ContentLags, content: Content, written: RigDocument | None, path: Path | None, table: Path | None
) -> dict[str, Any]:
    clocks = {c.id: c.clock.model_dump() for c in written.cameras if c.clock} if written else {}
    return {
        "method": lags.method,
        "reference": lags.reference,
        "stamps": content.stamps.rule,
        "residual_s": lags.residual_s,
        "cameras": [_camera(camera) for camera in lags.cameras],
        "rig_file": str(path) if written else None,
        "clocks": clocks,
        "gates": clock_gates_of(written) if written else [],
        "timestamps": str(table) if table else None,
    }


def _camera(camera: CameraLag) -> dict[str, Any]:
    names = (
        *("confident", "reason", "offset_s", "at_s", "bound_s"),
        *("drift_ppm", "drift_bound_ppm", "readout_s", "readout_sigma_s"),
    )
    values = {name: getattr(camera, name) for name in names}
    known = {name: None if isinstance(v, float) and not math.isfinite(v) else v for name, v in values.items()}
    return {"id": camera.camera_id} | known


def _show(
    lags: ContentLags, content: Content, written: RigDocument | None, path: Path | None, table: Path | None
) -> None:
    from rigcal.report.text import plain
    from rigcal.report.text import table as rows_of

    what = {"board": "a moving board", "people": "people", "light": "a light", "motion energy": "motion, whole frames"}
    show(
        plain(f"Offsets to add to the stamps ({content.stamps.rule}), by {what[lags.method]}, beside {lags.reference}")
    )
    show(rows_of(["camera", "offset, ms", "drift, ppm", "readout, ms"], [_row(c) for c in lags.cameras], left=(0,)))
    for camera in lags.cameras:
        if camera.reason:
            show(plain(f"{camera.camera_id}: {camera.reason}"))
    if written is not None:
        show_failed_gates(written)
        show(f"rig file {path}: {written.verdict}")
    else:
        show("no file written")
    if table is not None:
        show(f"stamps {table}")
    elif written is not None and not content.stamps.shared:
        show(
            "These videos hold no stamps but their own frame times: the clocks serve this capture only, and only with "
            "its timestamps.csv, which --timestamps writes."
        )


def _row(camera: CameraLag) -> list[str]:
    from rigcal.report.numbers import ABSENT, fixed, scaled
    from rigcal.report.text import plain

    if not camera.confident:
        return [plain(camera.camera_id), "not decided", ABSENT, ABSENT]
    return [
        plain(camera.camera_id),
        f"{scaled(camera.offset_s, 1e3, 3)} +- {scaled(camera.bound_s, 1e3, 3)}",
        f"{fixed(camera.drift_ppm)} +- {fixed(camera.drift_bound_ppm)}",
        _readout(camera),
    ]


def _readout(camera: CameraLag) -> str:
    """The readout in milliseconds, with three sigma where it was estimated."""
    from rigcal.report.numbers import scaled

    told = scaled(camera.readout_s, 1e3, 1)
    return told if camera.readout_sigma_s is None else f"{told} +- {scaled(3 * camera.readout_sigma_s, 1e3, 1)}"
