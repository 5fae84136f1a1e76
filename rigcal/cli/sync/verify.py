"""The check before a recording."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli._app import BoardOption, JsonOption, RigArgument, SiteOption, print_json, show, site_of
from rigcal.cli.sync._app import sync_app

if TYPE_CHECKING:
    from rigcal.cli.sync._content import Content
    from rigcal.rigdocument import RigDocument
    from rigcal.site import Site
    from rigcal.sync.check import CameraCheck, Finding, HostReading, StampReading, SyncCheck
    from rigcal.sync.content.lags import ContentLags


@sync_app.command()
def verify(
    rig: RigArgument,
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[CAPTURE|URL...]", help="A capture just made, or live sources: CAMERA=URL, or rig order."
        ),
    ] = None,
    site: SiteOption = None,
    seconds: Annotated[float, typer.Option("--seconds", help="How long to probe hosts and watch sources.")] = 10.0,
    board: BoardOption = None,
    detections: Annotated[
        Path | None, typer.Option("--detections", metavar="FILE.npz", help="2D joints of people, per instant and view.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check before a recording that the clocks are right.

    One line per camera: green, amber or red, with the error in millimetres at the site's fastest motion. Hosts are
    those of the site file, else those that `sync probe` found. A short capture of a board that moves quickly
    before all cameras also checks the cameras themselves; without one only clocks and stamps are looked at.

    Exit code 0: every camera may record (green or amber); 1: a camera is red; 2: bad input.
    """
    from rigcal.rigfile import read_rigfile
    from rigcal.sync.check import CameraReadings, Colour, check_sync
    from rigcal.sync.record import clock_limits, latency_of, model_of

    document, declared = read_rigfile(rig), site_of(site)
    hosts = _hosts(document, declared, seconds)
    stamps, content = _stamps_and_content(document, declared, sources or [], seconds, board, detections)
    lags, swapped = _compared(content) if content is not None else (None, {})
    readings = [
        CameraReadings(
            camera_id,
            model_of(document, camera_id),
            latency_of(document, declared, camera_id),
            hosts.get(camera_id),
            stamps.get(camera_id),
            lags.camera(camera_id) if lags else None,
            _last_stamp_s(content, camera_id),
            swapped.get(camera_id),
        )
        for camera_id in document.camera_ids
    ]
    check = check_sync(readings, clock_limits(document, declared), now_s=time.time())
    if as_json:
        print_json(_as_json(check, rig))
    else:
        _show(check)
        if document.verdict == "RECAPTURE":
            show("The rig file itself says RECAPTURE; `rigcal validate` says why, and recognition refuses it.")
    raise typer.Exit(1 if check.colour is Colour.RED else 0)


def _last_stamp_s(content: Content | None, camera_id: str) -> float | None:
    """The last stamp of a camera's frames, by its own clock."""
    from rigcal.cli.sync._content import stamps_of

    ids = [camera.id for camera in content.capture.cameras] if content else []
    if content is None or camera_id not in ids:
        return None
    times_s = stamps_of(content.capture, None).times_s[ids.index(camera_id)]
    return float(times_s[-1]) if len(times_s) else None


def _hosts(document: RigDocument, site: Site | None, seconds: float) -> dict[str, HostReading]:
    """Every host that is known, probed."""
    from rigcal.cli.sync._probed import probe_hosts
    from rigcal.cli.sync.probe import confusion_of
    from rigcal.sync.check import HostReading
    from rigcal.sync.network import targets_of, targets_of_site
    from rigcal.sync.record import evidence_of_clock

    if site is not None and any(camera.clock for camera in site.cameras):
        targets = targets_of_site(site, document.camera_ids).targets
    else:
        kept = {c: evidence_of_clock(document, c).get("host") for c in document.camera_ids}
        named = [f"{camera_id}={host}" for camera_id, host in kept.items() if isinstance(host, str)]
        targets = targets_of(named, document.camera_ids) if named else ()
    if not targets:
        return {}
    return {
        camera_id: HostReading(
            one.probe.target.name,
            one.clock,
            one.probe.reason or "",
            confusion_of(one),
            one.probe.claimed_error_s,
        )
        for one in probe_hosts(targets, seconds, 10.0, None)
        for camera_id in one.probe.target.camera_ids
    }


def _stamps_and_content(
    document: RigDocument, site: Site | None, sources: list[str], seconds: float, spec: str | None, joints: Path | None
) -> tuple[dict[str, StampReading], Content | None]:
    """What a capture, or live sources, say of the stamps; and the capture, for its content."""
    from rigcal.cli._rigviews import board_of_rig
    from rigcal.cli.sync._content import content_of

    if len(sources) == 1 and "://" not in sources[0]:
        content = content_of(Path(sources[0]), document)
        content = replace(content, detections=joints, board=board_of_rig(spec, document) if spec else content.board)
        return _stamps_of_capture(content, site), content
    return _stamps_of_sources(document, site, sources, seconds), None


