"""Simulated sites with one fault each, through the command line: does `rigcal sync verify` name camera and fault?

A site is a rig file, a site file, a responder per camera host (real sockets, simulated clocks) and a film of a carried
board. Every camera's stamps are by its host's clock, so that the rig file's clocks, which `sync probe` writes, matter.

    python tools/bench/sync_sites.py
"""

from __future__ import annotations

import contextlib
import csv
import json
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.board import Checkerboard
from rigcal.captures import open_capture, read_frames
from rigcal.rig import Rig
from rigcal.rigfile import document_of_rig, write_rigfile
from rigcal.stamps import TIMESTAMPS
from rigcal.sync.content.synthetic import CameraClock, carried_board
from rigcal.sync.content.synthetic_video import _write_video, write_capture
from rigcal.sync.network import SimulatedClock, serve
from rigcal.synthetic import arc_rig

BOARD = Checkerboard(7, 6, 0.12)
SIZE_WH = (640, 360)
SECONDS, FPS = 5.0, 30.0
AHEAD_S = {"cam0": 0.0015, "cam1": -0.004, "cam2": 0.0025, "cam3": 0.006}
"""How far each host's clock is ahead of the rig's."""


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong with a site."""

    name: str
    camera: str
    finding: str
    """The name under which the check should report it."""
    host: Mapping[str, float] = field(default_factory=dict)
    """What is otherwise with the camera's host at the check than when the rig file was written."""
    dead: tuple[str, ...] = ()
    film: Callable[[Path], None] | None = None
    """What is done to the capture."""


@dataclass(frozen=True, slots=True)
class Checked:
    """What the check said of a site."""

    fault: str
    code: int
    told: Mapping[str, list[tuple[str, str]]]
    """(finding, colour) by camera; green cameras have none."""
    seconds: float


def site_rig() -> Rig:
    return arc_rig(4, radius_m=3.5, arc_deg=80, size_wh=SIZE_WH, seed=4)


def film_site(folder: Path, *, seconds: float = SECONDS, fps: float = FPS) -> None:
    """The capture of a healthy site, and its rig file without clocks."""
    rig = site_rig()
    motion = carried_board(rig, BOARD, seed=7)
    epoch_s = float(int(time.time()))
    clocks = {c: CameraClock(offset_s=-ahead, phase_s=0.01) for c, ahead in AHEAD_S.items()}
    write_capture(folder / "board", rig, BOARD, motion, clocks, seconds=seconds, fps=fps, epoch_s=epoch_s)
    made = document_of_rig(rig, created_utc="2026-11-22T09:00:00Z", inputs_sha256="0" * 64, board=BOARD)
    write_rigfile(made, folder / "hall.rig.json")


def film_slow(folder: Path) -> None:
    """The same, filmed by cam2 that free-runs at 29.83 frames per second."""
    with (folder / "board" / TIMESTAMPS).open(encoding="utf-8") as file:
        epoch_s = float(int(float(next(iter(csv.DictReader(file)))["frame_time"])))
    rig = site_rig()
    cam2 = {"cam2": CameraClock(offset_s=-AHEAD_S["cam2"], phase_s=0.01)}
    motion = carried_board(rig, BOARD, seed=7)
    write_capture(folder / "slow", rig, BOARD, motion, cam2, seconds=SECONDS, fps=29.83, epoch_s=epoch_s)


def clocks() -> dict[str, SimulatedClock]:
    return {camera_id: SimulatedClock(offset_s=ahead) for camera_id, ahead in AHEAD_S.items()}


@contextlib.contextmanager
def hosts(clocks: Mapping[str, SimulatedClock]) -> Iterator[dict[str, int]]:
    """A responder per camera; yields their ports."""
    stop, ports = threading.Event(), {}
    threads = []
    for camera_id, clock in clocks.items():
        ready = threading.Event()

        def note(places: tuple[str, ...], camera_id: str = camera_id, ready: threading.Event = ready) -> None:
            ports[camera_id] = int(places[0].rpartition(":")[2])
            ready.set()

        arguments = {"clock": clock, "stop": stop, "on_ready": note}
        thread = threading.Thread(target=serve, args=("127.0.0.1", 0), kwargs=arguments, daemon=True)
        thread.start()
        ready.wait(5)
        threads.append(thread)
    try:
        yield ports
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def write_site(path: Path, ports: Mapping[str, int]) -> None:
    cameras = [
        f'[[cameras]]\nid = "{c}"\nclock = "ntp://127.0.0.1:{port}"\n'
        "capture_latency_s = 0.0\ncapture_latency_bound_s = 0.0005\n"
        for c, port in ports.items()
    ]
    path.write_text('site = "hall"\nfastest_motion_m_per_s = 2.0\n' + "\n".join(cameras), encoding="utf-8")


def rigcal(*arguments: object) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-c", "from rigcal.cli import main; main()"]
    return subprocess.run([*program, *map(str, arguments)], capture_output=True, text=True, check=False)


