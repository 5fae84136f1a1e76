"""Clocks from a moving board: films with known clocks through the whole path, and exact tracks with noise.

Films are 640x360 pixels at 30 frames a second, three cameras, H.264, exposures of 4 ms that blur what moves, and rows
read one by one where the shutter is rolling. Corners are found, clocks estimated and held against the truth.

    python tools/bench/sync_board.py
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.board import Checkerboard
from rigcal.captures import open_capture
from rigcal.geometry import Floats
from rigcal.rig import Rig
from rigcal.stamps import frame_stamps
from rigcal.sync.content.board.follow import FrameBudget, board_tracks
from rigcal.sync.content.lags import ContentLags
from rigcal.sync.content.points.solve import LagOptions, estimate_lags
from rigcal.sync.content.synthetic import CameraClock, carried_board, exact_tracks, with_noise
from rigcal.sync.content.synthetic_video import Shutter, write_capture
from rigcal.sync.content.tracks import PointTracks
from rigcal.synthetic import arc_rig

Line = Mapping[str, Any]
BOARD = Checkerboard(9, 6, 0.06)
SECONDS = 8.0


@dataclass(slots=True)
class Score:
    """Errors of the cameras that were confident, beside their bounds."""

    error_ms: list[float] = field(default_factory=list)
    bound_ms: list[float] = field(default_factory=list)
    drift_error_ppm: list[float] = field(default_factory=list)
    drift_bound_ppm: list[float] = field(default_factory=list)
    refused: int = 0

    def add(self, lags: ContentLags, clocks: Mapping[str, CameraClock]) -> None:
        """Compare with the truth."""
        for lag in lags.cameras:
            truth = clocks[lag.camera_id]
            if lag.camera_id == lags.reference:
                continue
            if not lag.confident:
                self.refused += 1
                continue
            due_s = truth.offset_s + truth.drift_ppm * 1e-6 * lag.at_s
            self.error_ms.append(1e3 * (lag.offset_s - due_s))
            self.bound_ms.append(1e3 * lag.bound_s)
            self.drift_error_ppm.append(lag.drift_ppm - truth.drift_ppm)
            self.drift_bound_ppm.append(lag.drift_bound_ppm)

    def line(self, name: str, bar_ms: float | None = None) -> dict[str, Any]:
        """Figures."""
        error, bound = np.abs(self.error_ms), np.array(self.bound_ms)
        drift = np.abs(self.drift_error_ppm)
        rms_ms = float(np.sqrt(np.mean(error**2)))
        return {
            "name": f"sync_board.{name}",
            "cameras": len(error),
            "refused": self.refused,
            "offset_rms_ms": rms_ms,
            "offset_worst_ms": float(error.max()),
            "bound_mean_ms": float(bound.mean()),
            "covered_share": float((error <= bound).mean()),
            "drift_rms_ppm": float(np.sqrt(np.mean(drift**2))),
            "drift_covered_share": float((drift <= np.array(self.drift_bound_ppm)).mean()),
        } | ({} if bar_ms is None else {"bar_ms": bar_ms, "ratio": rms_ms / bar_ms})


def site(count: int, size_wh: tuple[int, int]) -> Rig:
    """Cameras about two metres from a board."""
    return arc_rig(count, arc_deg=25.0 * (count - 1), radius_m=2.2, height_m=1.6, size_wh=size_wh)


def random_clocks(rig: Rig, rng: np.random.Generator, *, readout_s: float = 0.0) -> dict[str, CameraClock]:
    """Clocks up to 0.4 s and 50 ppm apart; cameras start their frames when they like."""
    clocks = {}
    for number, camera in enumerate(rig.cameras):
        offset_s, drift_ppm = (rng.uniform(-0.4, 0.4), rng.uniform(-50, 50)) if number else (0.0, 0.0)
        clocks[camera.id] = CameraClock(offset_s, drift_ppm, readout_s, rng.uniform(0, 1 / 30))
    return clocks


def films(seeds: Sequence[int]) -> Iterator[Line]:
    """Rendered video from end to end: global shutters, and 20 ms of readout given and estimated."""
    rig = site(3, (640, 360))
    for shutter, readout_s in (("global", 0.0), ("rolling", 0.02)):
        given, estimated, readout_ms, search_s = Score(), Score(), [], 0.0
        for seed in seeds:
            clocks = random_clocks(rig, np.random.default_rng(seed), readout_s=readout_s)
            start = time.perf_counter()
            tracks = _filmed(rig, clocks, seed)
            search_s += tracks.search_s
            known = LagOptions(readout_s=dict.fromkeys(clocks, readout_s), estimate_readout=False)
            given.add(estimate_lags(rig, tracks.tracks, method="board", options=known), clocks)
            lags = estimate_lags(rig, tracks.tracks, method="board")
            estimated.add(lags, clocks)
            readout_ms += [1e3 * ((lag.readout_s or 0.0) - readout_s) for lag in lags.cameras]
            whole_s = time.perf_counter() - start
        bar_ms = 0.5 if readout_s else 0.05
        yield given.line(f"film.{shutter}.given", bar_ms) | {"search_s": search_s / len(seeds), "last_run_s": whole_s}
        readout_rms_ms = float(np.sqrt(np.mean(np.square(readout_ms))))
        yield estimated.line(f"film.{shutter}.estimated", bar_ms) | {"readout_rms_ms": readout_rms_ms}


@dataclass(frozen=True, slots=True)
class Filmed:
    """What was found in a film, and how long the search took."""

    tracks: tuple[PointTracks, ...]
    search_s: float


def _filmed(rig: Rig, clocks: Mapping[str, CameraClock], seed: int) -> Filmed:
    with tempfile.TemporaryDirectory() as name:
        motion = carried_board(rig, BOARD, seed=seed)
        shutter = Shutter(sub_exposures=3)
        write_capture(Path(name), rig, BOARD, motion, clocks, seconds=SECONDS, shutter=shutter, seed=seed)
        capture = open_capture(Path(name))
        stamps = frame_stamps(capture)
        if stamps is None:
            raise SystemExit("the film has no stamps")
        start = time.perf_counter()
        tracks = board_tracks(capture, BOARD, rig, stamps, budget=FrameBudget())
        return Filmed(tracks, time.perf_counter() - start)


def exact(seeds: Sequence[int]) -> Iterator[Line]:
    """Exact tracks with noise: coverage over many seeds, a calibration that is off, and drift over a minute."""
    board, rig = Checkerboard(4, 3, 0.12), site(3, (1920, 1080))
    noise, bias, minute = Score(), Score(), Score()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        clocks = random_clocks(rig, rng)
        near = {camera_id: clock.offset_s for camera_id, clock in clocks.items()}
        options = LagOptions(search_s=0.1)
        tracks = exact_tracks(rig, board, carried_board(rig, board, seed=seed), clocks, seconds=12.0)
        tracks = tuple(_shaken(track, 0.1, rng) for track in with_noise(tracks, 0.1, seed=seed))
        noise.add(estimate_lags(rig, tracks, method="board", options=options, start_s=near), clocks)
        lags = estimate_lags(_miscalibrated(rig, rng), tracks, method="board", options=options, start_s=near)
        bias.add(lags, clocks)
        if seed < seeds[0] + len(seeds) // 5:
            motion = carried_board(rig, board, seed=seed)
            tracks = with_noise(exact_tracks(rig, board, motion, clocks, seconds=60.0), 0.1, seed=seed)
            minute.add(estimate_lags(rig, tracks, method="board", options=options, start_s=near), clocks)
    yield noise.line("exact.0.1px")
    yield bias.line("exact.2px_bias")
    yield minute.line("exact.60s")


def _shaken(track: PointTracks, sigma_px: float, rng: np.random.Generator) -> PointTracks:
    """Tracks with an error that the whole board shares, and that lasts a third of a second."""
    error: Floats = np.zeros((len(track.t_s), 1, 2))
    for frame in range(1, len(error)):
        error[frame] = 0.9 * error[frame - 1] + rng.normal(0, sigma_px * np.sqrt(1 - 0.9**2), (1, 2))
    return replace(track, points_px=track.points_px + error)


def _miscalibrated(rig: Rig, rng: np.random.Generator) -> Rig:
    """The rig with cameras turned and moved by about two pixels, and lenses that are off by 0.2 %."""
    cameras = [rig.cameras[0]]
    for camera in rig.cameras[1:]:
        params = camera.camera.params * np.append(rng.normal(1, 0.002, 2), np.ones(len(camera.camera.params) - 2))
        pose = camera.cam_from_rig.perturbed(rng.normal(0, 1.2e-3, 3), rng.normal(0, 0.003, 3))
        cameras.append(replace(camera, camera=camera.camera.with_params(params), cam_from_rig=pose))
    return replace(rig, cameras=tuple(cameras))


def lines() -> Iterator[Line]:
    """Everything."""
    yield from films(range(2))
    yield from exact(range(20))


if __name__ == "__main__":
    for line in lines():
        print(json.dumps(line), flush=True)
