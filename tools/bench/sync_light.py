"""Clocks from a light on rendered cameras, truth known: one JSON object per line, seeds fixed.

A room of small images (320 x 180, 30 fps) is lit by a lamp that goes on and off at uneven times. Each camera sees it
through its own shutter, with its own gain over the image, noise, a tone curve of power 1/2.2 and 8 bits; some go
through H.264. Clocks are unrelated: the cameras' stamps are up to 3 s apart, their rates up to 40 ppm. Per shutter
and number of changes: the error of the offset, the half-width of the claimed interval, and whether it held the truth.

    OPENBLAS_NUM_THREADS=1 python tools/bench/sync_light.py
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Floats
from rigcal.sync.content.lags import CameraLag
from rigcal.sync.content.light.brightness import brightness_of_frames
from rigcal.sync.content.light.lags import LightOptions, light_lags

WIDTH, HEIGHT, FPS = 320, 180, 30.0
_BAR_S = 0.002


@dataclass(frozen=True, slots=True)
class Shutter:
    """How a camera exposes."""

    name: str
    exposure_s: float
    readout_s: float = 0.0


SHUTTERS = (
    Shutter("global 2 ms", 0.002),
    Shutter("global 10 ms", 0.010),
    Shutter("global 30 ms", 0.030),
    Shutter("rolling 20 ms, exposed 5 ms", 0.005, 0.020),
)


@dataclass(frozen=True, slots=True)
class Lamp:
    """When the light changes, in rig seconds: it is off before the first time, on to the second, and so on."""

    times_s: Floats
    brightness: float = 1.0
    """Beside a room lamp; a flash has to be much brighter."""

    def gathered_s(self, t_s: Floats) -> Floats:
        """Seconds of full light from the start to each time."""
        total = np.zeros_like(t_s)
        for index, at_s in enumerate(self.times_s):
            total += (1 if index % 2 == 0 else -1) * np.maximum(t_s - at_s, 0.0)
        return self.brightness * total


@dataclass(frozen=True, slots=True)
class LightCamera:
    """A rendered camera; its true clock is ``t_rig = t_cam + offset_s + drift_ppm 1e-6 t_cam``."""

    shutter: Shutter
    offset_s: float
    drift_ppm: float
    first_s: float
    """Stamp of its first frame."""
    frames: int
    ambient: Floats
    """(H, W) light of the room."""
    gain: Floats
    """(H, W) light of the lamp."""
    fps: float = FPS

    @property
    def t_s(self) -> Floats:
        """(F,) its stamps."""
        return np.asarray(self.first_s + np.arange(self.frames) / self.fps)

    def render(self, lamp: Lamp, rng: np.random.Generator) -> Iterator[NDArray[np.uint8]]:
        """Its frames."""
        noise = rng.standard_normal((8, HEIGHT, WIDTH)).astype(np.float32)
        rows_s = self.shutter.readout_s * (np.arange(HEIGHT) / (HEIGHT - 1) - 0.5)
        for t_s in self.t_s:
            middle_s = t_s + self.offset_s + self.drift_ppm * 1e-6 * t_s + rows_s
            half_s = self.shutter.exposure_s / 2
            part = (lamp.gathered_s(middle_s + half_s) - lamp.gathered_s(middle_s - half_s)) / self.shutter.exposure_s
            light = (self.ambient + part[:, None] * self.gain).astype(np.float32)
            light += noise[rng.integers(8)] * (0.02 * np.sqrt(light) + 0.004)
            yield np.asarray(255 * np.clip(light, 0, 1) ** (1 / 2.2) + 0.5, dtype=np.uint8)


def random_camera(
    shutter: Shutter, rng: np.random.Generator, *, stop_s: float, fps: float = FPS, reference: bool = False
) -> LightCamera:
    """A camera somewhere in the room, that records from before the first change to ``stop_s`` in rig time."""
    offset_s, drift_ppm = (0.0, 0.0) if reference else (rng.uniform(-3, 3), rng.uniform(-40, 40))
    texture = cv2.resize(rng.uniform(0.15, 0.95, (12, 20)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    y, x = np.mgrid[0 : 1 : HEIGHT * 1j, 0 : 1 : WIDTH * 1j]
    centre, size = rng.uniform(0, 1, 2), rng.uniform(0.3, 1.0)
    spot = np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * size**2))
    texture = np.clip(texture, 0.05, 1.0)
    start_s = rng.uniform(0, 1 / fps)
    return LightCamera(
        shutter,
        offset_s,
        drift_ppm,
        start_s - offset_s,
        int(stop_s * fps),
        texture * rng.uniform(0.02, 0.3),
        texture * spot * rng.uniform(0.2, 0.6),
        fps,
    )


@dataclass(frozen=True, slots=True)
class Case:
    """Recordings of one kind."""

    name: str
    shutters: tuple[Shutter, Shutter]
    changes: int
    trials: int = 10
    fps: float = FPS
    """Of the second camera."""
    flash_s: float | None = None
    """Length of flashes instead of switching."""
    crf: int | None = None
    """Quality of H.264 that the frames go through."""
    readouts_given: bool = False


def random_lamp(case: Case, rng: np.random.Generator) -> tuple[Lamp, float]:
    """A light that changes every 0.8 to 3 s, and the time until which to record."""
    times_s = 1.0 + np.cumsum(rng.uniform(0.8, 3.0, case.changes))
    if case.flash_s is None:
        return Lamp(times_s), float(times_s[-1] + 1.0)
    ends_s = times_s + case.flash_s
    return Lamp(np.sort(np.concatenate((times_s, ends_s))), brightness=8.0), float(times_s[-1] + 1.0)


def through_h264(frames: Iterable[NDArray[np.uint8]], crf: int) -> Iterator[NDArray[np.uint8]]:
    """Frames as a video of that quality gives them back."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "video.mp4")
        with av.open(path, "w") as container:
            stream = container.add_stream("libx264", rate=Fraction(30), options={"crf": str(crf), "preset": "veryfast"})
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
            for frame in frames:
                container.mux(
                    stream.encode(av.VideoFrame.from_ndarray(frame, format="gray").reformat(format="yuv420p"))
                )
            container.mux(stream.encode())
        with av.open(path) as container:
            for decoded in container.decode(video=0):
                yield np.asarray(decoded.to_ndarray(format="gray"), dtype=np.uint8)


