"""pycolmap as the independent second solver. The only module that imports it.

COLMAP's conventions stop here: its pixel centres lie at +0.5, its quaternions are xyzw in Python.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap

from rigcal.bundle import State, bent
from rigcal.camera import Camera
from rigcal.corners import Observations
from rigcal.geometry import Pose

PIXEL_CENTRE = 0.5
"""COLMAP's coordinate of the centre of the first pixel, where OpenCV's is 0."""


@dataclass(frozen=True, slots=True)
class SecondOpinion:
    """What the second solver found."""

    cameras: tuple[Camera, ...]
    cam_from_rig: tuple[Pose, ...]
    free_lenses: tuple[bool, ...]
    """Per camera, whether it moved the lens too; False where COLMAP has no lens of that form."""


def solve_with_colmap(observations: Observations, start: State, *, free_lenses: Sequence[bool]) -> SecondOpinion:
    """Minimise the same reprojection error with Ceres through pycolmap, from the same start.

    Board corners are constant points, each board position is a frame whose pose is the rig's in the board, and the
    first camera is the reference sensor. COLMAP has no lens with five coefficients: such lenses are held, which still
    checks every pose.

    Args:
        observations: Corners that the first solver used.
        start: Where to begin; every board position needs a pose.
        free_lenses: Per camera, whether the first solver moved the lens.
    """
    free = tuple(
        wanted and camera.model != "opencv5" for wanted, camera in zip(free_lenses, start.cameras, strict=True)
    )
    reconstruction = _reconstruction(observations, start)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in reconstruction.images:
        config.add_image(image_id)
    for point_id in reconstruction.points3D:
        config.add_constant_point(point_id)
    for index, moves in enumerate(free):
        if not moves:
            config.set_constant_cam_intrinsics(index + 1)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = True
    options.refine_rig_from_world = options.refine_sensor_from_rig = True
    options.print_summary = False
    options.ceres.auto_select_solver_type = (
        False  # its choice above 1000 images does not end; the default, sparse Cholesky, does
    )
    options.ceres.solver_options.num_threads = 1  # sums in one order: the same bits every time
    options.ceres.solver_options.function_tolerance = 1e-12
    options.ceres.solver_options.gradient_tolerance = 1e-12
    options.ceres.solver_options.parameter_tolerance = 1e-12
    options.ceres.solver_options.max_num_iterations = 100
    pycolmap.create_default_bundle_adjuster(options, config, reconstruction).solve()
    rig = reconstruction.rig(1)
    poses = [Pose.identity()]
    for camera_idx in range(1, len(start.cameras)):
        found = rig.sensor_from_rig(_sensor(camera_idx))
        if found is None:
            raise ValueError(f"pycolmap lost the pose of sensor {camera_idx}")
        poses.append(Pose(found.matrix()[:, :3], found.matrix()[:, 3]))
    cameras = tuple(
        from_colmap(reconstruction.camera(index + 1), camera.model) if moves else camera
        for index, (camera, moves) in enumerate(zip(start.cameras, free, strict=True))
    )
    return SecondOpinion(cameras, tuple(poses), free)


def to_colmap(camera: Camera, camera_id: int) -> pycolmap.Camera:
    """The same lens as COLMAP writes it."""
    p = camera.params.copy()
    p[2:4] += PIXEL_CENTRE
    name = {"opencv4": "OPENCV", "fisheye4": "OPENCV_FISHEYE"}.get(camera.model, "FULL_OPENCV")
    params = np.concatenate([p, np.zeros(12 - len(p))]) if name == "FULL_OPENCV" else p
    width, height = camera.size_wh
    return pycolmap.Camera(camera_id=camera_id, model=name, width=width, height=height, params=params.tolist())


def from_colmap(camera: pycolmap.Camera, model: str) -> Camera:
    """A COLMAP lens in the form of one of our models."""
    params = np.array(camera.params)
    params[2:4] -= PIXEL_CENTRE
    return Camera(model, (camera.width, camera.height), params)


def _reconstruction(observations: Observations, start: State) -> pycolmap.Reconstruction:
    made = pycolmap.Reconstruction()
    rig = pycolmap.Rig(rig_id=1)
    for index, (camera, pose) in enumerate(zip(start.cameras, start.cam_from_rig, strict=True)):
        made.add_camera(to_colmap(camera, index + 1))
        if index == 0:
            rig.add_ref_sensor(_sensor(0))
        else:
            rig.add_sensor(_sensor(index), _rigid(pose))
    made.add_rig(rig)
    images = _images(observations)
    for board_idx in sorted({board_idx for _, board_idx, _ in images}):
        frame = pycolmap.Frame(frame_id=board_idx + 1, rig_id=1, rig_from_world=_rigid(start.rig_from_board[board_idx]))
        for image_id, (camera_idx, board, _) in enumerate(images, start=1):
            if board == board_idx:
                frame.add_data_id(pycolmap.data_t(_sensor(camera_idx), image_id))
        made.add_frame(frame)
    corners = bent(observations.corners_in_board, start.bow_m)
    tracks = [pycolmap.Track() for _ in corners]
    for image_id, (camera_idx, board_idx, rows) in enumerate(images, start=1):
        image = pycolmap.Image(
            name=f"{camera_idx}/{board_idx}",
            keypoints=observations.pixels[rows] + PIXEL_CENTRE,
            camera_id=camera_idx + 1,
            image_id=image_id,
        )
        image.frame_id = board_idx + 1
        made.add_image(image)
        for point2d, corner in enumerate(observations.corner_ids[rows]):
            tracks[int(corner)].add_element(image_id, point2d)
    for corner, track in enumerate(tracks):
        if track.length():
            made.add_point3D_with_id(corner + 1, pycolmap.Point3D(xyz=corners[corner], track=track))
    return made


def _images(observations: Observations) -> Sequence[tuple[int, int, slice]]:
    """(camera, board, rows) of every view."""
    starts = observations.view_starts
    ends = np.append(starts[1:], len(observations))
    return [
        (int(observations.camera_idx[a]), int(observations.board_idx[a]), slice(int(a), int(b)))
        for a, b in zip(starts, ends, strict=True)
    ]


def _sensor(camera_idx: int) -> pycolmap.sensor_t:
    return pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=camera_idx + 1)


def _rigid(pose: Pose) -> pycolmap.Rigid3d:
    return pycolmap.Rigid3d(pycolmap.Rotation3d(pose.rotation), pose.translation_m)
