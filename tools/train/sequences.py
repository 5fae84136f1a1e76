"""Evaluation sequences as pictures with truth, and as joints in the world; ``tools.sicsg.sequences`` has the format."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.sources.capture import open_source
from rigcal.geometry import Floats, Ints
from rigcal.rig import Rig
from rigcal.rigfile import read_rigfile, rig_of
from tools.sicsg.catalog import CATEGORIES, canonical_order
from tools.sicsg.coco import MIN_VISIBLE, PERSON_MIN_HEIGHT, THING_MIN_SIDE
from tools.sicsg.skeleton import JOINTS
from tools.sicsg.truth import Visibility
from tools.train.coco import POINTS, Category, DataError, Picture, Truth

SITE_CATEGORIES = (Category("person", JOINTS), *(Category(entry.name, entry.keypoints) for entry in CATEGORIES))
"""What the networks learn, in the order of their classes."""


@dataclass(frozen=True, slots=True, eq=False)
class EvaluationSequence:
    """One sequence of F instants, V cameras, W workers and T objects."""

    folder: Path
    rig: Rig
    facts: dict[str, Any]
    """``truth.json``."""
    arrays: dict[str, NDArray[Any]]
    """``truth.npz``."""

    @property
    def light(self) -> str:
        """Kind of light."""
        return str(self.facts["light"])

    @property
    def renderer(self) -> str:
        """What made the pictures; the folder's name ends with it."""
        return self.folder.name.rpartition("-")[2]

    @property
    def fps(self) -> float:
        """Instants per second."""
        return 1.0 / float(np.median(np.diff(self.facts["instants_s"])))

    def classes(self) -> Ints:
        """(T,) class of each object."""
        number = {category.name: index for index, category in enumerate(SITE_CATEGORIES)}
        return np.array([number[entry["class"]] for entry in self.facts["objects"]], dtype=np.int64)


def find_sequences(folder: Path) -> tuple[Path, ...]:
    """Finished sequences of a folder, by name.

    Raises:
        DataError: where there is none.
    """
    found = tuple(sorted(path.parent for path in folder.glob("*/truth.json")))
    if not found:
        raise DataError(
            "there is no sequence", where=folder, expected="NAME/truth.json", got="none",
            do_next="Render them first: python -m tools.sicsg --help.",
        )  # fmt: skip
    return found


def read_sequence(folder: Path) -> EvaluationSequence:
    """Read a sequence's truth."""
    facts = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    if facts.get("format") != "sicsg.sequence" or facts.get("version") != 1:
        raise DataError(
            "the truth has another form", where=folder / "truth.json", expected="sicsg.sequence, version 1",
            got=f"{facts.get('format')}, version {facts.get('version')}", do_next="Render the sequence again.",
        )  # fmt: skip
    with np.load(folder / "truth.npz") as stored:
        arrays = dict(stored)
    rig = rig_of(read_rigfile(folder / "true.rig.json"))
    return EvaluationSequence(folder, rig, facts, arrays)


def pictures(sequence: EvaluationSequence) -> Iterator[tuple[Picture, NDArray[np.uint8]]]:
    """Every frame of every camera with its truth, as a capture of the true rig."""
    rig, order = sequence.rig, sequence.facts["cameras"]
    source = open_source(sequence.folder, rig, use=[True] * len(rig.cameras), fps=sequence.fps)
    for instant in source.frame_sets():
        for camera_id, view in zip(rig.camera_ids, instant.views, strict=True):
            if view is not None:
                size_wh = (view.image_bgr.shape[1], view.image_bgr.shape[0])
                truth = truth_of(sequence, view.frame_idx, order.index(camera_id), size_wh)
                path = sequence.folder / f"{camera_id}.mp4"
                yield Picture(path, size_wh, sequence.light, sequence.renderer, truth), view.image_bgr


def truth_of(sequence: EvaluationSequence, frame: int, view: int, size_wh: tuple[int, int]) -> Truth:
    """What is in a frame, and what of it is not asked for, as ``tools.sicsg.coco`` has it for training."""
    people = _people(sequence, frame, view)
    things = _things(sequence, frame, view, size_wh)
    classes = np.concatenate([np.zeros(len(people[0]), dtype=np.int64), sequence.classes()])
    boxes, points, visible, full = (np.concatenate(pair) for pair in zip(people, things, strict=True))
    seen = np.isfinite(boxes[:, 0])
    wh = boxes[:, 2:] - boxes[:, :2]
    with np.errstate(invalid="ignore"):
        small = np.where(
            classes == 0, wh[:, 1] < PERSON_MIN_HEIGHT * size_wh[1], wh.min(axis=1) < THING_MIN_SIDE * size_wh[1]
        )
    hidden = visible / np.maximum(full, 1) < MIN_VISIBLE
    return Truth(classes, boxes + 0.5, points, small | hidden).picked(seen)


def _people(sequence: EvaluationSequence, frame: int, view: int) -> tuple[Floats, Floats, Ints, Ints]:
    """Boxes (W, 4), points (W, 17, 3) in edge coordinates, visible and full pixels (W,)."""
    arrays = sequence.arrays
    seen = arrays["joints_seen"][frame, view]
    flags = np.where(seen == Visibility.VISIBLE, 2.0, np.where(seen == Visibility.OUTSIDE, 0.0, 1.0))
    points = np.concatenate([arrays["joints_px"][frame, view] + 0.5, flags[..., None]], axis=-1)
    points[flags == 0] = 0.0
    pixels = arrays["worker_pixels"][frame, view]
    return arrays["worker_xyxy"][frame, view], points, pixels, arrays["worker_full_pixels"][frame, view]


def _things(
    sequence: EvaluationSequence, frame: int, view: int, size_wh: tuple[int, int]
) -> tuple[Floats, Floats, Ints, Ints]:
    """The same of T objects; keypoints inside the picture count as occluded, since the truth does not tell."""
    arrays = sequence.arrays
    camera = sequence.rig.camera(sequence.facts["cameras"][view])
    points = np.zeros((len(sequence.facts["objects"]), POINTS, 3))
    world = sequence.rig.world_from_rig
    for row, entry, own_m in zip(points, sequence.facts["objects"], arrays["object_keypoints_m"][frame], strict=True):
        known_m = own_m[np.isfinite(own_m[:, 0])]
        if not len(known_m) or world is None:
            continue
        in_camera = camera.cam_from_rig.apply(world.inverse().apply(known_m))
        if (in_camera[:, 2] <= 0).any():
            continue
        px = camera.camera.project(in_camera)
        if not np.isfinite(px).all():
            continue
        px = px[list(canonical_order(entry["class"], px))]
        inside = ((px > -0.5) & (px < np.array(size_wh) - 0.5)).all(axis=1)
        row[: len(px)][inside] = np.column_stack([px + 0.5, np.ones(len(px))])[inside]
    pixels = arrays["object_pixels"][frame, view]
    return arrays["object_xyxy"][frame, view], points, pixels, arrays["object_full_pixels"][frame, view]
