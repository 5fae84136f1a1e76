"""What ``recognition run`` does once its options are understood, and what it tells at the end."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import typer

from recognition.cli._app import print_json
from recognition.cli._show import LastScene, live_status, progress
from recognition.cli._signals import Stop
from recognition.detectors import Detector, ModelInfo
from recognition.feeds import FeedOptions, open_feed
from recognition.grouping import GroupingOptions
from recognition.live import Entry, LiveFeed, LiveInput, LiveOptions
from recognition.live.journal import Level
from recognition.monitoring import Coverage
from recognition.observations import Scene, Status
from recognition.options import options_text
from recognition.recording import DiskBudget, Recorded, Recorder
from recognition.replay import PLACING_KEY, VIEWS_KEY
from recognition.runtime import RunOptions, RunResult, run, run_live
from recognition.sources.synchrony import SyncReport
from recognition.status import LiveStatus, summary
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True)
class Storage:
    """How the recording is stored."""

    segment_s: float | None
    budget: DiskBudget


@dataclass(frozen=True, slots=True)
class Job:
    """A run that was asked for."""

    rig_path: Path
    output: Path
    rig: Rig
    feed: FeedOptions
    options: RunOptions
    storage: Storage
    detector: Detector | None
    clock_age_s: float
    quiet: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """What there is to tell of a run."""

    result: RunResult
    recorded: Recorded
    facts: dict[str, str]
    sync: SyncReport | None
    warnings: tuple[str, ...]
    notices: tuple[str, ...]
    unmonitored: str | None
    """Why nothing was ever monitored; None where something was."""
    live: LiveStatus | None = None
    """How it stood at its end, where it was paced."""
    seconds: Mapping[Status, float] | None = None
    """For how long it had each status, where it was paced."""

    @property
    def exit_code(self) -> int:
        """1: nothing was ever monitored; 3: not all of it is in the recording; else 0."""
        if self.unmonitored is not None:
            return 1
        lost = sum(one.unrecorded for one in self.live.cameras) if self.live else 0
        return 3 if self.recorded.stopped or lost else 0


def run_files(job: Job, source: Path | None, detections: Path | None, stop: Stop) -> Outcome:
    """Run over a capture or a detections file: every instant, as fast as it goes or paced."""
    feed = open_feed(job.rig, source, detections, job.detector, job.feed)
    notices = _notices(job)
    recorder = _recorder(job, feed.facts, feed.sync, expected_bytes=feed.bytes)
    with recorder, progress(feed.total, quiet=job.quiet) as bar:
        warnings = (*feed.warnings, *recorder.notices)
        for warning in (*warnings, *notices):
            recorder.log("warning", warning, feed.start_ns)
        result = run(job.rig, feed.instants, recorder, job.options, progress=bar, stop=stop)
    unmonitored = _unmonitored(result, "two cameras took part in no instant")
    return Outcome(result, recorder.close(), feed.facts, feed.sync, warnings, notices, unmonitored)


def run_streams(job: Job, source: LiveInput, stop: Stop) -> Outcome:
    """Run on live cameras, or on a capture at its own pace."""
    if job.detector is None:
        raise ValueError("live streams need a detector")
    cv2.setNumThreads(1)  # views are looked at in parallel already
    notices = _notices(job)
    recorder = _recorder(job, source.facts, source.sync, expected_bytes=source.bytes)
    live_options = LiveOptions(
        use=job.feed.use,
        is_live=source.is_live,
        clock_age_s=job.clock_age_s,
        grouping=GroupingOptions(fps=job.feed.fps),
    )
    with recorder:
        warnings = (*source.warnings, *recorder.notices)
        feed = LiveFeed(job.rig, source.streams, job.detector, recorder, source.now_ns, live_options)
        with live_status(feed) as last:
            told = _Told(feed, recorder, source, last)
            for warning in (*warnings, *notices):
                told.say("warning", warning)
            with feed:
                result = run_live(job.rig, feed, recorder, job.options, on_scene=told.scene, stop=stop)
                if stop.by:
                    told.say("info", f"stopped by {stop.by}: the recording is being finished")
    why = _unmonitored(result, last.seen.reason if last.seen else "it ended before the first instant")
    seconds = told.coverage.seconds
    return Outcome(result, recorder.close(), source.facts, source.sync, warnings, notices, why, feed.status, seconds)


class _Told:
    """What is said of a live run while it goes on: to whoever looks, and into the recording."""

    def __init__(self, feed: LiveFeed, recorder: Recorder, source: LiveInput, last: LastScene) -> None:
        self._feed, self._recorder, self._source, self._last = feed, recorder, source, last
        self.coverage = Coverage()

    def scene(self, scene: Scene) -> None:
        """Show the scene, and say where monitoring ends or begins with it."""
        self._last(scene)
        change = self.coverage.see(scene)
        if change:
            self.say("error" if scene.status == "NOT MONITORED" else "warning", change)

    def say(self, level: Level, text: str) -> None:
        """Say it at once."""
        at_ns = self._source.now_ns()
        self._recorder.log(level, text, at_ns, receive_ns=at_ns if self._source.is_live else None)
        self._feed.announce(Entry(at_ns, level, text))


def _unmonitored(result: RunResult, why: str) -> str | None:
    """``why`` where nothing was monitored at any instant."""
    return None if any(status != "NOT MONITORED" for status in result.statuses) else why


def _recorder(job: Job, facts: dict[str, str], sync: SyncReport | None, *, expected_bytes: int | None) -> Recorder:
    networks = job.detector.model_info if job.detector else ()
    wanted = [camera_id for camera_id, is_wanted in zip(job.rig.camera_ids, job.feed.use, strict=True) if is_wanted]
    metadata = {
        "association": job.options.placing.method,
        PLACING_KEY: options_text(job.options.placing),
        VIEWS_KEY: ",".join(wanted),
        "interpolate": str(job.feed.interpolate).lower(),
        **facts,
        **({"sync": json.dumps(sync.document, ensure_ascii=False)} if sync else {}),
        **{f"model.{m.family}": f"{m.name} {m.sha256}" for m in networks},
        **{f"notice.{m.family}": m.notice for m in networks if m.notice},
    }
    return Recorder(
        job.output,
        rig=job.rig,
        rig_json=job.rig_path.read_bytes(),
        metadata=metadata,
        segment_s=job.storage.segment_s,
        budget=job.storage.budget,
        expected_bytes=expected_bytes,
    )


def _notices(job: Job) -> tuple[str, ...]:
    """What whoever uses the result must know of its networks, each once with the files that it is of."""
    networks: Sequence[ModelInfo] = job.detector.model_info if job.detector else ()
    texts = dict.fromkeys(network.notice for network in networks if network.notice)
    return tuple(
        f"{', '.join(network.name for network in networks if network.notice == text)} (bundled): {text}"
        for text in texts
    )


def tell_json(rig: Rig, told: Outcome, poses: Path | None) -> None:
    """The outcome as one object on standard output."""
    result, recorded = told.result, told.recorded
    print_json(
        {
            "recording": str(recorded.path),
            "files": [str(path) for path in recorded.files],
            "poses": str(poses) if poses else None,
            "verdict": rig.verdict,
            "instants": result.instants,
            "scenes": result.placed,
            "stopped": result.stopped,
            "rule": told.facts,
            "sync": told.sync.document if told.sync else None,
            "warnings": list(told.warnings),
            "notices": list(told.notices),
            "people_detected": dict(result.detections),
            "workers": {str(track): count for track, count in result.worker_instants.items()},
            "objects": dict(result.object_instants),
            "monitoring": dict(result.statuses),
            "monitoring_s": told.seconds,
            "unmonitored": told.unmonitored,
            "live": told.live.document if told.live else None,
            "messages": dict(recorded.messages),
            "recording_stopped": recorded.stopped,
            "bytes": recorded.bytes,
        }
    )


def tell(rig: Rig, told: Outcome, stop: Stop, poses: Path | None) -> None:
    """The outcome for people."""
    for line in _lines(rig, told, stop):
        typer.echo(line)
    recorded = told.recorded
    typer.echo(f"recording {recorded.path} ({recorded.bytes / 1e6:.1f} MB, open it in Foxglove)")
    if poses is not None:
        typer.echo(f"poses     {poses}")


def _lines(rig: Rig, told: Outcome, stop: Stop) -> Iterable[str]:
    result = told.result
    if result.stopped:
        yield f"stopped by {stop.by}" + ("" if told.recorded.stopped else ": everything up to here is in the recording")
    if told.unmonitored:
        yield f"NOTHING WAS MONITORED: {told.unmonitored}"
    blind = result.statuses.get("NOT MONITORED", 0) if told.live else 0
    facts = ", ".join(f"{key} {value}" for key, value in told.facts.items() if not key.startswith("source."))
    yield f"{result.instants} instants, {result.placed - blind} of them in 3D ({facts}), rig {rig.verdict}"
    yield from _monitoring(told)
    yield from summary(told.live) if told.live else ()
    yield from told.sync.lines() if told.sync else ()
    if told.recorded.stopped:
        yield f"NOT RECORDED TO THE END: {told.recorded.stopped}"
    for path in told.recorded.dropped:
        yield f"{path.name} was deleted to make room"
    yield from (f"warning: {warning}" for warning in told.warnings)
    yield from (f"notice: {notice}" for notice in told.notices)
    yield "people detected  " + ", ".join(f"{c} {n}" for c, n in result.detections.items())
    yield from (f"  worker {track}: seen in 3D at {n} instants" for track, n in result.worker_instants.items())
    yield from (f"  {name}: seen in 3D at {n} instants" for name, n in result.object_instants.items())


def _monitoring(told: Outcome) -> Iterable[str]:
    if told.seconds:
        yield ", ".join(f"{status} for {lasted_s:.1f} s" for status, lasted_s in told.seconds.items())
        return
    for status, count in told.result.statuses.items():
        if status != "MONITORED":
            yield f"{status} at {count} of {told.result.instants} instants"
