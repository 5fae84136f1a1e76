"""An hour judged again by a changed rule file: from the tracks in its recording, beside placing everybody again.

A minute of four workers and 14 objects before four cameras, at the 15 frame sets a second that the live runtime
reaches, is gone through :data:`MINUTES` times, one after the other: everybody appears anew with each. One of the
workers has no hat for half of it, so that there is something to find. Figures are of an hour: what was measured, times
60 over :data:`MINUTES`. The same events must come of the run, of its tracks and of placing again, to the last byte.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from recognition.events import EventLog, events_text
from recognition.judging import read_rulebook, watch_of
from recognition.observations import FrameSet, Instant, ViewDetections
from recognition.options import options_text
from recognition.placing import PlacingOptions
from recognition.recording import TRACKS, Recorder, iter_messages
from recognition.replay import PLACING_KEY, ReplayResult, replay
from recognition.runtime import RunOptions, RunResult, run
from recognition.sources.recording import RecordedRun, open_recording
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from rigcal.rig import Rig
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

MINUTES = 5
FPS = 15.0
RULES = Path(__file__).parents[2] / "rig_configs" / "site.rules.toml"
NOISE = DetectorNoise(pixel_sigma=3.0, missing_joint=0.05, missed=0.03, false_per_view=0.1)


def rejudge(minutes: float = MINUTES) -> Iterator[Mapping[str, Any]]:
    """Processor time, and bytes of the tracks, beside placing again."""
    with tempfile.TemporaryDirectory() as folder:
        yield rejudged(Path(folder), minutes)


def rejudged(folder: Path, minutes: float) -> Mapping[str, Any]:
    """Record in a folder, and judge again both ways."""
    rig, rig_path = _site(folder)
    book, metadata = read_rulebook(RULES), {PLACING_KEY: options_text(PlacingOptions())}
    path, digest = folder / "hour.mcap", read_rigfile(rig_path).geometry_digest
    with Recorder(
        path, rig=rig, rig_json=rig_path.read_bytes(), metadata=metadata, rules_toml=book.toml
    ) as recorder:  # fmt: skip
        watch = watch_of(book.rules, rig, metadata, digest)
        ran = run(rig, _instants(rig, minutes), recorder, RunOptions(keep_scenes=False), watch=watch)
    opened = open_recording(path)

    def again(options: PlacingOptions | None) -> ReplayResult:
        own = watch_of(book.rules, rig, opened.metadata, opened.geometry_digest)
        return replay(opened, options, keep_scenes=False, watch=own)

    by_tracks, tracks_s = _timed(lambda: again(None))
    by_placing, place_s = _timed(lambda: again(PlacingOptions()))
    texts = {_text(opened, result) for result in (ran, by_tracks, by_placing)}
    hours = minutes / 60
    return {
        "name": "runtime.rejudge.hour",
        "measured_minutes": minutes,
        "frame_sets_per_hour": round(by_tracks.instants / hours),
        "events_per_hour": round(len(by_tracks.events) / hours),
        "same_events": len(texts) == 1,
        "tracks_bytes_per_frame_set": _bytes(path) / by_tracks.instants,
        "recording_bytes_per_frame_set": path.stat().st_size / by_tracks.instants,
        "tracks_s": tracks_s / hours,
        "place_s": place_s / hours,
        "ratio": tracks_s / place_s,
        "tracks_at_30_fps_s": 30 / FPS * tracks_s / hours,
    }


def _site(folder: Path) -> tuple[Rig, Path]:
    path = folder / "site.rig.json"
    made = document_of_rig(semicircle_rig(4), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(made, path)
    return rig_of(read_rigfile(path)), path


def _instants(rig: Rig, minutes: float) -> Iterator[Instant]:
    """What the cameras saw, minute after minute the same."""
    frames = round(60 * FPS * min(minutes, 1.0))
    site = simulate(rig, workers=4, frames=frames, fps=FPS, seed=0)
    seen = [
        [
            _bare(view.detections, frame, frames)
            for view in with_noise(observe(site, frame), rig, NOISE, seed=(0, frame))
        ]
        for frame in range(frames)
    ]
    first_ns = int(site.t_ns[0])
    for index in range(round(60 * FPS * minutes)):
        views = tuple(seen[index % frames])
        yield Instant(FrameSet(index, first_ns + round(index * 1e9 / FPS), (None,) * len(views)), views)


def _bare(view: ViewDetections, frame: int, frames: int) -> ViewDetections:
    """Without hats in the second half."""
    keep = [n for n, name in enumerate(view.object_class) if name != "hard_hat" or frame < frames // 2]
    return replace(
        view,
        object_class=tuple(view.object_class[n] for n in keep),
        object_xyxy=view.object_xyxy[keep],
        object_score=view.object_score[keep],
        object_keypoints_px=view.object_keypoints_px[keep],
    )


def _timed(action: Callable[[], ReplayResult]) -> tuple[ReplayResult, float]:
    start_s = time.process_time()
    result = action()
    return result, time.process_time() - start_s


def _bytes(path: Path) -> int:
    return sum(one.message.ByteSize() for one in iter_messages(path, [TRACKS]))


def _text(opened: RecordedRun, result: RunResult | ReplayResult) -> str:
    """The events file."""
    rules = read_rulebook(RULES).rules
    log = EventLog(
        recording=opened.files[0].name,
        rules_name=rules.name,
        rules_digest=rules.digest,
        rig_digest=opened.geometry_digest,
        rig_verdict=opened.rig.verdict,
        association="tracked",
        smoothed=False,
        monitoring=result.statuses,
        caveats=(),
        events=result.events,
    )
    return events_text(log)