def _stamps_of_capture(content: Content, site: Site | None) -> dict[str, StampReading]:
    import numpy as np

    from rigcal.cli.sync._content import stamps_of
    from rigcal.pace import judge_pace
    from rigcal.sync.check import StampReading

    found = {}
    raw = stamps_of(content.capture, None)
    for camera, times_s in zip(content.capture.cameras, raw.times_s, strict=True):
        declared = site.camera(camera.id) if site else None
        fps = declared.fps if declared and declared.fps else camera.fps
        pace = judge_pace(times_s - times_s[:1].sum(), declared_fps=fps)
        found[camera.id] = StampReading(raw.rule, pace, span_s=float(np.ptp(times_s)) if len(times_s) else 0.0)
    return found


def _stamps_of_sources(
    document: RigDocument, site: Site | None, sources: list[str], seconds: float
) -> dict[str, StampReading]:
    from rigcal.cli.sync._sources import sources_of, watched

    urls = sources_of(sources, site, document.camera_ids)
    return watched(urls, site, seconds) if urls else {}


def _compared(content: Content) -> tuple[ContentLags | None, dict[str, str]]:
    """What the pictures say, and which cameras hold another's; None where nothing can be compared."""
    from rigcal.cli.sync._content import By, compare, compare_board

    if len(content.capture.cameras) == 1:
        return None, {}
    if content.detections is not None:
        return compare(content, By.PEOPLE), {}
    if content.board is not None:
        return compare_board(content)
    return compare(content, By.LIGHT), {}


def _as_json(check: SyncCheck, rig: Path) -> dict[str, Any]:
    return {
        "rig_file": str(rig),
        "colour": str(check.colour),
        "fastest_motion_m_per_s": check.limits.fastest_motion_m_per_s,
        "clock_error_m": check.limits.clock_error_m,
        "cameras": [_camera(camera) for camera in check.cameras],
    }


def _camera(camera: CameraCheck) -> dict[str, Any]:
    stamps = camera.stamps
    pace = stamps.pace if stamps and not stamps.trouble else None
    return {
        "id": camera.camera_id,
        "colour": str(camera.colour),
        "error_s": camera.error_s,
        "error_mm": None if camera.error_m is None else 1e3 * camera.error_m,
        "clock": asdict(camera.clock) if camera.clock else None,
        "stamps": None
        if pace is None or stamps is None
        else {
            "rule": stamps.rule,
            "source": pace.source,
            "frames": pace.frames,
            "delivered_fps": pace.delivered_fps,
            "declared_fps": pace.declared_fps,
            "jitter_s": pace.jitter_s,
            "missing": pace.missing_frames,
            "repeated": len(pace.repeated),
            "backwards": len(pace.backwards),
            "steps": len(pace.steps),
        },
        "content": asdict(camera.content) if camera.content else None,
        "findings": [asdict(finding) | {"colour": str(finding.colour)} for finding in camera.findings],
    }


def _show(check: SyncCheck) -> None:
    from rich.text import Text

    from rigcal.report.text import plain, table
    from rigcal.sync.check import Colour

    styles = {Colour.GREEN: "bold green", Colour.AMBER: "bold yellow", Colour.RED: "bold red"}
    first = Text()
    first.append(check.colour.upper(), style=styles[check.colour])
    first.append(f" {_first_line(check)}")
    show(first)
    columns = ["camera", "light", "error, mm", "clock, ms", "age", "fps", "stamps", "content, ms"]
    show(table(columns, [_row(camera) for camera in check.cameras], left=(0, 1, 6)))
    alike: dict[Finding, list[str]] = {}
    for camera in check.cameras:
        for finding in camera.findings:
            alike.setdefault(finding, []).append(camera.camera_id)
    for finding, ids in alike.items():
        show(plain(f"{', '.join(ids)} {finding.colour}: {finding.what}"))
        show(plain(f"  do next: {finding.do_next}"))


def _first_line(check: SyncCheck) -> str:
    from rigcal.sync.check import Colour

    limit = f"limit {1e3 * check.limits.clock_error_m:g} mm at {check.limits.fastest_motion_m_per_s:g} m/s"
    red = [camera.camera_id for camera in check.cameras if camera.colour is Colour.RED]
    if red:
        return f"do not record yet: {', '.join(red)} ({limit})"
    amber = [camera.camera_id for camera in check.cameras if camera.colour is Colour.AMBER]
    if amber:
        return f"may record; read what is said of {', '.join(amber)} ({limit})"
    return f"ready to record ({limit})"


def _row(camera: CameraCheck) -> list[str]:
    from rigcal.report.numbers import ABSENT, scaled, significant
    from rigcal.report.text import plain
    from rigcal.sync.check.findings import duration

    clock, content, stamps = camera.clock, camera.content, camera.stamps
    pace = stamps.pace if stamps is not None and not stamps.trouble else None
    fps = pace.delivered_fps if pace is not None else None
    return [
        plain(camera.camera_id),
        str(camera.colour),
        ABSENT if camera.error_m is None else significant(1e3 * camera.error_m),
        ABSENT if clock is None else f"{scaled(clock.offset_s, 1e3, 1)} +- {scaled(clock.bound_s, 1e3, 1)}",
        ABSENT if clock is None or clock.age_s is None else duration(clock.age_s),
        ABSENT if fps is None else f"{fps:.4g}",
        ABSENT if pace is None or (stamps and stamps.rule == "presentation times") else pace.source,
        ABSENT if content is None else f"{scaled(content.residual_s, 1e3, 1)} +- {scaled(content.bound_s, 1e3, 1)}",
    ]
