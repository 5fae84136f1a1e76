"""What ``recognition run`` does once its options are understood."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from recognition.cli._alarming import Alarming
from recognition.cli._show import LastScene, live_status, progress
from recognition.cli._signals import Stop
from recognition.commissioning import STANDING_KEY, Standing
from recognition.detectors import Detector, ModelInfo
from recognition.events import Event, Watch
from recognition.feeds import FeedOptions, open_feed
from recognition.grouping import GroupingOptions
from recognition.judging import NAME_KEY, Rulebook, network_metadata, watch_of
from recognition.live import Entry, LiveFeed, LiveInput, LiveOptions
from recognition.live.journal import Level
from recognition.monitoring import Coverage
from recognition.observations import Scene, Status
from recognition.options import options_text
from recognition.recording import DiskBudget, Phase, Recorded, Recorder, event_words
from recognition.replay import PLACING_KEY, VIEWS_KEY
from recognition.runtime import RunOptions, RunResult, run, run_live
from recognition.sources.synchrony import SyncReport
from recognition.status import LiveStatus
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
    rulebook: Rulebook | None
    geometry_digest: str
    """The rig file's."""
    alarming: Alarming
    standing: Standing | None = None
    """Whether the rules are commissioned on this site; None where there are none."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What there is to tell of a run."""

    result: RunResult
    recorded: Recorded
    metadata: Mapping[str, str]
    """Of the recording, beside what the recorder says of the rig."""
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
    metadata = _metadata(job, feed.facts, feed.sync)
    watch = _watch(job, metadata)
    recorder = _recorder(job, metadata, expected_bytes=feed.bytes)
    alarming = job.alarming

    def record(level: str, text: str) -> None:
        recorder.log(level, text, feed.start_ns if alarming.at_ns is None else alarming.at_ns)

    with recorder, alarming.running(record), progress(feed.total, quiet=job.quiet) as bar:
        warnings = (*feed.warnings, *recorder.notices)
        for warning in (*warnings, *notices):
            recorder.log("warning", warning, feed.start_ns)
        result = run(
            job.rig,
            feed.instants,
            recorder,
            job.options,
            watch=watch,
            on_scene=alarming.scene,
            on_event=alarming.event,
            progress=bar,
            stop=stop,
        )
    unmonitored = _unmonitored(result, "two cameras took part in no instant")
    return Outcome(result, recorder.close(), metadata, feed.facts, feed.sync, warnings, notices, unmonitored)


def run_streams(job: Job, source: LiveInput, stop: Stop) -> Outcome:
    """Run on live cameras, or on a capture at its own pace."""
    if job.detector is None:
        raise ValueError("live streams need a detector")
    cv2.setNumThreads(1)  # views are looked at in parallel already
    notices = _notices(job)
    metadata = _metadata(job, source.facts, source.sync)
    watch = _watch(job, metadata)
    recorder = _recorder(job, metadata, expected_bytes=source.bytes)
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
            told = _Told(job.alarming, feed, recorder, source, last)
            for warning in (*warnings, *notices):
                told.say("warning", warning)
            with job.alarming.running(told.record), feed:
                result = run_live(
                    job.rig,
                    feed,
                    recorder,
                    job.options,
                    watch=watch,
                    on_scene=told.scene,
                    on_event=told.event,
                    stop=stop,
                )
                if stop.by:
                    told.say("info", f"stopped by {stop.by}: the recording is being finished")
    why = _unmonitored(result, last.seen.reason if last.seen else "it ended before the first instant")
    seconds = told.coverage.seconds
    recorded = recorder.close()
    return Outcome(result, recorded, metadata, source.facts, source.sync, warnings, notices, why, feed.status, seconds)


class _Told:
    """What is said of a live run while it goes on: to whoever looks, and into the recording."""

    def __init__(
        self, alarming: Alarming, feed: LiveFeed, recorder: Recorder, source: LiveInput, last: LastScene
    ) -> None:
        self._alarming, self._feed, self._recorder = alarming, feed, recorder
        self._source, self._last = source, last
        self.coverage = Coverage()

    def scene(self, scene: Scene) -> None:
        """Show the scene, pass it on to the alarms, and say where monitoring ends or begins with it."""
        self._last(scene)
        self._alarming.scene(scene)
        change = self.coverage.see(scene)
        if change:
            self.say("error" if scene.status == "NOT MONITORED" else "warning", change)

    def event(self, event: Event, phase: Phase) -> None:
        """Show what has happened to an event, which is recorded already, and pass it on to the alarms."""
        self._alarming.event(event, phase)
        words = event_words(event, phase)
        if words is not None:
            self._feed.announce(Entry(self._source.now_ns(), *words))

    def say(self, level: Level, text: str) -> None:
        """Say it at once."""
        self.record(level, text)
        self._feed.announce(Entry(self._source.now_ns(), level, text))

    def record(self, level: str, text: str) -> None:
        """Put it into the recording alone."""
        at_ns = self._source.now_ns()
        self._recorder.log(level, text, at_ns, receive_ns=at_ns if self._source.is_live else None)


def _unmonitored(result: RunResult, why: str) -> str | None:
    """``why`` where nothing was monitored at any instant."""
    return None if any(status != "NOT MONITORED" for status in result.statuses) else why


def _metadata(job: Job, facts: dict[str, str], sync: SyncReport | None) -> dict[str, str]:
    """What the recording says of the run."""
    networks = job.detector.model_info if job.detector else ()
    wanted = [camera_id for camera_id, is_wanted in zip(job.rig.camera_ids, job.feed.use, strict=True) if is_wanted]
    return {
        "association": job.options.placing.method,
        PLACING_KEY: options_text(job.options.placing),
        VIEWS_KEY: ",".join(wanted),
        "interpolate": str(job.feed.interpolate).lower(),
        **facts,
        **({"sync": json.dumps(sync.document, ensure_ascii=False)} if sync else {}),
        **network_metadata(networks),
        **({NAME_KEY: job.rulebook.rules.name} if job.rulebook else {}),
        **({STANDING_KEY: job.standing.line} if job.standing else {}),
    }


def _watch(job: Job, metadata: Mapping[str, str]) -> Watch | None:
    """The rules of the run; RigRefusedError where the rig has no floor and they need one."""
    if job.rulebook is None:
        return None
    return watch_of(job.rulebook.rules, job.rig, metadata, job.geometry_digest)


def _recorder(job: Job, metadata: Mapping[str, str], *, expected_bytes: int | None) -> Recorder:
    return Recorder(
        job.output,
        rig=job.rig,
        rig_json=job.rig_path.read_bytes(),
        metadata=metadata,
        rules_toml=job.rulebook.toml if job.rulebook else None,
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
