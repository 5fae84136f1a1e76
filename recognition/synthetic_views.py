"""What detectors report of a simulated site: exactly, or with stated noise.

The exact views are one function, noise is a second; each detection carries the worker or object that it shows, so
that association and tracking can be judged. Same arguments and seed, same views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recognition.observations import ViewDetections
from recognition.synthetic import CLASSES, Site, walking
from rigcal.camera import Camera
from rigcal.errors import OptionError
from rigcal.geometry import Bools, Floats, Ints, Pose, freeze
from rigcal.rig import Rig

_FOLDED = 1e-6
"""Lens polynomials fold what is far outside the image back into it; the inverse then finds another ray than this."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledView:
    """The detections of one camera, and which worker or object each of them shows."""

    detections: ViewDetections
    worker_idx: Ints
    """(P,) index into the site's workers; -1 for a false detection."""
    object_idx: Ints
    """(K,) index into the site's objects; -1 for a false detection."""

    def __post_init__(self) -> None:
        people, objects = len(self.detections.people_px), len(self.detections.object_class)
        freeze(self, np.int64, worker_idx=(people,), object_idx=(objects,))


@dataclass(frozen=True, slots=True)
class DetectorNoise:
    """How far a detector is from perfect; the defaults change nothing but the order.

    Raises:
        OptionError: where a value is negative, or a probability above 1.
    """

    pixel_sigma: float = 0.0
    """Standard deviation of each joint's and each box side's position, px."""
    missing_joint: float = 0.0
    """Probability that a joint of a detected worker is not given."""
    missed: float = 0.0
    """Probability that a worker or an object is not detected in a view."""
    false_per_view: float = 0.0
    """Mean number of false people, and of false objects, in each view (Poisson)."""
    shuffled: bool = True
    """Whether the order of the detections is random."""

    def __post_init__(self) -> None:
        for name, most in (
            ("pixel_sigma", np.inf),
            ("missing_joint", 1.0),
            ("missed", 1.0),
            ("false_per_view", np.inf),
        ):
            if not 0 <= getattr(self, name) <= most:
                raise OptionError(name, expected=f"a number in 0..{most:g}", got=getattr(self, name))


def observe(site: Site, frame: int) -> tuple[LabelledView, ...]:
    """What perfect detectors see at one instant, without occlusion: one view per camera, in the site's order.

    Joints go through the real lens model; those outside the image or behind the camera are NaN with score 0, and a
    worker without a joint is no detection. A box holds the eight projected corners; an object whose box leaves the
    image is no detection.
    """
    return tuple(
        _observe(site, frame, mounted.camera, cam_from_world)
        for mounted, cam_from_world in zip(site.rig.cameras, site.cam_from_world, strict=True)
    )


def _observe(site: Site, frame: int, camera: Camera, cam_from_world: Pose) -> LabelledView:
    joints_px = _inside(camera, cam_from_world.apply(site.joints_in_world_m[frame]))
    seen: Bools = np.asarray(np.isfinite(joints_px).all(axis=-1))
    workers = np.flatnonzero(seen.any(axis=1))
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    corners = site.object_centre_in_world_m[frame][:, None] + signs * site.object_size_m[:, None]
    corners_px = _inside(camera, cam_from_world.apply(corners))
    objects = np.flatnonzero(np.isfinite(corners_px).all(axis=(1, 2)))
    boxes = np.concatenate([corners_px[objects].min(axis=1), corners_px[objects].max(axis=1)], axis=-1)
    detections = ViewDetections(
        people_px=joints_px[workers],
        people_score=seen[workers].astype(np.float64),
        object_class=tuple(site.object_class[k] for k in objects),
        object_xyxy=boxes,
        object_score=np.ones(len(objects)),
    )
    return LabelledView(detections, workers, objects)


def _inside(camera: Camera, points_in_cam: Floats) -> Floats:
    """Pixels (..., 2) of points (..., 3); NaN outside the image or behind the camera."""
    px = camera.project(points_in_cam)
    inside: Bools = np.asarray(((px >= -0.5) & (px <= np.array(camera.size_wh) - 0.5)).all(axis=-1))
    direct = np.where(inside[..., None], points_in_cam[..., :2] / points_in_cam[..., 2:], np.nan)
    unfolded: Bools = np.asarray((np.abs(camera.undistort(px) - direct) < _FOLDED).all(axis=-1))
    return np.where(unfolded[..., None], px, np.nan)


