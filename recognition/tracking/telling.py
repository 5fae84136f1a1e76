"""What of the state is told: the tracks of a scene.

A point is told where it is certain enough, and was seen now or a short time ago; a worker, where two cameras placed
some of it now or a short time ago, one of them for sure: what one camera follows alone, or hints alone show, is kept in
mind, but not told for long.
"""

from __future__ import annotations

import numpy as np

from recognition.observations import ObjectTrack, WorkerTrack
from recognition.observed import KEYPOINTS, Detected
from recognition.optics import NEAREST_M, Optics
from recognition.tracking.options import FollowOptions
from recognition.tracking.population import Population
from recognition.tracking.things import Things
from recognition.triangulation.fusion import Fused
from rigcal.geometry import Bools, Floats, Ints


def worker_tracks(
    workers: Population, fused: Fused, systematic: Floats | None, members: Ints, options: FollowOptions, t_ns: int
) -> tuple[WorkerTrack, ...]:
    """Workers with an identity, ascending.

    Args:
        workers: After the update.
        fused: The update of their joints.
        systematic: (T x 17, 3, 3) what is added to the covariances; None for nothing.
        members: (T, V) indices of detections, -1 where none.
        options: What is certain enough, and how long is a short time.
        t_ns: Rig time.
    """
    told, views = _told(workers, options, t_ns), _views(workers, fused)
    told &= (workers.placed_ns >= t_ns - round(options.carry_s * 1e9))[:, None]
    joints = np.where(told[..., None], workers.place_m, np.nan)
    covariance = _covariances(workers, systematic)
    covariance[~told] = np.nan
    _freeze(joints, views, members, covariance)
    return tuple(
        WorkerTrack(track_id, joints[row], views[row], members[row], covariance[row])
        for track_id, row in _by_identity(workers.track_id, np.asarray(told.any(axis=1)))
    )


def object_tracks(
    optics: Optics, objects: Things, names: tuple[str, ...], boxes: Detected, rows: Ints, fused: Fused,
    systematic: Floats | None, members: Ints, options: FollowOptions, t_ns: int,
) -> tuple[ObjectTrack, ...]:  # fmt: skip
    """Objects with an identity, ascending.

    Args:
        optics: Of the rig.
        objects: After the update.
        names: Of the classes.
        boxes: Of all views.
        rows: (K, V) which of them are each object's, -1 where none.
        fused: The update of the objects' points.
        systematic: (K x J, 3, 3) what is added to the covariances; None for nothing.
        members: (K, V) indices of detections, -1 where none.
        options: What is certain enough, and how long is a short time.
        t_ns: Rig time.
    """
    things = objects.population
    told, views = _told(things, options, t_ns), _views(things, fused)
    place, covariances = things.place_m, _covariances(things, systematic)
    keypoints = np.full((len(place), KEYPOINTS, 3), np.nan)
    covariance, doubt = covariances[:, 0], np.full((*keypoints.shape, 3), np.nan)
    if things.points > 1:
        told[:, 1:] &= things.variance[:, 1:] + objects.scatter_m2 <= options.max_sigma_m**2
        keypoints = np.where(told[:, 1:, None], place[:, 1:], np.nan)
        alike = spheres(np.where(told[:, 1:], objects.scatter_m2, 0.0))
        doubt = np.where(told[:, 1:, None, None], covariances[:, 1:] + alike, np.nan)
    sizes = _sizes_m(optics, place[:, 0], boxes, rows).tolist()
    centre, labels, seen_by = place[:, 0], things.label.tolist(), views[:, 0].tolist()
    _freeze(centre, members, covariance, keypoints, doubt)
    return tuple(
        ObjectTrack(
            track_id, names[labels[row]], centre[row], seen_by[row], members[row], covariance[row], keypoints[row],
            (sizes[row][0], sizes[row][1]), doubt[row],
        )
        for track_id, row in _by_identity(things.track_id, told[:, 0])
    )  # fmt: skip


def indices(detected: Detected, rows: Ints, fused: Fused) -> Ints:
    """(T, V) index within its view of every member that has a point where it was found to be, else -1."""
    agreed = fused.agreed.reshape(rows.shape[1], len(rows), detected.seen.shape[1]).any(axis=2).T
    return detected.index[np.where(agreed, rows, -1)]


def spheres(variance: Floats) -> Floats:
    """(..., 3, 3) covariances of points whose variance (...) is the same in every direction."""
    return variance[..., None, None] * np.eye(3)


def _told(population: Population, options: FollowOptions, t_ns: int) -> Bools:
    """(T, J) which points are told."""
    recent = population.seen_ns >= t_ns - round(options.carry_s * 1e9)
    sure = population.variance <= options.max_sigma_m**2
    return np.asarray(population.known & recent & sure & (population.track_id > 0)[:, None])


def _views(population: Population, fused: Fused) -> Ints:
    """(T, J) how many cameras gave each point."""
    return fused.views.reshape(population.known.shape)


def _covariances(population: Population, systematic: Floats | None) -> Floats:
    """(T, J, 3, 3) of the points' places."""
    own = population.motion.covariance[:, :3, :3]
    whole = own.copy() if systematic is None else own + systematic
    return np.asarray(whole.reshape(*population.known.shape, 3, 3))


def _sizes_m(optics: Optics, centre_m: Floats, boxes: Detected, rows: Ints) -> Floats:
    """(K, 2) mean width and height of the boxes at the objects' depths; NaN without a box."""
    depth = optics.in_cameras(centre_m)[2].T
    given = (rows >= 0) & (depth > NEAREST_M)
    size_rad = np.concatenate([boxes.size_rad, np.zeros((1, 2))])[rows]
    total = (size_rad * (depth * given)[..., None]).sum(axis=1)
    count = given.sum(axis=1)[:, None]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _by_identity(track_id: Ints, told: Bools) -> list[tuple[int, int]]:
    """(identifier, row) of those that are told, ascending."""
    (rows,) = told.nonzero()
    return sorted(zip(track_id[rows].tolist(), rows.tolist(), strict=True))


def _freeze(*arrays: Floats | Ints) -> None:
    for array in arrays:
        array.setflags(write=False)
