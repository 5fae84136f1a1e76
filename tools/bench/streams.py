"""The runtime on four 1080p30 H.264 streams of 6 Mb/s, live: JSON lines, the last one judged by the bars.

The streams show the work of the demo site, at three times its speed (its videos have ten frames a second). They are
made once, ten seconds forwards and backwards, and played in a loop: from files that are paced at capture time, or over
RTSP by a server of the loopback interface in a process of its own, which takes its part of the processors. Recording,
decoding, the bundled int8 networks, placing: everything as in ``recognition run``, in this process.

Bars: every frame recorded; 15 inferences per camera and second; 200 ms from capture to track at p95; memory that does
not grow. The recording is of segments of a minute, since the index of an MCAP file stays in memory up to its end.
``cpu_ms`` is processor time (``time.thread_time``) per frame set that was looked at, by stage, and ``cpu_ms_per_call``
per image, packet or instant; what the stages do not cover is ``rest``.

    python -m tools.bench.streams [--source files|rtsp] [--minutes 10] [--fps 30] [--cameras 4] [--cores 2]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any
from unittest.mock import patch

import av
import cv2
import numpy as np

from recognition.detectors import load_bundled
from recognition.detectors.network import Network
from recognition.grouping import GroupingOptions
from recognition.live import LiveFeed, LiveInput, LiveOptions, live_cameras
from recognition.live.pacing import PacedStream, Pacing
from recognition.placing import Placer
from recognition.recording import Recorder, check_sequence, recording_files
from recognition.runtime import RunOptions, run_live
from recognition.sources.decoding import DecodedFrame, Decoder
from recognition.sources.files import untimed
from recognition.sources.stream import Packet, Stream
from recognition.sources.urls import SourceUrl
from rigcal.captures import open_capture
from rigcal.rig import ClockModel, Rig
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "rig_configs" / "demo" / "work"
OUT = ROOT / "out" / "bench" / "streams"
SERVER = ROOT / "tests" / "recognition" / "rtsp_server.py"
BIT_RATE, FRAMES, CODED_FPS = 6_000_000, 150, 30
LATENCY_S, INFERENCES_PER_S, GROWTH_MB_PER_MIN = 0.2, 15.0, 1.0
REPORT_S, SEGMENT_S = 10.0, 60.0


class Stages:
    """Processor time of each stage, over all threads."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self._lock = threading.Lock()

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*args: Any, **kwargs: Any) -> Any:
            start = time.thread_time()
            try:
                return call(*args, **kwargs)
            finally:
                spent = time.thread_time() - start
                with self._lock:
                    self.seconds[name] = self.seconds.get(name, 0.0) + spent
                    self.calls[name] = self.calls.get(name, 0) + 1

        return wrapped

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Time the stages of every run in the block."""
        run = Network.run

        def run_network(network: Network, tensor: Any) -> Any:
            return self.timed("site network" if tensor.shape[1:3] == (288, 512) else "worker network", run)(
                network, tensor
            )

        with ExitStack() as stack:
            stack.enter_context(patch.object(Network, "run", run_network))
            for owner, method, name in (
                (Decoder, "decode", "decode"),
                (DecodedFrame, "image_bgr", "to BGR"),
                (Placer, "place", "place"),
                (Recorder, "write_packet", "record frames"),
                (Recorder, "write_detections", "record detections"),
                (Recorder, "write_scene", "record scene"),
            ):
                stack.enter_context(patch.object(owner, method, self.timed(name, getattr(owner, method))))
            yield


class Looped:
    """A short file as a long stream: its packets again and again, a frame every ``period_ns``."""

    def __init__(self, camera: int, path: Path, start_ns: int, period_ns: int, frames: int) -> None:
        self.camera, self._start_ns, self._period_ns, self._frames = camera, start_ns, period_ns, frames
        self._file = untimed(next(one for one in open_capture(path.parent).cameras if one.id == path.stem))
        self._stored = list(self._file.packets())
        self._closing = threading.Event()

    def packets(self) -> Iterator[Packet]:
        for number in range(self._frames):
            if self._closing.is_set():
                return
            stored = self._stored[number % len(self._stored)]
            t_ns = self._start_ns + number * self._period_ns
            yield replace(stored, camera=self.camera, number=number, t_ns=t_ns)

    def decoder(self) -> Decoder:
        return self._file.decoder()

    def close(self) -> None:
        self._closing.set()


def clips(cameras: int) -> list[Path]:
    """The streams' clips; made where they are not there yet."""
    paths = [OUT / "clips" / f"cam{number}.mp4" for number in range(cameras)]
    for number, path in enumerate(paths):
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(".part.mp4")
            _encode(WORK / f"cam{number}.mp4", part)
            part.rename(path)
    return paths


