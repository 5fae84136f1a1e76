"""The data file: COCO JSON as ``tools.sicsg`` writes it, checked and turned into arrays.

Boxes and points leave this module in edge coordinates of the image (``recognition.detectors.bundled.geometry``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.observations import JOINTS
from rigcal.geometry import Floats

POINTS = len(JOINTS)
"""Points per annotation: 17 joints, or the keypoints of an object and then nothing."""
OBJECT_POINTS = 4


class DataError(ValueError):
    """The data file is not what training expects."""

    def __init__(self, problem: str, *, where: object, expected: object, got: object, do_next: str) -> None:
        super().__init__(f"{where}: {problem}; expected {expected}, got {got}. {do_next}")


@dataclass(frozen=True, slots=True)
class Category:
    """A class of the networks; its number is its place in the data set's tuple."""

    name: str
    keypoints: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What is in one image; N annotations."""

    classes: NDArray[np.int64]
    """(N,) place of the category."""
    boxes: Floats
    """(N, 4) xyxy of what is visible."""
    points: Floats
    """(N, 17, 3) x, y, and 0 outside the image or unlabelled, 1 occluded, 2 visible."""
    ignore: NDArray[np.bool_]
    """(N,) too small or too hidden: neither to be found nor wrong when found."""

    def picked(self, index: Any) -> Truth:
        """The annotations of an index or mask."""
        return Truth(self.classes[index], self.boxes[index], self.points[index], self.ignore[index])

    def sizes(self) -> Floats:
        """(N,) square root of the area of what holds the visible part and all labelled points."""
        low, high = self.boxes[:, :2].copy(), self.boxes[:, 2:].copy()
        known = self.points[..., 2:] > 0
        low = np.minimum(low, np.where(known, self.points[..., :2], np.inf).min(axis=1, initial=np.inf))
        high = np.maximum(high, np.where(known, self.points[..., :2], -np.inf).max(axis=1, initial=-np.inf))
        return np.sqrt(np.maximum((high - low).prod(axis=1), 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One image of a data set."""

    path: Path
    size_wh: tuple[int, int]
    light: str
    renderer: str
    truth: Truth


@dataclass(frozen=True, slots=True, eq=False)
class DataSet:
    """The pictures of one split."""

    categories: tuple[Category, ...]
    pictures: tuple[Picture, ...]
    source: Path
    """The COCO file."""

    def number(self, name: str) -> int:
        """Class of this name."""
        names = [category.name for category in self.categories]
        if name not in names:
            raise DataError(
                "a class is missing", where=self.source, expected=name, got=", ".join(names),
                do_next="Make the data with a catalogue that has it.",
            )  # fmt: skip
        return names.index(name)


def read_split(folder: Path, split: str) -> DataSet:
    """``FOLDER/coco_SPLIT.json`` with the images of ``FOLDER/images``.

    Raises:
        DataError: where the file is missing or holds something else.
    """
    path = folder / f"coco_{split}.json"
    if not path.is_file():
        raise DataError(
            "there is no data file", where=path, expected="COCO JSON", got="no file",
            do_next="Make the data first: python -m tools.sicsg --help.",
        )  # fmt: skip
    content = json.loads(path.read_text(encoding="utf-8"))
    categories = _categories(content["categories"], path)
    notes: dict[int, list[dict[str, Any]]] = {image["id"]: [] for image in content["images"]}
    for note in content["annotations"]:
        notes[note["image_id"]].append(note)
    pictures = [
        Picture(
            folder / "images" / image["file_name"],
            (image["width"], image["height"]),
            image["light"],
            image["renderer"],
            _truth(notes[image["id"]], len(categories), path),
        )
        for image in content["images"]
    ]
    if not pictures:
        raise DataError(
            "the data file is empty", where=path, expected="one image or more", got="none", do_next="Render some."
        )
    return DataSet(categories, tuple(pictures), path)


def _categories(entries: list[dict[str, Any]], path: Path) -> tuple[Category, ...]:
    entries = sorted(entries, key=lambda entry: int(entry["id"]))
    found = tuple(Category(entry["name"], tuple(entry["keypoints"])) for entry in entries)
    numbers = [entry["id"] for entry in entries]
    if numbers != list(range(1, len(entries) + 1)) or found[0] != Category("person", JOINTS):
        raise DataError(
            "the categories are others", where=path, expected="numbers from 1, person with COCO-17 joints first",
            got=", ".join(f"{entry['id']} {entry['name']}" for entry in entries), do_next="Export the data again.",
        )  # fmt: skip
    for category in found[1:]:
        if len(category.keypoints) > OBJECT_POINTS:
            raise DataError(
                "an object has too many keypoints", where=path, expected=f"{OBJECT_POINTS} or fewer",
                got=f"{category.name} with {len(category.keypoints)}", do_next="Widen the head of the site network.",
            )  # fmt: skip
    return found


def _truth(notes: list[dict[str, Any]], classes: int, path: Path) -> Truth:
    numbers = np.array([note["category_id"] for note in notes], dtype=np.int64).reshape(-1) - 1
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < classes:
        raise DataError(
            "an annotation has no category", where=path, expected=f"category_id of 1 to {classes}",
            got=sorted(set((numbers + 1).tolist())), do_next="Export the data again.",
        )  # fmt: skip
    boxes = np.array([note["bbox"] for note in notes], dtype=np.float64).reshape(-1, 4)
    boxes[:, :2] += 0.5
    boxes[:, 2:] += boxes[:, :2]
    points = np.zeros((len(notes), POINTS, 3))
    for row, note in zip(points, notes, strict=True):
        triples = np.array(note["keypoints"], dtype=np.float64).reshape(-1, 3)
        row[: len(triples)] = triples + [0.5, 0.5, 0.0]
    ignore = np.array([note["ignore"] for note in notes], dtype=bool).reshape(-1)
    return Truth(numbers, boxes, points, ignore)