def check_site(folder: Path, fault: Fault, *, seconds: float) -> Checked:
    """Probe a healthy site into its rig file, let the fault happen, and check it."""
    work = folder / fault.name.replace(" ", "_")
    shutil.copytree(folder / "board", work / "board")
    rig, site = work / "hall.rig.json", work / "hall.site.toml"
    with hosts(clocks()) as ports:
        write_site(site, ports)
        probed = rigcal("sync", "probe", site, "--rig", folder / "hall.rig.json", "-o", rig, "--seconds", seconds)
    if probed.returncode:
        raise RuntimeError(probed.stdout + probed.stderr)
    if fault.film:
        fault.film(work / "board")
    later = {
        c: replace(k, **fault.host) if c == fault.camera else k for c, k in clocks().items() if c not in fault.dead
    }
    with hosts(later) as now:
        write_site(site, ports | now)
        begin = time.perf_counter()
        told = rigcal("sync", "verify", rig, work / "board", "--site", site, "--seconds", seconds, "--json")
        taken_s = time.perf_counter() - begin
    if told.returncode not in (0, 1):
        raise RuntimeError(told.stdout + told.stderr)
    cameras = json.loads(told.stdout)["cameras"]
    findings = {
        camera["id"]: [(f["fault"], f["colour"]) for f in camera["findings"]]
        for camera in cameras
        if camera["findings"]
    }
    return Checked(fault.name, told.returncode, findings, taken_s)


def right(fault: Fault, checked: Checked) -> bool:
    """Whether the fault was named on its camera, and no other camera was called red."""
    red = {c for c, findings in checked.told.items() if any(colour == "red" for _, colour in findings)}
    if not fault.camera:
        return checked.code == 0 and not red
    cameras = set(fault.camera.split("+"))
    named = all(fault.finding in [name for name, _ in checked.told.get(c, [])] for c in cameras)
    return named and red == cameras and checked.code == 1


def _restamped(change: Callable[[str, np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> Callable[[Path], None]:
    """A change of the stamps of each camera."""

    def apply(capture: Path) -> None:
        path = capture / TIMESTAMPS
        with path.open(newline="", encoding="utf-8") as file:
            rows = [(row["cam_id"], float(row["frame_time"])) for row in csv.DictReader(file)]
        with path.open("w", newline="", encoding="utf-8") as file:
            out = csv.writer(file)
            out.writerow(("cam_id", "frame_time"))
            for camera_id in dict.fromkeys(c for c, _ in rows):
                times = change(camera_id, np.array([t for c, t in rows if c == camera_id]))
                out.writerows((camera_id, f"{t:.9f}") for t in times)

    return apply


def late(capture: Path) -> None:
    """cam1 stamps its frames 12 ms after they were taken."""
    _restamped(lambda c, t: t + 0.012 if c == "cam1" else t)(capture)


def arrival(capture: Path) -> None:
    """cam3's frames are stamped when they arrive, 4 ms late on average and up to 40."""
    rng = np.random.default_rng(3)
    _restamped(lambda c, t: np.maximum.accumulate(t + rng.gamma(1.0, 0.006, len(t))) if c == "cam3" else t)(capture)


def dropped(capture: Path) -> None:
    """cam1 lost five frames in two places."""
    lost = [50, 51, 52, 110, 111]
    video = open_capture(capture).cameras[1]
    kept = [image for index, image in read_frames(video) if index not in lost]
    _write_video(capture / "cam1.mp4", iter(kept), FPS)
    _restamped(lambda c, t: np.delete(t, lost) if c == "cam1" else t)(capture)


def slow(capture: Path) -> None:
    """cam2 free-runs at 29.83 frames per second."""
    other = capture.parents[1] / "slow"
    shutil.copy(other / "cam2.mp4", capture / "cam2.mp4")
    with (other / TIMESTAMPS).open(newline="", encoding="utf-8") as file:
        times = np.array([float(row["frame_time"]) for row in csv.DictReader(file)])
    _restamped(lambda c, t: times if c == "cam2" else t)(capture)


def swapped(capture: Path) -> None:
    """The files of cam1 and cam2 are exchanged."""
    (capture / "cam1.mp4").rename(capture / "other.mp4")
    (capture / "cam2.mp4").rename(capture / "cam1.mp4")
    (capture / "other.mp4").rename(capture / "cam2.mp4")


def faults() -> tuple[Fault, ...]:
    return (
        Fault("healthy", "", ""),
        Fault("stepped clock", "cam2", "stepped clock", {"offset_s": 0.3}),
        Fault("12 ms offset", "cam1", "offset", film=late),
        Fault("40 ppm drift", "cam3", "drift", {"skew_ppm": 40.0}),
        Fault("dropped frames", "cam1", "dropped frames", film=dropped),
        Fault("29.83 fps", "cam2", "frame rate", film=slow),
        Fault("arrival stamps", "cam3", "arrival stamps", film=arrival),
        Fault("swapped files", "cam1+cam2", "swapped cameras", film=swapped),
        Fault("dead host", "cam0", "dead host", dead=("cam0",)),
    )


def sites(seconds: float = 10.0) -> Iterator[dict[str, Any]]:
    """Eight faulty sites and a healthy one."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        film_site(folder)
        film_slow(folder)
        results = [(fault, check_site(folder, fault, seconds=seconds)) for fault in faults()]
    for fault, checked in results:
        yield {
            "name": f"sync.site.{fault.name.replace(' ', '_')}",
            "right": right(fault, checked),
            "camera": fault.camera,
            "told": {
                camera_id: [f"{f} ({colour})" for f, colour in found] for camera_id, found in checked.told.items()
            },
            "exit_code": checked.code,
            "verify_s": round(checked.seconds, 2),
        }


if __name__ == "__main__":
    for line in sites():
        print(json.dumps(line))
