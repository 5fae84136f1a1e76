"""Which detections of different cameras show one worker or one object: the paper's epipolar association.

The first view's detections are the first selections. Each further view is matched to the selections by bipartite
matching; a detection that is matched below the threshold joins its selection, any other starts a new one
(Safe-Construct, "Cross-View Association via Epipolar Geometry").

What its formulas leave open is decided thus:

- The distance (equation 3) is the geometric one, in undistorted pixels; see :mod:`recognition.epipolar`.
- The cost to a selection (equations 1 and 2) is the mean over those of its detections that share a seen joint with
  the new one; infinite where none does. Objects have one joint, the centre of their box, and match within a class.
- Equation 5 wants every selection and every detection matched, which unequal counts forbid. The assignment is
  rectangular, as many pairs as the smaller side has, and then comes the threshold.
- The threshold is an angle. A pixel of a calibrated camera stands for the angle ``1 / f``, so that one value serves
  every resolution and focal length; it is multiplied by the mean focal length of the rig before it is compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from recognition.epipolar import RigGeometry
from recognition.observations import ViewDetections
from rigcal.errors import OptionError
from rigcal.geometry import Floats, Ints, freeze


@dataclass(frozen=True, slots=True)
class AssociationOptions:
    """What counts as seen (phi of the paper), and how near to its epipolar lines a detection must be (theta).

    Raises:
        OptionError: where a score is not in 0..1, or an angle not between 0 and 0.5 rad.
    """

    min_person_score: float = 0.2
    """People whose detected joints have a lower mean score are discarded, and so are hints: the paper has one
    threshold. On the shared multi-person capture 0.2 keeps a far bystander in 94 of 100 frames (97 without a limit, 82
    at 0.3, 44 at 0.35; OpenPose)."""
    min_joint_score: float = 0.2
    """Joints with a lower score do not count as seen, here and in the triangulation. MoveNet gives a place to every
    joint, hidden or not."""
    min_object_score: float = 0.25
    """Objects with a lower score are discarded."""
    max_person_distance_rad: float = 0.08
    """0.08 rad is 134 px at a focal length of 1680 px: detectors err by whole limbs. The athlete of the shared
    capture is placed by MoveNet in 83 of 100 frames at 0.03, 93 at 0.05, 98 at 0.08, 97 at 0.1; by OpenPose
    in 100 from 0.02 on. The price is wrong groups in crowds: of simulated workers with 5 px noise, missing joints
    and false people, 0.968 of the joints of four are found within 15 cm at 0.03 and 0.958 at 0.08; of eight 0.949
    and 0.931."""
    max_object_distance_rad: float = 0.015
    """A box has one point, so that wrong partners are near. Of 14 simulated objects with the same noise 0.951 are
    grouped rightly at 0.01, 0.960 at 0.015, 0.956 at 0.02 and 0.938 at 0.05."""

    def __post_init__(self) -> None:
        for name in ("min_person_score", "min_joint_score", "min_object_score"):
            if not 0 <= getattr(self, name) <= 1:
                raise OptionError(name, expected="a score in 0..1", got=getattr(self, name))
        for name in ("max_person_distance_rad", "max_object_distance_rad"):
            if not 0 < getattr(self, name) < 0.5:
                raise OptionError(name, expected="an angle between 0 and 0.5 rad", got=getattr(self, name))


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Detections grouped across V views, one row for each worker or object, and the evidence."""

    members: Ints
    """(M, V) index of the detection in each view, -1 where none. Rows in the order in which they were started."""
    cost_px: Floats
    """(M, V) cost at which each detection joined, mean line distance in undistorted pixels; NaN for the one that
    started the row and where there is none."""
    discarded: Ints
    """(V,) how many detections of each view had too low a score."""
    rejected: Ints
    """(V,) how many pairs of the assignment were at the threshold or above it, or shared no joint."""

    def __post_init__(self) -> None:
        views = self.members.shape[1]
        freeze(self, np.int64, members=(None, views), discarded=(views,), rejected=(views,))
        freeze(self, np.float64, cost_px=self.members.shape)


