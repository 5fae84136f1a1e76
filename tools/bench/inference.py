"""Four 1080p30 streams through the bundled networks, as fast as two threads can: one JSON object per line.

Decoding, conversion to BGR, resizing, both networks and what is made of their outputs; images per second in all, and
milliseconds of processor time per image by stage. There are ``--workers`` threads: decoder, OpenCV and ONNX Runtime
run in the one that calls them. The streams are made once from the videos of a folder: cut to 16:9, scaled, H.264 of
6 Mb/s without B-frames. With ``--people N`` the worker network looks at N people in every image, whoever is there.

    python tools/bench/inference.py [--models FOLDER] [--precision int8 fp32] [--people 4] [--source FOLDER]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from fractions import Fraction
from itertools import chain, islice, repeat
from pathlib import Path
from threading import Lock
from typing import Any
from unittest.mock import patch

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from recognition.detectors import BundledDetector, People, load_bundled
from recognition.detectors.bundled import detector as bundled
from recognition.detectors.bundled import site, worker
from recognition.detectors.bundled.loading import MODELS
from recognition.detectors.bundled.site import SiteFindings, SiteNetwork
from recognition.detectors.network import Network

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT.parent / "shared" / "data" / "recognition" / "pose2sim_multi"
STREAMS = ROOT / "out" / "bench" / "inference"
SIZE_WH, FPS, BIT_RATE, FRAMES, CAMERAS = (1920, 1080), 30, 6_000_000, 150, 4
Image = NDArray[np.uint8]


class Stages:
    """Processor time of each stage, over all threads."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._lock = Lock()

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*args: Any, **kwargs: Any) -> Any:
            start = time.thread_time()
            try:
                return call(*args, **kwargs)
            finally:
                self.add(name, time.thread_time() - start)

        return wrapped

    def add(self, name: str, seconds: float) -> None:
        with self._lock:
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds


def streams(source: Path) -> list[Path]:
    """The four streams; made where they are not there yet."""
    paths = [STREAMS / f"cam{number}.mp4" for number in range(CAMERAS)]
    videos = sorted(path for path in source.iterdir() if path.suffix == ".mp4")
    for path, video in zip(paths, islice(chain.from_iterable(repeat(videos)), CAMERAS), strict=True):
        if not path.exists():
            STREAMS.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(".part.mp4")
            _encode(list(_frames(video)), part)
            part.rename(path)
    return paths


def _frames(video: Path) -> Iterator[Image]:
    with av.open(str(video)) as container:
        for frame in islice(container.decode(video=0), FRAMES):
            image = frame.to_ndarray(format="bgr24")
            height, width = image.shape[:2]
            rows = min(height, width * SIZE_WH[1] // SIZE_WH[0])
            top = (height - rows) // 2
            yield np.asarray(cv2.resize(image[top : top + rows], SIZE_WH, interpolation=cv2.INTER_CUBIC), np.uint8)


def _encode(images: list[Image], path: Path) -> None:
    """Forwards, then backwards, and so on."""
    there_and_back = images + images[-2:0:-1]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(FPS))
        stream.width, stream.height = SIZE_WH
        stream.pix_fmt, stream.bit_rate = "yuv420p", BIT_RATE
        stream.options = {"preset": "veryfast", "g": str(FPS), "bf": "0"}
        for idx in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(there_and_back[idx % len(there_and_back)], format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def crowded(find: Callable[..., SiteFindings], count: int) -> Callable[..., SiteFindings]:
    """The site network, but with ``count`` people of 420 px in every image."""
    left = np.linspace(100.0, 1500.0, count)
    boxes = np.stack([left, np.full(count, 350.0), left + 180, np.full(count, 770.0)], axis=-1)
    people, score = People(np.zeros((count, 17, 3)), boxes), np.ones(count)

    def wrapped(network: SiteNetwork, levels: tuple[Image, ...]) -> SiteFindings:
        return replace(find(network, levels), people=people, person_score=score)

    return wrapped


def detect_all(paths: list[Path], detector: BundledDetector, stages: Stages) -> int:
    """Decode the streams in turns and look at every image; returns how many there were."""
    done = 0
    with ExitStack() as stack:
        opened = [stack.enter_context(av.open(str(path))) for path in paths]
        for container in opened:
            container.streams.video[0].thread_type = "NONE"
            container.streams.video[0].codec_context.thread_count = 1
        decoders = [container.decode(video=0) for container in opened]
        following = stages.timed("decode", lambda decoder: next(decoder, None))
        convert = stages.timed("convert", lambda frame: frame.to_ndarray(format="bgr24", threads=1))
        detect = stages.timed("detect", detector.detect)
        while decoders:
            frames = [(decoder, following(decoder)) for decoder in decoders]
            decoders = [decoder for decoder, frame in frames if frame is not None]
            for image in (convert(frame) for _, frame in frames if frame is not None):
                detect(image)
                done += 1
    return done


def measure(paths: list[Path], detector: BundledDetector, *, people: int | None, workers: int) -> dict[str, Any]:
    """One pass over all streams."""
    stages = Stages()
    run = Network.run

    def run_timed(network: Network, tensor: NDArray[Any]) -> Any:
        return stages.timed("site" if tensor.shape[1:3] == (288, 512) else "worker", run)(network, tensor)

    with ExitStack() as stack:
        stack.enter_context(patch.object(Network, "run", run_timed))
        stack.enter_context(patch.object(bundled, "halves", stages.timed("halve", bundled.halves)))
        stack.enter_context(patch.object(site, "site_input", stages.timed("resize", site.site_input)))
        stack.enter_context(patch.object(worker, "worker_input", stages.timed("crops", worker.worker_input)))
        if people is not None:
            stack.enter_context(patch.object(SiteNetwork, "find", crowded(SiteNetwork.find, people)))
        pool = stack.enter_context(ThreadPoolExecutor(workers))
        start, cpu = time.perf_counter(), time.process_time()
        shares = [paths[number::workers] for number in range(workers)]
        images = sum(pool.map(lambda share: detect_all(share, detector, stages), shares))
        seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    inside = sum(stages.seconds.get(name, 0.0) for name in ("halve", "resize", "site", "crops", "worker"))
    stages.seconds["outputs"] = stages.seconds.pop("detect") - inside
    return {
        "images": images,
        "images_per_s": round(images / seconds, 1),
        "cpu_ms_per_image": round(1e3 * cpu / images, 2),
        "cpu_ms": {name: round(1e3 * spent / images, 2) for name, spent in stages.seconds.items()},
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--models", type=Path, default=MODELS, help="folder of site.onnx, worker.onnx, ...")
    options.add_argument("--precision", nargs="+", choices=("int8", "fp32"), default=["int8", "fp32"])
    options.add_argument("--people", type=int, help="crops per image, whoever is there")
    options.add_argument("--workers", type=int, default=2, help="threads")
    options.add_argument("--source", type=Path, default=SOURCE, help="videos that the streams are made of")
    options.add_argument("--repeats", type=int, default=3, help="passes; all are printed")
    given = options.parse_args()
    cv2.setNumThreads(1)
    paths = streams(given.source)
    for precision in given.precision:
        detector = load_bundled(precision, folder=given.models)
        for number in range(given.repeats):
            line = measure(paths, detector, people=given.people, workers=given.workers)
            about = {"precision": precision, "people": given.people, "workers": given.workers, "pass": number}
            print(json.dumps({**about, **line, "load": round(os.getloadavg()[0], 1)}), flush=True)


if __name__ == "__main__":
    main()
