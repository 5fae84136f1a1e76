"""What the exported networks find on a split: average precision per class, size, light and renderer, joints, time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.bundled.decode import box_iou
from recognition.detectors.bundled.geometry import SITE_WH
from recognition.detectors.bundled.manifests import HARD_HAT, PERSON
from recognition.observations import JOINTS
from rigcal.geometry import Floats
from tools.train.cache import read_image
from tools.train.coco import Category, DataSet, Picture, Truth
from tools.train.geometry import letterbox
from tools.train.metrics import THRESHOLDS, Scored, average_precision, joint_similarity
from tools.train.predict import Found, Networks, SiteAlone


@dataclass(frozen=True, slots=True)
class Size:
    """A range of sizes that is also counted alone, in pixels of the site network's input."""

    name: str
    of_side: bool
    """Of the square root of the box's area; else of its width."""
    low: float
    high: float
    """Not included."""

    def holds(self, boxes: Floats, scale: float) -> NDArray[np.bool_]:
        """(N,) of boxes (N, 4) of a picture that is scaled so for the network."""
        wh = (boxes[:, 2:] - boxes[:, :2]) * scale
        size = np.sqrt(wh.prod(axis=1)) if self.of_side else wh[:, 0]
        return np.asarray((size >= self.low) & (size < self.high))


WIDTHS = (Size("8-12", False, 8.0, 12.0), Size(">=12", False, 12.0, np.inf))
"""Of hard hats."""
SIDES = (Size("small", True, 0.0, 16.0), Size("medium", True, 16.0, 48.0), Size("large", True, 48.0, np.inf))
"""Of all else: COCO's 32 and 96 pixels, halved since the input is half as large as COCO's pictures."""


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A picture, its truth and what was found."""

    picture: Picture
    found: Found
    scale: float
    """Pixels of the site network's input per pixel of the picture."""


def decoded(data: DataSet) -> Iterator[tuple[Picture, NDArray[np.uint8]]]:
    """The pictures of a data set with their pixels."""
    for picture in data.pictures:
        yield picture, read_image(picture)


def run(
    networks: Networks | SiteAlone, pictures: Iterable[tuple[Picture, NDArray[np.uint8]]], say: Callable[[str], None]
) -> tuple[list[Result], float]:
    """Results of all pictures, and milliseconds per picture after decoding."""
    results, spent = [], 0.0
    for number, (picture, image) in enumerate(pictures):
        start = time.perf_counter()
        found = networks.find(image)
        spent += time.perf_counter() - start
        results.append(Result(picture, found, letterbox(picture.size_wh, SITE_WH).scale))
        if number % 200 == 199:
            say(f"{number + 1} pictures")
    return results, 1000.0 * spent / max(len(results), 1)


def report(results: Sequence[Result], categories: Sequence[Category]) -> dict[str, Any]:
    """All figures: whole, per class and size, per light and per renderer."""
    groups = {
        "light": sorted({result.picture.light for result in results}),
        "renderer": sorted({result.picture.renderer for result in results}),
    }
    parts: dict[str, Any] = {"all": _figures(results, categories)}
    for field, values in groups.items():
        for value in values:
            chosen = [result for result in results if getattr(result.picture, field) == value]
            parts[f"{field} {value}"] = _figures(chosen, categories)
    return parts


def _figures(results: Sequence[Result], categories: Sequence[Category]) -> dict[str, Any]:
    people = [scored_joints(result) for result in results]
    similar = [average_precision(people, threshold) for threshold in THRESHOLDS]
    return {
        "pictures": len(results),
        "classes": {category.name: _of_class(results, label, category) for label, category in enumerate(categories)},
        "oks_ap50": similar[0],
        "oks_ap": float(np.mean(similar)),
        "joints": joint_errors(results),
        "keypoints": keypoint_errors(results, categories),
    }


def _of_class(results: Sequence[Result], label: int, category: Category) -> dict[str, Any]:
    # Most pictures hold nothing of a class; they change nothing and are left out.
    some = [r for r in results if (r.found.classes == label).any() or (r.picture.truth.classes == label).any()]
    images = [scored_boxes(result, label) for result in some]
    values = [average_precision(images, threshold) for threshold in THRESHOLDS]
    row = {"asked": _asked(images), "ap50": values[0], "ap": float(np.mean(values))}
    for size in WIDTHS if category.name == HARD_HAT else SIDES:
        of_size = [scored_boxes(result, label, size) for result in some]
        row[f"ap50 {size.name}"] = average_precision(of_size, 0.5)
        row[f"asked {size.name}"] = _asked(of_size)
    return row


def _asked(images: Sequence[Scored]) -> int:
    return sum(int((~image.ignored).sum()) for image in images)


def scored_boxes(result: Result, label: int, size: Size | None = None) -> Scored:
    """Boxes of a class; truths of another size are ignored."""
    truth, found = result.picture.truth, result.found
    mine, theirs = found.classes == label, truth.classes == label
    ignored, outside = truth.ignore[theirs], np.zeros(int(mine.sum()), dtype=bool)
    if size is not None:
        ignored = ignored | ~size.holds(truth.boxes[theirs], result.scale)
        outside = ~size.holds(found.boxes[mine], result.scale)
    overlap = box_iou(found.boxes[mine], truth.boxes[theirs])
    return Scored(found.scores[mine], overlap, ignored, outside)


