"""`make bench-runtime`: from 2D detections to tracks in 3D, ours beside the paper's method; one JSON object per line.

Parts: ``frame_set`` (four cameras, four workers, 14 objects), ``growth`` (to 20 cameras and 20 workers, drawn to
``out/bench-runtime.svg``), ``crowds`` (what the tracks are worth, see :mod:`runtime_crowds`) and ``rejudge`` (an hour
judged by other rules, see :mod:`runtime_rejudge`). Times are the CPU time
of one thread, which is what other work on the machine lengthens least; of the frame set also the time on the wall.
Fixed seeds.

    python tools/bench/runtime.py [frame_set growth crowds rejudge]
"""

from __future__ import annotations

import json
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np
from runtime_crowds import METHODS, crowds, placer_of
from runtime_plot import Curve, growth_plot
from runtime_rejudge import rejudge

from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_crowds import Crowd
from recognition.synthetic_views import DetectorNoise, observe, with_noise

Line = Mapping[str, Any]
PLOT = Path("out") / "bench-runtime.svg"
NOISE = DetectorNoise(pixel_sigma=3.0, missing_joint=0.05, missed=0.03, false_per_view=0.1)
FRAMES, GROWTH_FRAMES = 900, 40
CAMERAS, WORKERS = (4, 8, 12, 16, 20), (1, 4, 8, 12, 16, 20)
FPS = 30.0


def frame_set() -> Iterator[Line]:
    """Association, triangulation and tracking of a frame set, each method in a process of its own, so that the first
    frame set is the first that its code sees."""
    lines = {method: in_new_process(frame_set_of, method) for method in METHODS}
    for method, line in lines.items():
        yield {"name": f"runtime.frame_set.{method}"} | line
    yield {
        "name": "runtime.frame_set.ratio",
        **{key: lines["tracked"][key] / lines["paper"][key] for key in ("median_ms", "p99_ms", "first_ms")},
    }


def frame_set_of(method: str) -> Line:
    """Half a minute of one method."""
    cpu_ms, wall_ms = _times_ms(method, cameras=4, workers=4, frames=FRAMES)
    return {
        "frames": FRAMES,
        "median_ms": float(np.median(cpu_ms)),
        "p99_ms": float(np.quantile(cpu_ms, 0.99)),
        "worst_ms": float(cpu_ms.max()),
        "first_ms": float(cpu_ms[0]),
        "wall_median_ms": float(np.median(wall_ms)),
        "wall_p99_ms": float(np.quantile(wall_ms, 0.99)),
        "wall_first_ms": float(wall_ms[0]),
    }


def growth() -> Iterator[Line]:
    """How the time of a frame set grows with cameras and workers: the median of a second, after the third in which
    everybody appears; the worst is the first frame set, in which nobody is known and all have to be told apart."""
    curves = []
    for method in METHODS:
        for cameras in CAMERAS:
            median_ms = []
            for workers in WORKERS:
                cpu_ms, _ = _times_ms(method, cameras=cameras, workers=workers, frames=GROWTH_FRAMES)
                median_ms.append(float(np.median(cpu_ms[GROWTH_FRAMES // 4 :])))
                yield {
                    "name": f"runtime.growth.{method}.{cameras}cameras_{workers}workers",
                    "median_ms": median_ms[-1],
                    "worst_ms": float(cpu_ms.max()),
                }
            curves.append(Curve(method, cameras, WORKERS, tuple(median_ms)))
    PLOT.parent.mkdir(exist_ok=True)
    PLOT.write_text(growth_plot(curves, frame_ms=1e3 / FPS), encoding="utf-8")
    yield {"name": "runtime.growth.plot", "file": str(PLOT)}


def in_new_process(action: Callable[[str], Line], argument: str) -> Line:
    """What a function of this module returns in a fresh interpreter."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(action, argument).result()


def _times_ms(method: str, *, cameras: int, workers: int, frames: int) -> tuple[Any, Any]:
    """CPU and wall time (F,) of each frame set."""
    rig = semicircle_rig(cameras)
    site = simulate(rig, workers=workers, frames=frames, fps=FPS, seed=0)
    views = tuple(with_noise(observe(site, frame), rig, NOISE, seed=(0, frame)) for frame in range(frames))
    place, times = placer_of(rig, method), []
    for instant in Crowd(site, views).instants:
        cpu_ns, wall_ns = time.thread_time_ns(), time.perf_counter_ns()
        place(instant)
        times.append((time.thread_time_ns() - cpu_ns, time.perf_counter_ns() - wall_ns))
    return tuple(1e-6 * np.array(times, dtype=float).T)


PARTS: Mapping[str, Callable[[], Iterator[Line]]] = {
    "frame_set": frame_set,
    "growth": growth,
    "crowds": crowds,
    "rejudge": rejudge,
}


def main(names: list[str]) -> int:
    """Run the named parts, or all."""
    if unknown := [name for name in names if name not in PARTS]:
        raise SystemExit(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    for name in names or PARTS:
        for line in PARTS[name]():
            rounded = {key: float(f"{v:.4g}") if isinstance(v, float) else v for key, v in line.items()}
            print(json.dumps(rounded), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
