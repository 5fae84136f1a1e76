"""`make bench-calibration`: rigcal's calibration beside others', on the same corners, against the truth and its bound.

Every line is a JSON object: first one per rig, seed and method, then the summary. Finished ones are kept in the file of
--results and not run again, so that a long run can be stopped and resumed; those in which rigcal took part are run
again after a change of its modules. Every method has one thread (set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1, as
make does), so that times are comparable on a busy machine. The long runs, some hours:

    python tools/bench/calibration.py --seeds 20 --rigs ring,spaced,line --cameras 4,8,16,32 --peers-up-to 8
    python tools/bench/calibration.py --seeds 20 --rigs triple --cameras 8 --methods ours
    python tools/bench/calibration.py --seeds 20 --rigs ring --cameras 8 --noise 0.1,0.3 --methods ours,ideal
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from fisher import position_bound_m
from methods import METHODS, Answer, Stopwatch
from rigs import RIGS, BenchSite, Planted, plant
from scoring import aligned_rms_m, held_out_rmse_px, naming, normalised_squared_error, position_errors_m
from summary import summaries
from venvs import REQUIREMENTS, PeerFailedError, PeerUnavailableError, ask

from rigcal.errors import RigcalError

ALL_METHODS = (*METHODS, *REQUIREMENTS)
SLOW = ("multiview", *REQUIREMENTS)
"""Peers whose time grows so fast with the cameras that ``--peers-up-to`` bounds them."""
WITH_RIGCAL = ("ours", "ideal", "pycolmap")
"""Methods whose figures change when rigcal does."""
Line = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Job:
    """One rig with one seed, calibrated by one method."""

    rig: str
    cameras: int
    noise_px: float
    seed: int
    data: str
    """``clean`` or ``bad``."""
    method: str
    code: str
    """Digest of rigcal's modules where they take part, else empty."""


def jobs(wanted: argparse.Namespace) -> Iterator[Job]:
    """What the options ask for, the jobs of one site one after the other."""
    code = _rigcal_digest()
    for cameras, rig, noise_px, seed in product(wanted.cameras, wanted.rigs, wanted.noise, range(wanted.seeds)):
        for data, method in product(wanted.data, wanted.methods):
            if method not in SLOW or cameras <= wanted.peers_up_to:
                yield Job(rig, cameras, noise_px, seed, data, method, code if method in WITH_RIGCAL else "")


def _rigcal_digest() -> str:
    modules = sorted((Path(__file__).resolve().parents[2] / "rigcal").glob("*.py"))
    return hashlib.sha256(b"".join(module.read_bytes() for module in modules)).hexdigest()[:12]


def measured(job: Job, site: BenchSite) -> Line:
    """Run one job.

    Raises:
        PeerUnavailableError: where the method cannot be installed here.
    """
    detections, planted = (site.detections, ()) if job.data == "clean" else plant(site, job.seed)
    try:
        with Stopwatch() as watch:
            in_process = METHODS.get(job.method)
            answer = in_process(site, detections) if in_process else ask(job.method, detections)
    except (RigcalError, PeerFailedError, cv2.error, ValueError, np.linalg.LinAlgError) as failed:
        return {**asdict(job), "failed": " ".join(str(failed).split())}
    return {
        **asdict(job),
        **_scores(site, answer),
        **watch.named(""),
        **answer.seconds,
        **_self_judgement(site, answer, planted),
    }


def _scores(site: BenchSite, answer: Answer) -> Line:
    errors_mm = 1e3 * position_errors_m(site, answer.estimate.cam_from_rig)
    return {
        "rms_mm": float(np.sqrt((errors_mm**2).mean())),
        "worst_mm": float(errors_mm.max()),
        "bound_mm": 1e3 * position_bound_m(site),
        "aligned_mm": 1e3 * aligned_rms_m(site, answer.estimate.cam_from_rig),
        "held_out_px": held_out_rmse_px(site, answer.estimate),
        "by_camera_mm": errors_mm.tolist(),
    }


def _self_judgement(site: BenchSite, answer: Answer, planted: tuple[Planted, ...]) -> Line:
    """What a method says of itself, against the truth: its sigmas, and the views that it named."""
    if answer.calibration is None:
        return {}
    squared = normalised_squared_error(site, answer.calibration)
    return {"nees": squared, **asdict(naming(answer.calibration, planted))}


def run(wanted: argparse.Namespace) -> int:
    """Say every line that was asked for, then what they say together."""
    cv2.setNumThreads(1)
    lines: list[Line] = []
    for line in measurements(wanted):
        _say(line)
        lines.append(line)
    for line in summaries(lines):
        _say(line)
    return 0


def measurements(wanted: argparse.Namespace) -> Iterator[Line]:
    """One line per job: as kept, or else measured now and kept; one line per peer that cannot be installed."""
    done = _finished(wanted.results)
    wanted.results.parent.mkdir(parents=True, exist_ok=True)
    unavailable: set[str] = set()
    for job in jobs(wanted):
        if job in done:
            yield done[job]
        elif job.method not in unavailable:
            try:
                line = measured(job, _site(job.rig, job.cameras, job.seed, job.noise_px))
            except PeerUnavailableError as missing:
                unavailable.add(job.method)
                yield {"method": job.method, "skipped": str(missing)}
                continue
            with wanted.results.open("a") as file:
                file.write(json.dumps(line) + "\n")
            yield line


@lru_cache(maxsize=1)
def _site(rig: str, cameras: int, seed: int, noise_px: float) -> BenchSite:
    return RIGS[rig](cameras, seed, noise_px)


def _finished(results: Path) -> dict[Job, Line]:
    if not results.exists():
        return {}
    lines = [json.loads(text) for text in results.read_text().splitlines()]
    return {Job(*[line[name] for name in Job.__slots__]): line for line in lines}


def _say(line: Line) -> None:
    rounded = {key: _rounded(value) for key, value in line.items()}
    print(json.dumps(rounded), flush=True)


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def parser() -> argparse.ArgumentParser:
    """The options; their defaults are a run of about ten minutes."""

    def names(allowed: tuple[str, ...]) -> Any:
        def parse(text: str) -> list[str]:
            chosen = text.split(",")
            if unknown := set(chosen) - set(allowed):
                raise argparse.ArgumentTypeError(f"{', '.join(sorted(unknown))}: choose from {', '.join(allowed)}")
            return chosen

        return parse

    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--rigs", type=names(tuple(RIGS)), default=["ring", "line"], help="kinds of rig")
    options.add_argument("--cameras", type=_integers, default=[4, 8, 16], help="cameras of each rig")
    options.add_argument("--seeds", type=int, default=1, help="how many seeds, from 0")
    options.add_argument("--methods", type=names(ALL_METHODS), default=list(ALL_METHODS), help="what to compare")
    options.add_argument("--data", type=names(("clean", "bad")), default=["clean", "bad"], help="clean, bad or both")
    options.add_argument("--noise", type=_floats, default=[0.2], help="sigma of a corner per axis, in pixels")
    options.add_argument("--peers-up-to", type=int, default=4, help="most cameras that slow peers are given")
    options.add_argument("--results", type=Path, default=Path("out/bench-calibration.jsonl"), help="kept results")
    return options


def _integers(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


def _floats(text: str) -> list[float]:
    return [float(part) for part in text.split(",")]


if __name__ == "__main__":
    sys.exit(run(parser().parse_args()))