def with_noise(
    views: Sequence[LabelledView], rig: Rig, noise: DetectorNoise, *, seed: int | Sequence[int]
) -> tuple[LabelledView, ...]:
    """The views as an imperfect detector would report them.

    Args:
        views: one per camera, as :func:`observe` gives them.
        rig: whose images false detections fall into.
        noise: how imperfect.
        seed: of this instant's noise; a sequence such as ``(seed, frame)`` keeps instants apart.

    Returns:
        One view per camera. Scores of what is detected are spread over 0.5 to 1, those of false detections too.
    """
    rng = np.random.default_rng(seed)
    return tuple(
        _noisy_view(view, mounted.camera.size_wh, noise, rng) for view, mounted in zip(views, rig.cameras, strict=True)
    )


def _noisy_view(
    view: LabelledView, size_wh: tuple[int, int], noise: DetectorNoise, rng: np.random.Generator
) -> LabelledView:
    people_px, worker_idx = _noisy_people(view, size_wh, noise, rng)
    seen: Bools = np.asarray(np.isfinite(people_px).all(axis=-1))
    classes, boxes, object_idx = _noisy_objects(view, size_wh, noise, rng)
    people, objects = _order(len(people_px), noise, rng), _order(len(boxes), noise, rng)
    detections = ViewDetections(
        people_px=people_px[people],
        people_score=np.where(seen, rng.uniform(0.5, 1.0, seen.shape), 0.0)[people],
        object_class=tuple(classes[k] for k in objects),
        object_xyxy=boxes[objects],
        object_score=rng.uniform(0.5, 1.0, len(boxes)),
    )
    return LabelledView(detections, worker_idx[people], object_idx[objects])


def _order(count: int, noise: DetectorNoise, rng: np.random.Generator) -> Ints:
    return rng.permutation(count) if noise.shuffled else np.arange(count)


def _noisy_people(
    view: LabelledView, size_wh: tuple[int, int], noise: DetectorNoise, rng: np.random.Generator
) -> tuple[Floats, Ints]:
    """Joints (P, 17, 2) and workers (P,); what is false stands upright somewhere in the image."""
    true_px = view.detections.people_px
    kept = rng.random(len(true_px)) >= noise.missed
    joints_px = true_px[kept] + rng.normal(0.0, noise.pixel_sigma, true_px[kept].shape)
    joints_px[rng.random(joints_px.shape[:2]) < noise.missing_joint] = np.nan
    count = int(rng.poisson(noise.false_per_view))
    body = np.array([walking(np.zeros((1, 2)), 1.0, phase=p)[0] for p in rng.uniform(0.0, 2 * np.pi, count)])
    body = body.reshape(count, 17, 3)
    upright = np.stack([body[..., 1], 0.5 - body[..., 2]], axis=-1)
    middle_px = rng.uniform(0.0, 1.0, (count, 1, 2)) * size_wh
    false_px = middle_px + upright * rng.uniform(0.2, 0.8, (count, 1, 1)) * size_wh[1]
    worker_idx = np.concatenate([view.worker_idx[kept], np.full(count, -1)])
    return np.concatenate([joints_px, false_px]), worker_idx


def _noisy_objects(
    view: LabelledView, size_wh: tuple[int, int], noise: DetectorNoise, rng: np.random.Generator
) -> tuple[tuple[str, ...], Floats, Ints]:
    """Classes (K,), boxes (K, 4) and objects (K,)."""
    exact = view.detections
    kept = np.flatnonzero(rng.random(len(exact.object_class)) >= noise.missed)
    boxes = exact.object_xyxy[kept] + rng.normal(0.0, noise.pixel_sigma, (len(kept), 4))
    count = int(rng.poisson(noise.false_per_view))
    middle_px = rng.uniform(0.0, 1.0, (count, 2)) * size_wh
    half_px = rng.uniform(0.01, 0.05, (count, 2)) * size_wh
    false = [CLASSES[i] for i in rng.integers(len(CLASSES), size=count)]
    return (
        tuple(exact.object_class[k] for k in kept) + tuple(false),
        np.concatenate([boxes, np.concatenate([middle_px - half_px, middle_px + half_px], axis=1)]),
        np.concatenate([view.object_idx[kept], np.full(count, -1)]),
    )
