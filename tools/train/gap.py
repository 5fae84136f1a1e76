"""How far the bundled networks, which know rendered workers only, are from real people.

On a real capture with detections of OpenPose, which stand in for the truth: they have errors of their own, a few pixels
at joints that are seen, and miss people in the distance. What is compared is what the detector gives at its own
thresholds. A person found is the one of OpenPose whose joints are nearest, in the mean over shared joints, if nearer
than :data:`SAME` times that person's height; else nobody.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recognition.association import match
from recognition.detectors import load_bundled
from recognition.observations import JOINTS
from rigcal.geometry import Floats, Ints
from tools.train.facts import PRECISIONS, digests

SAME = 0.25
"""Of a person's height."""
NEAR = 0.1
"""Of a person's height: a joint that is found within this is found there."""
_SURE = 0.3
"""Score of OpenPose from which on a joint counts."""
_ENOUGH = 8
"""Joints from which on a person is asked for; who has fewer is cut off, hidden or far, and is only no error."""
_SHARED = 3
"""Joints that two people must share to be compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """One image: N people asked for, by OpenPose."""

    error_px: Floats
    """(N, 17) distance of the joints; NaN where either has none, or the person is not found."""
    known: NDArray[np.bool_]
    """(N, 17) joints that OpenPose has."""
    height_px: Floats
    """(N,)."""
    found: NDArray[np.bool_]
    """(N,)."""
    false: int
    """People found that are none of OpenPose's, asked for or not."""


def compare(truth: Floats, found_px: Floats) -> Compared:
    """One image.

    Args:
        truth: (N, 17, 3) x, y, score of OpenPose.
        found_px: (P, 17, 2) joints of the detector; NaN where it has none.
    """
    known = truth[..., 2] >= _SURE
    height_px = np.array([_height_px(person[sure]) for person, sure in zip(truth[..., :2], known, strict=True)])
    apart = np.linalg.norm(np.where(known[..., None], truth[..., :2], np.nan)[:, None] - found_px[None], axis=-1)
    shared = np.isfinite(apart)
    count = shared.sum(axis=-1)
    relative = np.where(shared, apart, 0.0).sum(axis=-1) / np.maximum(count, 1) / height_px[:, None]
    rows, columns = match(np.where(count >= _SHARED, relative, np.inf), SAME)
    errors = np.full(known.shape, np.nan)
    errors[rows] = apart[rows, columns]
    asked = known.sum(axis=1) >= _ENOUGH
    is_found = np.isin(np.arange(len(truth)), rows)
    false = len(found_px) - len(columns)
    return Compared(errors[asked], known[asked], height_px[asked], is_found[asked], false)


def _height_px(points: Floats) -> float:
    """Longer side of the box of a person's joints (K, 2), at least one pixel."""
    return float(max(np.ptp(points, axis=0).max(), 1.0)) if len(points) else 1.0


def gap(capture: Path, models: Path, say: Callable[[str], None]) -> dict[str, Any] | None:
    """Figures of both precisions; None where the capture is not there.

    Args:
        capture: folder with videos ``cam01.mp4`` ... and ``data.npz``: det_frame (D,), det_view (D,), det_kpts
            (D, 17, 3) x, y, score.
        models: folder of the networks.
        say: takes a line for the user.
    """
    if not (capture / "data.npz").is_file():
        say(f"{capture}: no real capture there; nothing measured")
        return None
    figures: dict[str, Any] = {"models": digests(models), "capture": capture.name}
    with np.load(capture / "data.npz") as stored:
        frame, view, people = stored["det_frame"], stored["det_view"], stored["det_kpts"].astype(np.float64)
    for precision in PRECISIONS:
        detector = load_bundled("int8" if precision == "int8" else "fp32", folder=models)
        parts = [
            compare(people[(view == number) & (frame == index)], detector.detect(image).people_px)
            for number, path in enumerate(sorted(capture.glob("*.mp4")))
            for index, image in _frames(path, frame[view == number])
        ]
        figures[precision] = gap_facts(parts)
        say(f"{precision}: {len(parts)} images, recall {figures[precision]['recall']:.3f}")
    return figures


def _frames(path: Path, wanted: Ints) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """The frames of a video of which there are detections."""
    video = cv2.VideoCapture(str(path))
    for index in range(int(wanted.max(initial=-1)) + 1):
        read, image = video.read()
        if read and index in wanted:
            yield index, np.asarray(image, dtype=np.uint8)


def gap_facts(parts: list[Compared]) -> dict[str, Any]:
    """Figures over some images."""
    error_px, known, height_px, found = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("error_px", "known", "height_px", "found")
    )
    relative = error_px / height_px[:, None]
    return {
        "images": len(parts),
        "people": len(found),
        "recall": _mean(found),
        "false_people_per_image": sum(part.false for part in parts) / max(len(parts), 1),
        "median_height_px": _median(height_px),
        "joints": _of_joints(error_px, relative, known),
        "by_joint": {
            name: _of_joints(error_px[:, index], relative[:, index], known[:, index])
            for index, name in enumerate(JOINTS)
        },
    }


def _of_joints(error_px: Floats, relative: Floats, known: NDArray[np.bool_]) -> dict[str, float]:
    """Medians over joints that are found, and how many of OpenPose's are found, and found near."""
    given = np.isfinite(error_px)
    return {
        "median_px": _median(error_px[given]),
        "median_of_height": _median(relative[given]),
        "recall": _mean(given[known]),
        "recall_near": _mean((relative <= NEAR)[known]),
    }


def _mean(values: NDArray[np.bool_]) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else float("nan")