def _encode(video: Path, path: Path) -> None:
    """Half of the frames forwards, then the same backwards; with the noise of a sensor, without B-frames."""
    noise = np.random.default_rng(0).normal(0.0, 2.0, (8, 1080, 1920, 1)).astype(np.float32)
    with av.open(str(video)) as container:
        images = [frame.to_ndarray(format="bgr24") for frame in islice(container.decode(video=0), FRAMES // 2)]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(CODED_FPS))
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 1920, 1080, "yuv420p", BIT_RATE
        stream.options = {"preset": "veryfast", "g": str(CODED_FPS), "bf": "0"}
        for number, image in enumerate(images + images[::-1]):
            grainy = np.clip(image + noise[number % len(noise)], 0, 255).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grainy, format="bgr24")))
        container.mux(stream.encode())


def fresh_rig(cameras: int) -> tuple[Path, Rig]:
    """The demo site's true rig, with clocks that were measured just now."""
    true = rig_of(read_rigfile(WORK / "true.rig.json"))
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    clock = ClockModel(0.0, 0.0, now, 1e-4, 0.1, "probe")
    made = replace(true, cameras=tuple(replace(camera, clock=clock) for camera in true.cameras[:cameras]))
    path = OUT / "bench.rig.json"
    write_rigfile(document_of_rig(made, created_utc=now, inputs_sha256="0" * 64), path)
    return path, rig_of(read_rigfile(path))


def files_input(paths: list[Path], fps: float, seconds: float) -> LiveInput:
    """The clips, paced as ``recognition run --realtime`` paces files."""
    start_ns, period_ns = time.time_ns(), round(1e9 / fps)
    pacing = Pacing(len(paths), start_ns)
    streams: list[Stream] = [
        PacedStream(Looped(number, path, start_ns, period_ns, round(fps * seconds)), pacing)
        for number, path in enumerate(paths)
    ]
    return LiveInput(tuple(streams), pacing.now_ns, False, {"instants": "paced files"})


