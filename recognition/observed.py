"""What all cameras saw at one instant, stacked: without distortion, with the variance of every point.

A detector errs in two ways: by part of a body, whatever its distance, which is metres; and by the image's resolution,
which is pixels, that is, an angle of the camera. :class:`Detected` keeps the two apart, since depth is known only
later. Angles are distances in the plane z = 1 of the camera, so that a pixel is the angle ``1 / f`` everywhere in a
perspective image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np

from recognition.observations import ViewDetections
from recognition.optics import Optics
from rigcal.errors import OptionError
from rigcal.geometry import Bools, Floats, Ints

ValuesT = TypeVar("ValuesT", Floats, Bools)
KEYPOINTS = 4
"""Of an object, at the most."""
_LEAST_SCORE = 0.1
_NO_JOINTS, _NOBODY = np.zeros((1, 17)), np.full((1, 17, 2), np.nan)
_NO_BOX, _NO_KEYPOINTS = np.full((1, 4), np.nan), np.full((1, KEYPOINTS, 2), np.nan)


@dataclass(frozen=True, slots=True)
class DetectorModel:
    """What counts as seen, and how far from the truth it may be: one standard deviation.

    Raises:
        OptionError: where a score is not in 0..1, or a length, a share or a number of pixels not above 0.
    """

    min_person_score: float = 0.2
    """People whose detected joints have a lower mean score are discarded; as for the paper's method."""
    min_joint_score: float = 0.2
    """Joints with a lower score do not count as seen."""
    min_object_score: float = 0.25
    """Objects with a lower score are discarded."""
    joint_m: float = 0.03
    """What a joint of score 1 is off along each axis, in metres at its depth; its variance is over the score. In the
    shared capture joints are 23 mm (OpenPose, median) and 50 mm (MoveNet, 83 below a score of 0.4, 35 above 0.8) from
    where all cameras place them, which is 1.2 times this. At 0.02 the athlete is placed by MoveNet in 90 of 100 frames
    beside a false worker, at 0.03 in 97, at 0.04 in 100 (with claims of 4 sigmas); parts right of simulated
    rigs differ by 0.2 % between the three."""
    joint_px: float = 1.5
    """What a joint of score 1 is off along each axis, in pixels of its camera: what matters where images are small."""
    object_share: float = 0.04
    """What the middle of a box is off the projected middle of the object, of the box's diagonal: boxes bound what they
    see. 14 simulated objects are found alike from 0.02 to 0.08, with a mean error of 30.1, 29.6 and 29.3 mm."""
    object_px: float = 2.0
    """What the middle of a box is off, in pixels of its camera; 4 is alike."""

    def __post_init__(self) -> None:
        for name in ("min_person_score", "min_joint_score", "min_object_score"):
            if not 0 <= getattr(self, name) <= 1:
                raise OptionError(name, expected="a score in 0..1", got=getattr(self, name))
        for name in ("joint_m", "joint_px", "object_share", "object_px"):
            if not 0 < getattr(self, name) < np.inf:
                raise OptionError(name, expected="a number above 0", got=getattr(self, name))


@dataclass(frozen=True, slots=True, eq=False)
class Detected:
    """N detections of all views in the order of the views, and after them one that saw nothing: the row -1."""

    view: Ints
    """(N,) camera of each."""
    index: Ints
    """(N + 1,) its index within its view; -1 in the last row."""
    ends: list[int]
    """(V + 1,) where the detections of each view begin and end."""
    label: Ints
    """(N,) number of its class; 0 for people."""
    factors: Floats
    """(4, N + 1, J): 1, x, y, x^2 + y^2 of the normalised coordinates; x and y are 0 where not seen."""
    seen: Bools
    """(N + 1, J)"""
    angle_var: Floats
    """(N + 1, J) variance of each coordinate, rad^2: the part that does not depend on the depth."""
    spread_var: Floats
    """(N + 1, J) m^2: over the depth squared it is the other part."""
    size_rad: Floats
    """(N, 2) width and height of its box; 0 for people."""
    hint: Bools
    """(N + 1,) whether it counts only together with what another camera saw; true of the one that saw nothing."""
    score: Floats
    """(N + 1,) of objects; 0 of people, and of the one that saw nothing."""

    @property
    def count(self) -> int:
        """N."""
        return len(self.view)

    def points(self, count: int) -> Detected:
        """With the first so many points only."""
        return Detected(
            self.view, self.index, self.ends, self.label, self.factors[..., :count], self.seen[:, :count],
            self.angle_var[:, :count], self.spread_var[:, :count], self.size_rad, self.hint, self.score,
        )  # fmt: skip


