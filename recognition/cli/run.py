"""``recognition run``: a capture or live cameras in, a recording out."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import InterpolateOption, JsonOption, ViewsOption, app
from recognition.cli._chosen import (
    DEFAULT_FPS,
    AssociationMethod,
    declared_fps,
    detector_of,
    require_output,
    require_runnable,
    used_cameras,
    write_poses_of,
)
from recognition.cli._evidence import evidence_folder, require_encoder, write_evidence
from recognition.cli._judged import require_rules, write_log
from recognition.cli._show import echo
from recognition.errors import SourceError
from rigcal.errors import OptionsError, writing

if TYPE_CHECKING:
    from recognition.cli._running import Job, Outcome, Storage
    from recognition.commissioning import Standing
    from recognition.detectors import Detector
    from recognition.judging import Rulebook
    from rigcal.rigdocument import RigDocument


class Keep(StrEnum):
    """What stays when the room for the recording is used up."""

    newest = "newest"
    oldest = "oldest"


@app.command()
def run(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file, NAME.rig.json.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.mcap", help="The recording to write.")],
    source: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CAPTURE|URL",
            help="Folder with a video or a folder of images per camera; or a live camera, rtsp://... or "
            "cam0=rtsp://..., once for each [those of --site].",
        ),
    ] = None,
    site: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Site file: live sources, and how old their clocks may be.")
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
    rules: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Rule file, NAME.rules.toml: judge every instant by it.")
    ] = None,
    events: Annotated[
        Path | None, typer.Option(metavar="OUT.json", help="Also write the violations that --rules finds.")
    ] = None,
    commission: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="The site's record of `recognition commission` [NAME.commission.json beside RIG]."
        ),
    ] = None,
    alarms: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Alarms file: who is told of violations, and by which way.")
    ] = None,
    evidence: Annotated[
        bool, typer.Option("--evidence", help="At the end, write NAME.evidence/: videos and pictures of violations.")
    ] = False,
    views: ViewsOption = None,
    association: Annotated[
        AssociationMethod,
        typer.Option(help="Whether tracks claim detections first, or views are matched as the paper does."),
    ] = AssociationMethod.tracked,
    fps: Annotated[
        float | None,
        typer.Option(min=0.001, help="Frame rate where the images or detections hold no times [rig file's, else 30]."),
    ] = None,
    interpolate: InterpolateOption = False,
    realtime: Annotated[
        bool,
        typer.Option(
            "--realtime", help="Pace files at their capture time, and skip frame sets as live cameras would have it."
        ),
    ] = False,
    segment: Annotated[
        str | None, typer.Option(metavar="10min", help="Record segments of this length, OUT.000.mcap and so on.")
    ] = None,
    max_disk: Annotated[
        str | None, typer.Option(metavar="200GB", help="What the recording may take [the disk, less 256 MB].")
    ] = None,
    keep: Annotated[
        Keep | None,
        typer.Option(help="What stays when that is used up: the newest segments, or what was recorded first."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Track workers and objects in 3D over a capture or live cameras, and record frames, detections and scenes.

    With --rules it also judges them: violations go into the recording, to --events and to --alarms, and it is said
    whether these rules were commissioned on this site with these networks.

    Frames without --detections are looked at by the networks that come with the package; --pose-model replaces their
    people, --object-model their objects. Ctrl-C ends the run with a finished recording; so do SIGTERM and SIGHUP.

    Exit code 0: done, or ended by Ctrl-C; 1: nothing was monitored at any instant, and why is said; 2: bad input, or a
    rig file that must not be run; 3: not everything is in the recording, since the disk was full or too slow, or
    --max-disk used up.
    """
    from recognition.alarms import load_alarms
    from recognition.cli import _running as running
    from recognition.cli import _telling as telling
    from recognition.cli._alarming import Alarming
    from recognition.cli._signals import stop_on_signal
    from recognition.feeds import FeedOptions
    from recognition.judging import read_rulebook
    from recognition.live import chosen_sources, live_cameras, paced_capture
    from recognition.placing import PlacingOptions
    from recognition.runtime import RunOptions
    from rigcal.rigfile import read_rigfile, rig_of
    from rigcal.site import Site, load_site

    require_rules(rules, events=events, commission=commission, alarms=alarms, evidence=evidence)
    if evidence:
        require_encoder()
    rulebook = None if rules is None else read_rulebook(rules)
    document = read_rigfile(rig)
    loaded = rig_of(document)
    require_runnable(rig, loaded)
    known_site = load_site(site) if site is not None else None
    use = used_cameras(loaded, views)
    where = chosen_sources(source or [], loaded, use, known_site if detections is None else None)
    if isinstance(where, dict) and detections is not None:
        raise _detections_of_live()
    require_output(output, is_live=isinstance(where, dict))
    alarm_options = None if alarms is None else load_alarms(alarms, os.environ)
    detector = detector_of(object_model, pose_model, needed=where is not None and detections is None)
    standing = None if rulebook is None else _standing(rig, commission, rulebook, document, detector)
    if standing is not None and not as_json:
        echo(standing.line)
    job = running.Job(
        rig_path=rig,
        output=output,
        rig=loaded,
        feed=FeedOptions(use, fps or declared_fps(document, known_site) or DEFAULT_FPS, interpolate),
        options=RunOptions(
            placing=PlacingOptions(method=association.value),
            use=use,
            realtime=realtime,
            interpolate=interpolate,
            keep_scenes=poses is not None,
        ),
        storage=_storage(segment, max_disk, keep),
        detector=detector,
        clock_age_s=(known_site.clock_age_s if known_site else Site.model_fields["clock_age_s"].default),
        quiet=as_json,
        rulebook=rulebook,
        geometry_digest=document.geometry_digest,
        alarming=Alarming(alarm_options, output),
        standing=standing,
    )
    with writing(output), stop_on_signal() as stop:
        if isinstance(where, dict):
            told = running.run_streams(job, live_cameras(loaded, where), stop)
        elif where is not None and realtime and detections is None:
            told = running.run_streams(job, paced_capture(where, loaded, job.feed), stop)
        else:
            told = running.run_files(job, where, detections, stop)
    book = None if rulebook is None else rulebook.rules
    written = _written(job, told, poses, events, evidence)
    if as_json:
        telling.tell_json(loaded, told, book, written)
    else:
        telling.tell(loaded, told, stop, book, written)
    raise typer.Exit(told.exit_code)


