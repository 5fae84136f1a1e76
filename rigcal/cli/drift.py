"""Which camera moved since the calibration, and placing it again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli._app import (
    BoardOption,
    CacheOption,
    CaptureArgument,
    JsonOption,
    RigArgument,
    app,
    now_utc,
    print_json,
    show,
    write_report,
)
from rigcal.cli._rigviews import board_of_rig, views_of_rig
from rigcal.errors import writing

if TYPE_CHECKING:
    from rigcal.drift import CameraDrift, Drift
    from rigcal.rigdocument import RigDocument


@app.command()
def drift(
    rig: RigArgument,
    capture: CaptureArgument,
    board: BoardOption = None,
    limit_px: Annotated[
        float, typer.Option("--limit-px", metavar="PIXELS", help="Shift in a camera's image that is tolerated.")
    ] = 0.5,
    resolve: Annotated[
        bool, typer.Option("--resolve", help="Place the cameras that moved again, all others held; needs -o.")
    ] = False,
    moved: Annotated[
        list[str] | None,
        typer.Option(metavar="CAMERA", help="A camera known to have moved, where the views cannot tell; repeatable."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="OUT.rig.json", help="The rig file to write.")
    ] = None,
    cache: CacheOption = True,
    as_json: JsonOption = False,
) -> None:
    """Say from new board views which camera moved since the calibration, by how much, and place it again on request.

    Exit code 0: nothing moved beyond the limit; 1: a camera moved or its lens changed; 2: bad input. With --resolve
    the exit code is that of the file written, as for calibrate: 0 where its gates pass, 1 where one fails.
    """
    from rigcal.drift import DriftOptions, find_drift
    from rigcal.rigfile import read_rigfile

    _check_options(resolve, output, moved or [])
    document = read_rigfile(rig)
    options = DriftOptions(limit_px)
    detections = views_of_rig(capture, board_of_rig(board, document), document, cache)
    found = find_drift(detections, document, options)
    written = None
    if resolve and output is not None and not found.unchanged:
        written = _write_resolved(document, found, rig, output, moved or [])
    if as_json:
        print_json(_as_json(found, rig, written, output))
    else:
        _show(document, found, written, output)
    if written is not None:
        raise typer.Exit(0 if written.verdict in ("PASS", "IMPORTED") else 1)
    raise typer.Exit(0 if found.unchanged else 1)


def _check_options(resolve: bool, output: Path | None, moved: list[str]) -> None:
    from rigcal.errors import OptionError

    if resolve != (output is not None):
        raise OptionError("--resolve", expected="--resolve together with -o OUT.rig.json", got="one without the other")
    if moved and not resolve:
        raise OptionError("--moved", expected="--moved together with --resolve", got=", ".join(moved))


def _write_resolved(document: RigDocument, found: Drift, rig: Path, output: Path, moved: list[str]) -> RigDocument:
    from rigcal.drift import resolve_drift
    from rigcal.evidence import SUFFIX, beside, read_evidence, write_evidence
    from rigcal.rigfile import write_rigfile

    resolved = resolve_drift(document, found, read_evidence(beside(rig, SUFFIX)), named=moved, utc=now_utc())
    with writing(output):
        if resolved.evidence is not None:
            write_evidence(resolved.evidence, beside(output, SUFFIX))
        written = write_rigfile(resolved.document, output)
        write_report(written, output, beside(output, ".report.html"))
    return written


def _as_json(found: Drift, rig: Path, written: RigDocument | None, output: Path | None) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "rig_file": str(rig),
        "unchanged": found.unchanged,
        "limit_px": found.limit_px,
        "moved": list(found.with_status("moved")),
        "suspects": list(found.with_status("suspect")),
        "lens_changed": list(found.with_status("lens changed")),
        "not_judged": list(found.with_status("not judged")),
        "cameras": [asdict(camera) for camera in found.cameras],
        "resolved": {"rig_file": str(output), "verdict": written.verdict, "digest": written.digest}
        if written
        else None,
    }


def _show(document: RigDocument, found: Drift, written: RigDocument | None, output: Path | None) -> None:
    from rigcal.report.text import plain, table

    show(plain(_first_line(found)))
    columns = ["camera", "is", "views", "shift, px", "turn, deg", "way, mm", "RMSE, px"]
    show(table(columns, [_row(camera) for camera in found.cameras], left=(0, 1)))
    for camera in found.cameras:
        if camera.status != "stayed" or camera.remark:
            show(plain(f"{camera.camera_id}: {'; '.join(part for part in (camera.reason, camera.remark) if part)}"))
    if len(found.groups) > 1:
        groups = "; ".join(", ".join(group.measured.poses.ids) for group in found.groups)
        show(plain(f"No board view joins these groups, so each was judged by itself: {groups}"))
    if document.verdict == "RECAPTURE":
        show("The rig file says RECAPTURE: what it is compared with is itself not to be relied on.")
    if written is not None and output is not None:
        show(f"rig file {output}: {written.verdict}")
    elif output is not None:
        show("Nothing to place again; no file written.")


def _first_line(found: Drift) -> str:
    parts = [
        f"{', '.join(ids)} {what}"
        for ids, what in (
            (found.with_status("moved"), "moved"),
            (found.with_status("suspect"), "disagree: one or more of them moved, and the views cannot tell which"),
            (found.with_status("lens changed"), "has another lens setting than when it was calibrated"),
        )
        if ids
    ]
    judged = len(found.cameras) - len(found.with_status("not judged"))
    stayed = f"{judged} of {len(found.cameras)} cameras judged, limit {found.limit_px:g} px"
    return f"{'; '.join(parts) if parts else 'No camera moved'} ({stayed})"


def _row(camera: CameraDrift) -> list[str]:
    from rigcal.report.numbers import ABSENT
    from rigcal.report.text import plain

    moved = camera.movement
    figures = [ABSENT] * 3
    if moved is not None:
        figures = [
            f"{moved.shift_px:.2f} +- {moved.shift_sigma_px:.2f}",
            f"{moved.rotation_deg:.3f} +- {moved.rotation_sigma_deg:.3f}",
            f"{1e3 * moved.translation_m:.1f} +- {1e3 * moved.translation_sigma_m:.1f}",
        ]
    residual = ABSENT if camera.rmse_px is None else f"{camera.rmse_px:.2f}"
    return [plain(camera.camera_id), camera.status, str(camera.views), *figures, residual]