def observe(
    optics: Optics, views: Sequence[ViewDetections], labels: dict[str, int], model: DetectorModel, *, keypoints: bool
) -> tuple[Detected, Detected]:
    """People (J = 17) and objects of an instant.

    Objects have J = 1 point, the middle of the box, or J = 5 with the keypoints.

    Args:
        optics: Of the rig.
        views: (V,) what each camera saw.
        labels: Number of each class of objects; classes that it lacks are added.
        model: Of the detector.
        keypoints: Whether objects come with their keypoints in any case, not only where any is known.
    """
    score = np.concatenate([*(view.people_score for view in views), _NO_JOINTS])
    enough = score.sum(axis=1) >= model.min_person_score * np.maximum((score > 0).sum(axis=1), 1)
    people = _Rows.of(tuple(len(view.people_score) for view in views), enough[:-1])
    people_px = people.of_all(np.concatenate([*(view.people_px for view in views), _NOBODY]))
    score = people.of_all(score)
    seen = (score >= model.min_joint_score) & (score > 0) & np.isfinite(people_px[..., 0])
    doubt = 1.0 / np.maximum(score, _LEAST_SCORE)
    pixel_var = optics.pixel_rad * optics.pixel_rad
    who = Detected(
        people.view, people.index, people.ends, np.zeros(len(people.view), dtype=np.int64),
        _factors(optics, people, people_px, seen), seen,
        doubt * np.append(model.joint_px**2 * pixel_var[people.view], 1.0)[:, None], model.joint_m**2 * doubt,
        np.zeros((len(people.view), 2)), people.of_all(_hints(views)), np.zeros(len(people.view) + 1),
    )  # fmt: skip
    return who, _objects(optics, views, labels, model, keypoints)


def _objects(
    optics: Optics, views: Sequence[ViewDetections], labels: dict[str, int], model: DetectorModel, keypoints: bool
) -> Detected:
    confidence = np.concatenate([view.object_score for view in views])
    things = _Rows.of(tuple(len(view.object_score) for view in views), confidence >= model.min_object_score)
    boxes = things.of_all(np.concatenate([*(view.object_xyxy for view in views), _NO_BOX]))
    points_px = ((boxes[:, :2] + boxes[:, 2:]) / 2)[:, None]
    keypoints_px = np.concatenate([*(view.object_keypoints_px for view in views), _NO_KEYPOINTS])
    if keypoints or np.isfinite(keypoints_px).any():
        points_px = np.concatenate([points_px, things.of_all(keypoints_px)], axis=1)
    seen: Bools = np.asarray(np.isfinite(points_px[..., 0]))
    names = [name for view in views for name in view.object_class]
    for name in names:
        if name not in labels:
            labels[name] = len(labels)
    numbers = np.array([labels[name] for name in names], dtype=np.int64)
    size_rad = (boxes[:-1, 2:] - boxes[:-1, :2]) * optics.pixel_rad[things.view, None]
    variance = np.ones(seen.shape)
    variance[:-1] = (
        model.object_px**2 * (optics.pixel_rad**2)[things.view]
        + model.object_share**2 * (size_rad * size_rad).sum(axis=1)
    )[:, None]  # fmt: skip
    return Detected(
        things.view, things.index, things.ends, numbers if things.whole else numbers[things.kept],
        _factors(optics, things, points_px, seen), seen, variance, np.zeros(seen.shape), size_rad,
        np.arange(len(seen)) == len(seen) - 1, things.of_all(np.append(confidence, 0.0)),
    )  # fmt: skip


def _hints(views: Sequence[ViewDetections]) -> Bools:
    """Of the people of all views, and after them of one that saw nothing."""
    hint = np.zeros(sum(len(view.people_score) for view in views) + 1, dtype=np.bool_)
    hint[-1] = True
    first = 0
    for view in views:
        hint[first + view.hints] = True
        first += len(view.people_score)
    return hint


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Which of the detections of all views are kept."""

    kept: Ints
    """(N,)"""
    view: Ints
    """(N,)"""
    index: Ints
    """(N + 1,), -1 in the last."""
    ends: list[int]
    """(V + 1,) where the views begin and end among the kept ones."""
    whole: bool
    """Whether all are kept."""

    @classmethod
    def of(cls, counts: tuple[int, ...], wanted: Bools) -> _Rows:
        whole = bool(wanted.all())
        return _all_rows(counts) if whole else _some_rows(counts, np.flatnonzero(wanted), whole)

    def of_all(self, values: ValuesT) -> ValuesT:
        """Those that are kept, and the last, of values of all (and one more)."""
        return values if self.whole else values[np.append(self.kept, -1)]


def _some_rows(counts: tuple[int, ...], kept: Ints, whole: bool) -> _Rows:
    starts = np.cumsum([0, *counts])
    ends = np.searchsorted(kept, starts)
    view = np.repeat(np.arange(len(counts)), ends[1:] - ends[:-1])
    return _Rows(kept, view, np.append(kept - starts[view], -1), ends.tolist(), whole)


@lru_cache(maxsize=256)
def _all_rows(counts: tuple[int, ...]) -> _Rows:
    return _some_rows(counts, np.arange(sum(counts)), True)


def _factors(optics: Optics, rows: _Rows, pixels: Floats, seen: Bools) -> Floats:
    """(4, N + 1, J): 1, x, y, x^2 + y^2 of points (N + 1, J, 2), without distortion; x and y are 0 where not seen."""
    source, xy = np.where(seen[..., None], pixels, 0.0), np.zeros(pixels.shape)
    for lens, first, end in zip(optics.lenses, rows.ends, rows.ends[1:], strict=False):
        if end > first:
            xy[first:end] = lens.undistorted(source[first:end]).reshape(-1, *pixels.shape[1:])
    factors = np.empty((4, *seen.shape))
    factors[0] = 1.0
    np.multiply(xy.transpose(2, 0, 1), seen, out=factors[1:3])
    factors[3] = factors[1] * factors[1] + factors[2] * factors[2]
    return factors