def scored_joints(result: Result) -> Scored:
    """Joints of people; people without a labelled joint are ignored."""
    people = _people(result.picture.truth)
    mine = result.found.classes == 0
    similarity = joint_similarity(result.found.joints[mine], people.points, people.sizes())
    ignored = people.ignore | ~(people.points[..., 2] > 0).any(axis=1)
    return Scored(result.found.scores[mine], similarity, ignored, np.zeros(int(mine.sum()), dtype=bool))


def joint_errors(results: Sequence[Result]) -> dict[str, Any]:
    """Distances in pixels of the pictures, of joints of people found with a similarity of 0.5 or more."""
    errors: list[Floats] = []
    flags: list[Floats] = []
    for result in results:
        people, scored = _people(result.picture.truth), scored_joints(result)
        joints = result.found.joints[result.found.classes == 0]
        for who in np.flatnonzero(~scored.ignored):
            if len(joints) and scored.similarity[:, who].max() >= 0.5:
                best = joints[scored.similarity[:, who].argmax(), :, :2]
                errors.append(np.linalg.norm(best - people.points[who, :, :2], axis=1))
                flags.append(people.points[who, :, 2])
    if not errors:
        return {"people": 0}
    error, flag = np.stack(errors), np.stack(flags)
    summary: dict[str, Any] = {"people": len(error)}
    for name, value in (("visible", 2), ("occluded", 1)):
        summary[name] = _quantiles(error[flag == value])
    summary["median_visible_px"] = {
        joint: _quantiles(error[flag[:, idx] == 2, idx]).get("median_px") for idx, joint in enumerate(JOINTS)
    }
    return summary


def keypoint_errors(results: Sequence[Result], categories: Sequence[Category]) -> dict[str, Any]:
    """Distances in pixels of the pictures of objects' keypoints, of boxes found with an overlap of 0.5 or more."""
    errors: dict[str, Any] = {}
    for label, category in enumerate(categories):
        count = len(category.keypoints)
        if label == 0 or count == 0:
            continue
        distances = [np.zeros(0)]
        for result in results:
            scored, truth = scored_boxes(result, label), result.picture.truth
            points = truth.points[truth.classes == label][:, :count]
            keypoints = result.found.keypoints[result.found.classes == label][:, :count]
            for which in np.flatnonzero(~scored.ignored):
                if len(keypoints) and scored.similarity[:, which].max() >= 0.5:
                    best = keypoints[scored.similarity[:, which].argmax()]
                    known = (points[which, :, 2] > 0) & np.isfinite(best[:, 0])
                    distances.append(np.linalg.norm(best - points[which, :, :2], axis=1)[known])
        errors[category.name] = _quantiles(np.concatenate(distances))
    return errors


def _people(truth: Truth) -> Truth:
    return truth.picked(truth.classes == 0)


def _quantiles(distances: Floats) -> dict[str, float]:
    if not len(distances):
        return {}
    return {"median_px": float(np.median(distances)), "p90_px": float(np.quantile(distances, 0.9))}


def summary(parts: dict[str, Any]) -> str:
    """One line per group: average precision of people, of all classes, of hats by width, and of joints."""
    lines = [f"{'group':22} {'images':>6} {'person':>6} {'mean':>6} {'8-12':>6} {'>=12':>6} {'joints':>6}"]
    for name, figures in parts.items():
        classes = figures["classes"]
        hat = classes[HARD_HAT]
        values = (classes[PERSON]["ap50"], mean_ap50(figures), hat["ap50 8-12"], hat["ap50 >=12"], figures["oks_ap50"])
        lines.append(f"{name:22} {figures['pictures']:6} " + " ".join(f"{value:6.3f}" for value in values))
    return "\n".join(lines)


def mean_ap50(figures: dict[str, Any]) -> float:
    """Over the classes that are asked for."""
    return mean_of(figures, asked_in(figures), "ap50")


def asked_in(*groups: dict[str, Any]) -> list[str]:
    """Classes that are asked for in all of these groups of pictures."""
    return [name for name in groups[0]["classes"] if all(group["classes"][name]["asked"] for group in groups)]


def mean_of(figures: dict[str, Any], names: Sequence[str], key: str) -> float:
    """Mean of one figure of some classes; NaN of none."""
    return float(np.mean([figures["classes"][name][key] for name in names] or [np.nan]))


def table(figures: dict[str, Any]) -> str:
    """The figures of one group as text."""
    lines = [f"{'class':14} {'asked':>6} {'AP50':>6} {'AP':>6}  AP50 by size"]
    for name, row in figures["classes"].items():
        sizes = [key for key in row if key.startswith("ap50 ")]
        by_size = "  ".join(f"{key.removeprefix('ap50 ')} {row[key]:.3f}" for key in sizes)
        lines.append(f"{name:14} {row['asked']:6} {row['ap50']:6.3f} {row['ap']:6.3f}  {by_size}")
    joints = figures["joints"]
    lines.append(f"OKS-AP50 {figures['oks_ap50']:.3f}  OKS-AP {figures['oks_ap']:.3f}  people {joints['people']}")
    lines += [f"joints {name}: {joints[name]}" for name in ("visible", "occluded") if name in joints]
    lines += [f"keypoints of {name}: {values}" for name, values in figures["keypoints"].items()]
    return "\n".join(lines)
