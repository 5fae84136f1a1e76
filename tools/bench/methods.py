"""The ways of calibrating a rig that are compared, all from the same corners.

``ours`` is the whole of rigcal's calibration, ``ideal`` least squares from the truth over all corners, which no method
can have and none can beat on average. The others are what else is at hand: a chain of pairs by OpenCV alone,
OpenCV's ``calibrateMultiview``, and pycolmap's joint solve of the chain.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from unittest.mock import patch

import cv2
import numpy as np
import pycolmap
from rigs import BenchSite
from scoring import Estimate, placed_boards

from rigcal import _colmap, pipeline
from rigcal.bundle import SolveOptions, solve
from rigcal.camera import Camera
from rigcal.detections import BoardView, SiteDetections
from rigcal.geometry import Floats, Pose
from rigcal.intrinsics import lens_freedom
from rigcal.site import GateLimits

MODEL = "opencv4"
"""The lens of every method: that of the true cameras."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a method found, and what it says of it."""

    estimate: Estimate
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall and CPU seconds by name, of the whole and of parts."""
    calibration: pipeline.SiteCalibration | None = None
    """Ours only."""


class Stopwatch:
    """Wall and CPU seconds spent inside ``with`` blocks."""

    def __init__(self) -> None:
        self.wall_s = self.cpu_s = 0.0

    def __enter__(self) -> Stopwatch:
        self._wall, self._cpu = time.perf_counter(), time.process_time()
        return self

    def __exit__(self, *_: object) -> None:
        self.wall_s += time.perf_counter() - self._wall
        self.cpu_s += time.process_time() - self._cpu

    def named(self, part: str) -> dict[str, float]:
        """The seconds as a benchmark's line has them."""
        return {f"{part}wall_s": self.wall_s, f"{part}cpu_s": self.cpu_s}


def ours(_: BenchSite, detections: SiteDetections) -> Answer:
    """Lenses, pairs, chain and joint solve as ``rigcal calibrate`` does them; then its measures of quality.

    ``joint`` is the joint solve with its rejection, ``quality`` what is measured once the rig is known.
    """
    options = pipeline.CalibrateOptions(MODEL)
    with _timed("refine_rig") as joint, _timed("assess") as quality:
        lenses = pipeline.calibrate_lenses(detections, None, options)
        result = pipeline.calibrate_site(detections, GateLimits(), lenses, options)
    estimate = Estimate(result.joint.cameras, result.joint.cam_from_rig)
    return Answer(estimate, joint.named("joint_") | quality.named("quality_"), result)


@contextmanager
def _timed(stage: str) -> Iterator[Stopwatch]:
    """Times one of the pipeline's stages where the pipeline calls it."""
    original, watch = getattr(pipeline, stage), Stopwatch()

    def timed(*args: object, **kwargs: object) -> object:
        with watch:
            return original(*args, **kwargs)

    with patch.object(pipeline, stage, timed):
        yield watch


def ideal(site: BenchSite, detections: SiteDetections) -> Answer:
    """Least squares from the truth over the views that were left unspoilt, those with turned corners turned back."""
    cameras = tuple(camera.camera for camera in site.rig.cameras)
    truth = Estimate(cameras, tuple(camera.cam_from_rig for camera in site.rig.cameras))
    unspoilt = replace(
        site.detections,
        cameras=tuple(
            replace(camera, views=tuple(v for v, w in zip(camera.views, given.views, strict=True) if _same(v, w)))
            for camera, given in zip(site.detections.cameras, detections.cameras, strict=True)
        ),
    )
    observations, start = placed_boards(unspoilt, truth)
    freedom = lens_freedom(cameras, poses_free=(False, *[True] * (len(cameras) - 1)))
    state = solve(observations, start, freedom, SolveOptions(sigma_px=site.noise_px)).state
    return Answer(Estimate(state.cameras, state.cam_from_rig))


def _same(view: BoardView, given: BoardView) -> bool:
    """Whether the corners are the same, in this or in the opposite order."""
    return any(np.array_equal(view.corners_px, pixels) for pixels in (given.corners_px, given.corners_px[::-1]))


def chain(_: BenchSite, detections: SiteDetections) -> Answer:
    """OpenCV alone: ``calibrateCamera``, ``stereoCalibrate`` of each pair with lenses held, the fewest links."""
    views = [{view.frame_idx: view for view in camera.views} for camera in detections.cameras]
    cameras = [_opencv_lens(detections, c) for c in range(len(views))]
    cam_from_rig: dict[int, Pose] = {0: Pose.identity()}
    frontier = [0]
    for near in frontier:
        for far in range(len(views)):
            shared = sorted(views[near].keys() & views[far].keys())
            if far not in cam_from_rig and shared:
                link = _opencv_pair(detections, cameras, near, far, shared)
                cam_from_rig[far] = link @ cam_from_rig[near]
                frontier.append(far)
    return Answer(Estimate(tuple(cameras), tuple(cam_from_rig[c] for c in range(len(views)))))


def _opencv_points(detections: SiteDetections, views: list[BoardView]) -> tuple[list[Floats], list[Floats]]:
    corners = detections.board.corners_in_board
    objects = [corners[view.corner_ids].astype(np.float32) for view in views]
    return objects, [view.corners_px.astype(np.float32) for view in views]