def _standing(
    rig: Path, given: Path | None, rulebook: Rulebook, document: RigDocument, detector: Detector | None
) -> Standing:
    """What the site's record says to this run; CommissionError where one was asked for that does not count."""
    from recognition.commissioning import networks_of, standing_of
    from recognition.judging import network_metadata

    return standing_of(
        rig,
        given,
        rules_digest=rulebook.rules.digest,
        rig_digest=document.geometry_digest,
        networks=networks_of(network_metadata(detector.model_info if detector else ())),
    )


def _written(job: Job, told: Outcome, poses: Path | None, events: Path | None, evidence: bool) -> dict[str, Path]:
    """Write what is wanted beside the recording."""
    written: dict[str, Path] = {}
    result, book = told.result, job.rulebook
    if poses is not None:
        write_poses_of(result.scenes, job.rig, poses)
        written["poses"] = poses
    if book is not None and events is not None:
        write_log(
            events,
            recording=job.output,
            rules=book.rules,
            rig=job.rig,
            geometry_digest=job.geometry_digest,
            metadata=told.metadata,
            association=job.options.placing.method,
            smoothed=False,
            monitoring=result.statuses,
            events=result.events,
        )
        written["events_file"] = events
    if evidence:
        write_evidence(job.output, result.events, quiet=job.quiet)
        written["evidence"] = evidence_folder(job.output)
    return written


def _storage(segment: str | None, max_disk: str | None, keep: Keep | None) -> Storage:
    from recognition.cli._amounts import seconds, size_bytes
    from recognition.cli._running import Storage
    from recognition.recording import DiskBudget

    if keep is Keep.newest and segment is None:
        raise OptionsError(
            "--keep newest",
            expected="--segment TIME beside it: whole segments are deleted",
            got="no --segment",
            do_next="add --segment 10min",
        )
    return Storage(
        segment_s=None if segment is None else seconds("--segment", segment),
        budget=DiskBudget(
            max_bytes=None if max_disk is None else size_bytes("--max-disk", max_disk),
            keep=None if keep is None else keep.value,
        ),
    )


def _detections_of_live() -> SourceError:
    return SourceError(
        "a file cannot say what live cameras will see",
        where="--detections with live sources",
        expected="a capture, or no --detections",
        got="both",
        do_next="leave --detections out, or give the capture that it was made of",
    )