@dataclass(frozen=True, slots=True)
class Association:
    """The groups of one instant."""

    people: Groups
    objects: Groups
    object_classes: tuple[str, ...]
    """(K,) class of each row of ``objects``."""
    min_joint_score: float
    """Joints with a lower score were not counted as seen, and are not triangulated."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """N detections of all views, in the order of the views."""

    view: Ints
    index: Ints
    points_px: Floats
    """(N, J, 2) undistorted; NaN: not seen."""
    classes: tuple[str, ...]
    discarded: Ints


def associate(
    geometry: RigGeometry, views: Sequence[ViewDetections], options: AssociationOptions | None = None
) -> Association:
    """Group the detections of one instant into workers and objects.

    The order of the detections within a view does not matter, the order of the cameras does: the method is greedy.
    Cameras that are to be left out are given as :meth:`ViewDetections.empty`.

    Args:
        geometry: of the rig.
        views: (V,) detections of each camera of the rig.
        options: thresholds; None for the defaults.

    Returns:
        Every detection with a sufficient score is in exactly one row; a row may have a single view.

    Raises:
        ValueError: where the number of views is not that of the cameras.
    """
    chosen = options or AssociationOptions()
    geometry.check_views(views)
    people = _seen_people(geometry, views, chosen)
    objects = _seen_objects(geometry, views, chosen)
    focal_px = float(geometry.focal_px.mean())
    object_groups = _grouped(geometry, objects, chosen.max_object_distance_rad * focal_px)
    first_view = (object_groups.members >= 0).argmax(axis=1)
    first = object_groups.members[np.arange(len(first_view)), first_view]
    return Association(
        people=_grouped(geometry, people, chosen.max_person_distance_rad * focal_px),
        objects=object_groups,
        object_classes=tuple(views[v].object_class[k] for v, k in zip(first_view, first, strict=True)),
        min_joint_score=chosen.min_joint_score,
    )


def match(costs: Floats, limit: float) -> tuple[Ints, Ints]:
    """The assignment of rows to columns of least total cost (equation 4), less the pairs not below ``limit``.

    Pairs of infinite cost are assigned only where nothing else is left, and then dropped.

    Args:
        costs: (M, N) not negative; infinite: not to be matched.
        limit: of the cost of one pair; infinite for none.

    Returns:
        Rows and columns of the pairs, (P,) each.
    """
    finite = np.isfinite(costs)
    barred = float(costs[finite].max(initial=0.0)) * min(costs.shape) + 1.0
    rows, columns = linear_sum_assignment(np.where(finite, costs, barred))
    below = costs[rows, columns] < limit
    return np.asarray(rows[below], dtype=np.int64), np.asarray(columns[below], dtype=np.int64)


def _seen_people(geometry: RigGeometry, views: Sequence[ViewDetections], options: AssociationOptions) -> _Seen:
    kept, joints = [], []
    for camera, found in zip(geometry.cameras, views, strict=True):
        mean_score = found.people_score.sum(axis=1) / np.maximum((found.people_score > 0).sum(axis=1), 1)
        enough = mean_score >= options.min_person_score
        enough[found.hints] = False
        kept.append(np.flatnonzero(enough))
        score = found.people_score[kept[-1]]
        seen = (score >= options.min_joint_score) & (score > 0)
        joints.append(np.where(seen[..., None], camera.undistorted_px(found.people_px[kept[-1]]), np.nan))
    counts = [len(found.people_px) for found in views]
    return _stacked(kept, joints, tuple("" for rows in kept for _ in rows), counts)


def _seen_objects(geometry: RigGeometry, views: Sequence[ViewDetections], options: AssociationOptions) -> _Seen:
    kept = [np.flatnonzero(found.object_score >= options.min_object_score) for found in views]
    centres = [
        camera.undistorted_px(found.object_px[rows])[:, None]
        for camera, found, rows in zip(geometry.cameras, views, kept, strict=True)
    ]
    classes = tuple(found.object_class[k] for found, rows in zip(views, kept, strict=True) for k in rows)
    return _stacked(kept, centres, classes, [len(found.object_class) for found in views])


def _stacked(kept: list[Ints], points_px: list[Floats], classes: tuple[str, ...], counts: list[int]) -> _Seen:
    used = np.array([len(rows) for rows in kept])
    return _Seen(
        view=np.repeat(np.arange(len(kept)), used),
        index=np.concatenate(kept),
        points_px=np.concatenate(points_px),
        classes=classes,
        discarded=np.array(counts) - used,
    )


def _grouped(geometry: RigGeometry, seen: _Seen, limit_px: float) -> Groups:
    """The greedy pass over the views."""
    costs = _pair_costs_px(geometry, seen)
    views = len(geometry.cameras)
    group = np.full(len(seen.view), -1)
    joined_px = np.full(len(seen.view), np.nan)
    rejected = np.zeros(views, dtype=np.int64)
    started = 0
    for view in range(views):
        new = np.flatnonzero(seen.view == view)
        earlier = np.flatnonzero(seen.view < view)
        table = _selection_costs_px(costs[np.ix_(earlier, new)], group[earlier], started)
        rows, columns = match(table, limit_px)
        group[new[columns]] = rows
        joined_px[new[columns]] = table[rows, columns]
        rejected[view] = min(table.shape) - len(rows)
        alone = new[group[new] < 0]
        group[alone] = started + np.arange(len(alone))
        started += len(alone)
    members, cost_px = np.full((started, views), -1), np.full((started, views), np.nan)
    members[group, seen.view], cost_px[group, seen.view] = seen.index, joined_px
    return Groups(members, cost_px, seen.discarded, rejected)


def _pair_costs_px(geometry: RigGeometry, seen: _Seen) -> Floats:
    """(N, N) mean line distance of the shared joints of two detections; infinite for none, or another class."""
    distances = geometry.line_distances_px(seen.points_px, seen.view)
    shared = np.isfinite(distances)
    count = shared.sum(axis=-1)
    classes = np.array(seen.classes, dtype=np.str_)
    comparable = (count > 0) & (classes[:, None] == classes[None, :])
    return np.where(comparable, np.where(shared, distances, 0.0).sum(axis=-1) / np.maximum(count, 1), np.inf)


def _selection_costs_px(costs_px: Floats, group: Ints, selections: int) -> Floats:
    """Equations 1 and 2: (M, N) from the costs (E, N) of earlier detections, whose selections are ``group`` (E,)."""
    belongs = (group[None, :] == np.arange(selections)[:, None]).astype(np.float64)
    comparable = np.isfinite(costs_px)
    count = belongs @ comparable
    total = belongs @ np.where(comparable, costs_px, 0.0)
    return np.where(count > 0, total / np.maximum(count, 1.0), np.inf)
