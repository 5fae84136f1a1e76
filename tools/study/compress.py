"""What compression costs: videos of a sequence encoded again, looked at by the networks, placed and judged.

The videos of a sequence are H.264 already, at a CRF of 20; they are decoded and encoded again as
:class:`tools.sicsg.sequences.Video` does it, at the CRF that is tried, into a folder that is a sequence like any other.
What the networks see in it is kept, so that other rules judge it in seconds.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import av
import numpy as np

from recognition.detectors import Detector
from recognition.evaluation.violations import observe, scenes, seen_with
from recognition.rules import RuleSet
from tools.sicsg.scene import read_scene
from tools.sicsg.sequences import Video
from tools.study.faults import Axis
from tools.study.trial import Tally, judged, tally

AXIS, NETWORKS = "h264", "networks"
AS_IT_IS = 0.0
"""No compression beyond the sequence's own videos."""
COMPRESSION = Axis("H.264 encoded again", "CRF (0: as it is)", (AS_IT_IS, 28.0, 34.0, 40.0, 46.0), (NETWORKS,))


def tally_compressed(folder: Path, detector: Detector, rules: RuleSet, cache: Path) -> Tally:
    """What is decided of a sequence by all its cameras, with the networks, counted.

    Args:
        folder: Of the sequence, such as :func:`compressed` returns.
        detector: The networks.
        rules: What is judged.
        cache: Where what the networks saw is kept.
    """
    seen = observe(folder, "validation", detector, cache)
    use = (True,) * len(seen.rig.cameras)
    placed = scenes(seen_with(seen.instants, use), seen.rig, use, "tracked")
    return tally(seen.truth, judged(seen.truth, placed, rules, seen.rig))


def compressed(folder: Path, crf: float, kept: Path) -> Path:
    """The sequence with its videos encoded again, made where it is not there yet.

    Args:
        folder: Of the sequence.
        crf: Constant rate factor of x264; :data:`AS_IT_IS` for the sequence itself.
        kept: Where such sequences are kept.
    """
    if crf == AS_IT_IS:
        return folder
    made = kept / f"crf{crf:g}" / folder.name
    if (made / "truth.json").exists():
        return made
    made.mkdir(parents=True, exist_ok=True)
    for camera in read_scene(folder / "scene.json").cameras:
        video = Video(made / f"{camera.id}.mp4", camera, round(crf))
        with av.open(str(folder / f"{camera.id}.mp4")) as own:
            for frame in own.decode(video=0):
                video.add(np.asarray(frame.to_ndarray(format="bgr24"), dtype=np.uint8))
        video.close()
    for name in ("true.rig.json", "timestamps.csv", "scene.json", "truth.npz", "truth.json"):
        shutil.copy(folder / name, made / name)
    return made


def kbit_per_s(folder: Path) -> float:
    """Mean bit rate of a sequence's cameras."""
    rates = []
    for camera in read_scene(folder / "scene.json").cameras:
        with av.open(str(folder / f"{camera.id}.mp4")) as file:
            sizes = [packet.size for packet in file.demux(video=0) if packet.size]
        rates.append(8e-3 * camera.fps * sum(sizes) / len(sizes))
    return sum(rates) / len(rates)