@contextmanager
def rtsp_input(rig: Rig, paths: list[Path]) -> Iterator[LiveInput]:
    """The clips from a server of their own process."""
    words = [f"{path.stem}={path}" for path in paths]
    with subprocess.Popen(
        [sys.executable, str(SERVER), *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        try:
            lines = [str(server.stdout.readline()) for _ in paths] if server.stdout else []
            urls = {n: SourceUrl.parse(line[line.index("rtsp://") :].strip()) for n, line in enumerate(lines)}
            yield live_cameras(rig, urls)
        finally:
            server.terminate()


def rss_mb() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def measure(given: argparse.Namespace, source: LiveInput, rig_path: Path, rig: Rig, seconds: float) -> dict[str, Any]:
    """One run; prints a line every ten seconds and returns the last."""
    output, stages, memory = OUT / "bench.mcap", Stages(), []
    for old in OUT.glob("bench*.mcap*"):
        old.unlink()
    use = (True,) * len(rig.cameras)
    recorder = Recorder(output, rig=rig, rig_json=rig_path.read_bytes(), metadata={}, segment_s=SEGMENT_S)
    options = LiveOptions(use, source.is_live, 86400.0, GroupingOptions(fps=given.fps))
    feed = LiveFeed(rig, source.streams, load_bundled(), recorder, source.now_ns, options)
    feed.announce = lambda entry: print(json.dumps({"said": entry.text}), flush=True)
    until, over = time.monotonic() + seconds + (10.0 if source.is_live else 60.0), threading.Event()

    def report() -> None:
        while not over.wait(REPORT_S):
            memory.append((time.monotonic(), rss_mb()))
            status = feed.status
            line = {"at_s": round(status.elapsed_s, 1), "rss_mb": round(memory[-1][1], 1)}
            print(json.dumps(line | _figures(status)), flush=True)

    if source.is_live:
        until = time.monotonic() + seconds
    reporter = threading.Thread(target=report)
    cpu, started = time.process_time(), time.monotonic()
    with stages.watching(), recorder:
        with feed:
            reporter.start()
            stop: Callable[[], bool] = lambda: time.monotonic() > until  # noqa: E731
            result = run_live(rig, feed, recorder, RunOptions(keep_scenes=False), stop=stop)
        over.set()
        reporter.join()
    cpu, lasted, status = time.process_time() - cpu, time.monotonic() - started, feed.status
    sets = max(status.looked_at, 1)
    files = recording_files(output)
    check = check_sequence(files)
    named = {name: round(1e3 * spent / sets, 2) for name, spent in sorted(stages.seconds.items())}
    return _figures(status) | {
        "inferences_per_s": round(status.looked_at / lasted, 2),
        "cores": round(cpu / lasted, 2),
        "cpu_ms": {**named, "rest": round(1e3 * (cpu - sum(stages.seconds.values())) / sets, 2)},
        "cpu_ms_per_call": {name: round(1e3 * s / stages.calls[name], 2) for name, s in sorted(stages.seconds.items())},
        "workers": len(result.worker_instants),
        "monitoring": dict(result.statuses),
        "check": check.ok,
        "recorded_mb_per_s": round(sum(file.stat().st_size for file in files) / 1e6 / lasted, 2),
        "growth_mb_per_min": _growth(memory),
        "bars": _bars(status, status.looked_at / lasted, _growth(memory), check.ok),
    }


def _figures(status: Any) -> dict[str, Any]:
    return {
        "received": sum(one.received for one in status.cameras),
        "recorded": sum(one.recorded for one in status.cameras),
        "dropped": {one.camera_id: one.drops for one in status.cameras if one.drops},
        "sets": status.sets,
        "looked_at": status.looked_at,
        "skipped": status.skipped,
        "latency_ms": [None if s is None else round(1e3 * s) for s in (status.latency_p50_s, status.latency_p95_s)],
        "load": round(os.getloadavg()[0], 1),
    }


def _growth(memory: list[tuple[float, float]]) -> float | None:
    """Megabytes per minute, after the first two: a line through the least of each minute, for the frames in flight come
    and go; None for runs of less than five."""
    minutes: dict[int, float] = {}
    for at, mb in memory:
        minute = int((at - memory[0][0]) // 60.0)
        minutes[minute] = min(mb, minutes.get(minute, mb))
    late = [(minute, mb) for minute, mb in minutes.items() if minute >= 2]
    return None if len(late) < 3 else round(float(np.polyfit(*np.array(late).T, 1)[0]), 2)


def _bars(status: Any, rate: float, growth: float | None, is_sound: bool) -> dict[str, bool | None]:
    return {
        "every frame recorded": is_sound and all(one.recorded == one.received > 0 for one in status.cameras),
        "15 inferences per camera and second": rate >= INFERENCES_PER_S,
        "p95 within 200 ms": status.latency_p95_s is not None and status.latency_p95_s <= LATENCY_S,
        "memory does not grow": None if growth is None else growth <= GROWTH_MB_PER_MIN,
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--source", choices=("files", "rtsp"), default="files")
    options.add_argument("--minutes", type=float, default=1.0)
    options.add_argument("--fps", type=float, default=30.0, help="of files; the server has its own, 30")
    options.add_argument("--cameras", type=int, default=4)
    options.add_argument("--cores", type=int, default=2, help="processors that may be used")
    given = options.parse_args()
    os.sched_setaffinity(0, set(sorted(os.sched_getaffinity(0))[: given.cores]))
    cv2.setNumThreads(1)
    paths, seconds = clips(given.cameras), 60.0 * given.minutes
    rig_path, rig = fresh_rig(given.cameras)
    about = {"source": given.source, "cameras": given.cameras, "fps": given.fps, "minutes": given.minutes}
    with ExitStack() as stack:
        if given.source == "rtsp":
            source = stack.enter_context(rtsp_input(rig, paths))
        else:
            source = files_input(paths, given.fps, seconds)
        print(json.dumps(about | measure(given, source, rig_path, rig, seconds)), flush=True)


if __name__ == "__main__":
    main()
