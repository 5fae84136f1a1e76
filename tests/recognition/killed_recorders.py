"""Recorders to be killed, each in a process of its own: a program, so that they are forked where no thread runs yet.

    python killed_recorders.py FOLDER COUNT

Recorder N writes FOLDER/runN.mcap (odd ones in segments) and, when a frame was handed over, its number and the time to
FOLDER/runN.log. Prints the process ids, then, when all have ended, the signal that ended each (0: it ended by itself).
"""

import hashlib
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from recognition.observations import FrameSet, ViewFrame
from recognition.recording import Recorder
from rigcal.camera import Camera
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

T0 = 1_800_000_000_000_000_000
IMAGE = np.zeros((4, 4, 3), np.uint8)
FRAME_NS = 20_000_000
SEGMENT_S = 0.8


def recorder(path: Path, **options) -> Recorder:
    """Of a rig of two cameras."""
    lens = [90, 90, 32, 24, 0, 0, 0, 0]
    poses = {"cam0": Pose.identity(), "cam1": Pose.from_rvec([0, 0.3, 0], [-1, 0, 0])}
    cameras = tuple(RigCamera(name, Camera("opencv4", (64, 48), lens), pose) for name, pose in poses.items())
    document: dict = {"cameras": [{"id": "cam0"}, {"id": "cam1"}]}
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    document["digest"] = "sha256:" + hashlib.sha256(text.encode()).hexdigest()
    rig = Rig("hall", cameras, "cam0", "PASS", digest=document["digest"])
    return Recorder(path, rig=rig, rig_json=json.dumps(document).encode(), metadata={"seed": "5"}, **options)


def record_until_killed(path: Path, log: Path, seed: int, segment_s: float | None) -> None:
    """50 frames a second of 0-2 kB; the log says when each was handed over."""
    random = np.random.default_rng(seed)
    with recorder(path, segment_s=segment_s) as writing, log.open("w", buffering=1) as handed_over:
        start = time.monotonic()
        for k in range(100_000):
            time.sleep(max(0.0, start + k * FRAME_NS * 1e-9 - time.monotonic()))
            data = random.integers(0, 256, int(random.integers(1, 2_000)), dtype=np.uint8).tobytes()
            t_ns = T0 + k * FRAME_NS
            writing.write_frames(FrameSet(k, t_ns, (ViewFrame(k, t_ns, IMAGE, data, "png"), None)))
            handed_over.write(f"{k} {time.monotonic()}\n")


def main(folder: Path, count: int) -> None:
    """Fork, and wait for their ends."""
    pids = []
    for seed in range(count):
        pid = os.fork()
        if pid == 0:
            record_until_killed(
                folder / f"run{seed}.mcap", folder / f"run{seed}.log", seed, SEGMENT_S if seed % 2 else None
            )
            return
        pids.append(pid)
    print(*pids, flush=True)
    print(*(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in pids), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