def measured(case: Case, seed: int) -> tuple[CameraLag, float]:
    """The second camera's clock as found, and its true offset at the same time."""
    rng = np.random.default_rng(seed)
    lamp, stop_s = random_lamp(case, rng)
    cameras = (
        random_camera(case.shutters[0], rng, stop_s=stop_s, reference=True),
        random_camera(case.shutters[1], rng, stop_s=stop_s, fps=case.fps),
    )
    series = []
    for index, camera in enumerate(cameras):
        frames = camera.render(lamp, rng)
        frames = frames if case.crf is None else through_h264(frames, case.crf)
        series.append(brightness_of_frames(f"cam{index}", camera.t_s, frames, coded=case.crf is not None))
    known = {f"cam{index}": shutter.readout_s for index, shutter in enumerate(case.shutters)}
    options = LightOptions(readout_s=known if case.readouts_given else {})
    lag = light_lags(series, reference="cam0", options=options).cameras[1]
    return lag, cameras[1].offset_s + cameras[1].drift_ppm * 1e-6 * lag.at_s


def run_case(case: Case) -> dict[str, object]:
    """One line: errors and bounds of the confident trials."""
    found = [measured(case, 1000 * case.changes + seed) for seed in range(case.trials)]
    known = [(abs(lag.offset_s - truth_s), lag.bound_s) for lag, truth_s in found if lag.confident]
    line: dict[str, object] = {"name": f"light: {case.name}", "changes": case.changes, "trials": case.trials}
    line["confident"] = len(known)
    if known:
        errors_s, bounds_s = np.array(known).T
        rms_ms = 1e3 * float(np.sqrt((errors_s**2).mean()))
        line |= {
            "rms_ms": round(rms_ms, 3),
            "worst_ms": round(1e3 * float(errors_s.max()), 3),
            "bound_median_ms": round(1e3 * float(np.median(bounds_s)), 3),
            "bound_holds": f"{int((errors_s <= bounds_s).sum())}/{len(known)}",
            "bar_ms": 1e3 * _BAR_S,
            "ratio_to_frame": round(rms_ms * FPS / 1e3, 4),
        }
    return line


def cases() -> Iterator[Case]:
    """All kinds of recordings."""
    for shutter in SHUTTERS:
        for changes, trials in ((1, 16), (3, 12), (12, 6)):
            yield Case(shutter.name, (shutter, shutter), changes, trials)
    short, medium, long, rolling = SHUTTERS
    for changes, trials in ((1, 16), (3, 12), (12, 6)):
        yield Case("rolling, readouts given", (rolling, rolling), changes, trials, readouts_given=True)
    yield Case("global 2 ms beside rolling", (rolling, short), 12, 6)
    yield Case("global 2 ms, second camera at 25 fps", (short, short), 12, 6, fps=25.0)
    yield Case("flashes of 1 ms, global 30 ms", (long, long), 12, 6, flash_s=0.001)
    yield Case(
        "flashes of 1 ms, rolling, readouts given", (rolling, rolling), 12, 6, flash_s=0.001, readouts_given=True
    )
    yield Case("flashes of 60 ms, global 10 ms", (medium, medium), 12, 6, flash_s=0.06)
    for shutter in (long, rolling):
        yield Case(f"{shutter.name}, H.264 crf 23", (shutter, shutter), 12, 4, crf=23)


def bench_light() -> Iterator[Mapping[str, object]]:
    """Every line."""
    yield from map(run_case, cases())


if __name__ == "__main__":
    for result in bench_light():
        print(json.dumps(result), flush=True)