def _opencv_lens(detections: SiteDetections, camera: int) -> Camera:
    found = detections.cameras[camera]
    points = _opencv_points(detections, list(found.views))
    _, matrix, distortion, _, _ = cv2.calibrateCamera(*points, found.size_wh, None, None, flags=cv2.CALIB_FIX_K3)
    return Camera.from_matrix(MODEL, found.size_wh, matrix, np.ravel(distortion)[:4])


def _opencv_pair(detections: SiteDetections, cameras: list[Camera], near: int, far: int, frames: list[int]) -> Pose:
    views = [{view.frame_idx: view for view in detections.cameras[c].views} for c in (near, far)]
    objects, first = _opencv_points(detections, [views[0][frame] for frame in frames])
    _, second = _opencv_points(detections, [views[1][frame] for frame in frames])
    lenses = [part for c in (near, far) for part in (cameras[c].matrix, cameras[c].distortion)]
    solved = cv2.stereoCalibrate(objects, first, second, *lenses, cameras[near].size_wh, flags=cv2.CALIB_FIX_INTRINSIC)
    return Pose(solved[5], solved[6].ravel())


def multiview(_: BenchSite, detections: SiteDetections) -> Answer:
    """OpenCV 5's ``calibrateMultiview`` from the corners, ``k3`` held."""
    frames = sorted({view.frame_idx for camera in detections.cameras for view in camera.views})
    column = {frame: i for i, frame in enumerate(frames)}
    corners = detections.board.corners_in_board.astype(np.float32)
    count = len(detections.cameras)
    pixels = np.full((count, len(frames), len(corners), 2), -1, dtype=np.float32)
    mask = np.zeros((count, len(frames)), dtype=np.uint8)
    for c, camera in enumerate(detections.cameras):
        for view in camera.views:
            pixels[c, column[view.frame_idx], view.corner_ids] = view.corners_px
            mask[c, column[view.frame_idx]] = 1
    sizes = [camera.size_wh for camera in detections.cameras]
    _, matrices, distortions, rotations, translations = cv2.calibrateMultiview(
        [corners] * len(frames),
        [list(rows) for rows in pixels],
        sizes,
        mask,
        np.full(count, cv2.CALIB_MODEL_PINHOLE, dtype=np.uint8),
        None,
        None,
        None,
        None,
        flagsForIntrinsics=np.full(count, cv2.CALIB_FIX_K3, dtype=np.int32),
    )
    cameras = tuple(
        Camera.from_matrix(MODEL, size, K, np.ravel(d)[:4])
        for size, K, d in zip(sizes, matrices, distortions, strict=True)
    )
    poses = tuple(
        Pose(cv2.Rodrigues(np.asarray(R))[0] if np.size(R) == 3 else R, np.ravel(t))
        for R, t in zip(rotations, translations, strict=True)
    )
    return Answer(Estimate(cameras, tuple(pose @ poses[0].inverse() for pose in poses)))


def colmap(site: BenchSite, detections: SiteDetections) -> Answer:
    """pycolmap's joint solve with its own defaults, from OpenCV's chain and the boards that it places.

    ``bare`` is the solve alone; ``ours_bare`` is rigcal's from the very same start, over the same corners.
    """
    observations, start = placed_boards(detections, chain(site, detections).estimate)
    count = len(start.cameras)
    made = _colmap._reconstruction(observations, start)
    adjuster = pycolmap.create_default_bundle_adjuster(*_colmap_problem(made), made)
    with Stopwatch() as bare:
        adjuster.solve()
    sensors = [made.rig(1).sensor_from_rig(_colmap._sensor(c)).matrix() for c in range(1, count)]
    cameras = tuple(_colmap.from_colmap(made.camera(c + 1), MODEL) for c in range(count))
    poses = (Pose.identity(), *[Pose(matrix[:, :3], matrix[:, 3]) for matrix in sensors])
    freedom = lens_freedom(start.cameras, poses_free=(False, *[True] * (count - 1)))
    with Stopwatch() as same:
        solve(observations, start, freedom, SolveOptions())
    return Answer(Estimate(cameras, poses), bare.named("bare_") | same.named("ours_bare_"))


def _colmap_problem(
    made: pycolmap.Reconstruction,
) -> tuple[pycolmap.BundleAdjustmentOptions, pycolmap.BundleAdjustmentConfig]:
    """Everything free but the corners in the board."""
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in made.images:
        config.add_image(image_id)
    for point_id in made.points3D:
        config.add_constant_point(point_id)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = True
    options.refine_rig_from_world = options.refine_sensor_from_rig = True
    options.print_summary = False
    options.ceres.auto_select_solver_type = False  # above 1000 images its choice does not end
    options.ceres.solver_options.num_threads = 1  # as every method here
    return options, config


METHODS: Mapping[str, Callable[[BenchSite, SiteDetections], Answer]] = {
    "ours": ours,
    "ideal": ideal,
    "chain": chain,
    "pycolmap": colmap,
    "multiview": multiview,
}
"""Each method that runs in this process, by name."""
