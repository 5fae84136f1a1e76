"""What a worker network saves that knows only the joints that rules look at: parameters, time, and what it costs.

The paper leaves such a network to future work. Both networks are trained alike, on the same crops, and looked at with
the same crops around true boxes; only the joints that both know are compared.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.bundled.decode import decode_joints
from recognition.detectors.bundled.geometry import crop_placing, crop_xyxy
from recognition.detectors.bundled.images import worker_input
from recognition.observations import JOINTS
from rigcal.geometry import Floats
from tools.train.cache import read_image
from tools.train.coco import DataError, DataSet
from tools.train.facts import digest, read_facts
from tools.train.geometry import WORKER_JOINTS
from tools.train.predict import session

FILE = "worker_int8.onnx"
_CROPS = 4
"""Crops in a timed run: about the workers of one picture."""
_RUNS = 200
"""Timed runs of each network; they take turns, so that what else the machine does hits both."""
_NEAR = 0.1
"""Of the crop's height: a joint that is found within this is found there."""


@dataclass(frozen=True, slots=True, eq=False)
class Crops:
    """Crops around N workers, with the joints in pixels of the crops."""

    images: NDArray[np.uint8]
    """(N, 128, 96, 3)."""
    joints: Floats
    """(N, 17, 3) x, y and the data file's flag."""


def saving(full: Path, rules: Path, data: DataSet, say: Callable[[str], None]) -> dict[str, Any]:
    """Figures of two exported worker networks, of all joints and of those of the rules.

    Raises:
        DataError: where one is not exported, or they know the same joints.
    """
    folders = {"all": full, "rules": rules}
    summaries = {key: _summary(folder) for key, folder in folders.items()}
    sessions = {key: session(folder / FILE) for key, folder in folders.items()}
    names = {key: WORKER_JOINTS[summary["options"]["joints"]] for key, summary in summaries.items()}
    shared = [name for name in names["all"] if name in names["rules"]]
    if names["all"] == names["rules"]:
        raise DataError(
            "both networks know the same joints", where=rules, expected="fewer joints", got=", ".join(names["rules"]),
            do_next="Train it so: python -m tools.train fit --network worker --joints rules.",
        )  # fmt: skip
    crops = crops_of(data)
    say(f"{len(crops.images)} crops")
    times_ms = _times_ms(sessions, crops.images[:_CROPS])
    figures: dict[str, Any] = {"crops": len(crops.images), "shared_joints": shared}
    for key, folder in folders.items():
        figures[key] = {
            "joints": len(names[key]),
            "epochs": summaries[key]["epochs"],
            "parameters": summaries[key]["parameters"],
            "bytes": (folder / FILE).stat().st_size,
            "sha256": digest(folder / FILE),
            "ms_per_crop": times_ms[key],
        } | _accuracy(sessions[key], names[key], shared, crops)
    return figures


def crops_of(data: DataSet) -> Crops:
    """A crop around every worker that counts, as the runtime makes them."""
    images, joints = [], []
    for picture in data.pictures:
        people = picture.truth.picked((picture.truth.classes == 0) & ~picture.truth.ignore)
        image = read_image(picture) if len(people.classes) else np.zeros((0, 0, 3), dtype=np.uint8)
        for crop, points in zip(crop_xyxy(people.boxes), people.points, strict=True):
            placing = crop_placing(crop)
            images.append(worker_input(image, placing))
            joints.append(np.concatenate([placing.to_input(points[:, :2]), points[:, 2:]], axis=1))
    if not images:
        raise DataError(
            "there is no worker", where=data.source, expected="one or more", got="none", do_next="Render more."
        )
    return Crops(np.stack(images), np.stack(joints))


def _summary(folder: Path) -> dict[str, Any]:
    """``export.json`` of a worker network that is there."""
    summary = read_facts(folder / "export.json")
    if summary is None or summary["options"]["network"] != "worker" or not (folder / FILE).is_file():
        raise DataError(
            "there is no exported worker network", where=folder, expected=f"{FILE} and its export.json", got="none",
            do_next="Export it first: python -m tools.train export --help.",
        )  # fmt: skip
    return summary


def _times_ms(sessions: dict[str, Any], crops: NDArray[np.uint8]) -> dict[str, float]:
    """Median milliseconds per crop, one thread."""
    times: dict[str, list[float]] = {key: [] for key in sessions}
    for _ in range(_RUNS):
        for key, network in sessions.items():
            start = time.perf_counter()
            network.run(None, {"image": crops})
            times[key].append(1000.0 * (time.perf_counter() - start) / len(crops))
    return {key: float(np.median(values)) for key, values in times.items()}


def _accuracy(network: Any, names: tuple[str, ...], shared: list[str], crops: Crops) -> dict[str, float]:
    """Median error and recall of the shared joints in the crops, as shares of the crops' height."""
    found = []
    for image in crops.images:
        heat, states, _ = network.run(None, {"image": image[None]})
        found.append(decode_joints(heat, states)[0, [names.index(name) for name in shared], :2])
    true = crops.joints[:, [JOINTS.index(name) for name in shared]]
    error = np.linalg.norm(np.stack(found) - true[..., :2], axis=-1) / crops.images.shape[1]
    labelled, visible = error[true[..., 2] > 0], error[true[..., 2] == 2]
    return {
        "median_visible": float(np.median(visible)) if len(visible) else float("nan"),
        "recall_near": float((labelled <= _NEAR).mean()) if len(labelled) else float("nan"),
    }
