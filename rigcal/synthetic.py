"""A rig whose truth is known: exact detections, noise as a second function, and rendered board images.

Tests, benchmarks and the demo start here: a perfect rig gives exact corners; noise is added separately, so that
each stage can be shown to be exact without it and within a measured tolerance with it.

Images are made as a lens would see a flat board: each pixel's ray, undistorted once per camera, meets the board's
plane by a homography and reads the printed pattern through ``cv2.remap`` at twice the resolution, which is then
averaged, blurred and given sensor noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.camera import Camera
from rigcal.detections import BoardDetections, BoardView, Instants, SiteDetections
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig, RigCamera

GreyImage = NDArray[np.uint8]


def look_at(position_m: ArrayLike, target_m: ArrayLike) -> Pose:
    """``cam_from_world`` of a camera at ``position_m`` (3,) that looks at ``target_m`` (3,), world z up."""
    centre = np.asarray(position_m, dtype=np.float64)
    forward = np.asarray(target_m, dtype=np.float64) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Pose(rotation, -rotation @ centre)


def arc_rig(
    count: int,
    *,
    radius_m: float = 5.0,
    height_m: float = 2.0,
    arc_deg: float = 150.0,
    model: str = "opencv5",
    size_wh: tuple[int, int] = (1920, 1080),
    seed: int = 0,
) -> Rig:
    """A site as in the paper: ``count`` cameras on an arc at ``height_m``, looking at the scene's centre.

    Distances vary by 20 % and lenses by a few percent. ``arc_deg=360`` spaces the cameras evenly on a ring. The
    world has z up, its floor at 0 and its origin below the scene's centre; camera ``cam0`` is the reference.
    """
    rng = np.random.default_rng(seed)
    step = arc_deg / count if arc_deg == 360.0 else arc_deg / max(count - 1, 1)
    cameras: list[tuple[Camera, Pose]] = []
    for index in range(count):
        angle = np.deg2rad(-arc_deg / 2 + index * step)
        distance_m = radius_m * rng.uniform(0.8, 1.2)
        position = [distance_m * np.sin(angle), -distance_m * np.cos(angle), height_m + rng.uniform(-0.1, 0.1)]
        target = [*rng.uniform(-0.3, 0.3, 2), 1.0 + rng.uniform(-0.1, 0.1)]
        cameras.append((random_camera(model, size_wh, rng), look_at(position, target)))
    cam0_from_world = cameras[0][1]
    members = tuple(
        RigCamera(
            f"cam{i}",
            camera,
            Pose.identity() if i == 0 else cam_from_world @ cam0_from_world.inverse(),
            serial=f"SIM{i:04d}",
        )
        for i, (camera, cam_from_world) in enumerate(cameras)
    )
    return Rig("simulated", members, "cam0", "PASS", world_from_rig=cam0_from_world.inverse())


def random_camera(model: str, size_wh: tuple[int, int], rng: np.random.Generator) -> Camera:
    """A lens of that model with plausible coefficients: about 70 degrees wide, or 120 for a fisheye."""
    width, height = size_wh
    focal = (0.45 if model == "fisheye4" else 0.73) * max(size_wh) * rng.uniform(0.99, 1.01)
    centre = np.array([width - 1, height - 1]) / 2 + rng.normal(0, 0.005 * max(size_wh), 2)
    distortion = {
        "opencv4": [-0.1, 0.05, 5e-4, -5e-4],
        "opencv5": [-0.1, 0.05, 5e-4, -5e-4, -0.01],
        "opencv8": [0.2, -0.05, 5e-4, -5e-4, 0.01, 0.3, -0.02, 0.01],
        "fisheye4": [-0.02, 0.01, -0.003, 0.0005],
    }[model]
    scaled = np.asarray(distortion) * rng.uniform(0.8, 1.2, len(distortion))
    return Camera(model, size_wh, np.concatenate([[focal, focal * rng.uniform(0.998, 1.002)], centre, scaled]))


def board_poses_for_pair(
    rig: Rig, first: str, second: str, board: Board, count: int, *, distance_m: tuple[float, float], seed: int
) -> list[Pose]:
    """``count`` poses ``rig_from_board`` that both cameras see whole, facing between them, tilted up to 35 degrees.

    Raises:
        ValueError: where no such poses are found (cameras that do not look at a common volume).
    """
    one, two = rig.camera(first), rig.camera(second)
    return _sample_poses([one, two], board, count, distance_m=distance_m, seed=seed)


def board_poses_for_camera(
    rig: Rig, camera_id: str, board: Board, count: int, *, distance_m: tuple[float, float], seed: int
) -> list[Pose]:
    """``count`` poses ``rig_from_board`` that one camera sees whole, all over its image."""
    return _sample_poses([rig.camera(camera_id)], board, count, distance_m=distance_m, seed=seed)


def _sample_poses(
    cameras: Sequence[RigCamera], board: Board, count: int, *, distance_m: tuple[float, float], seed: int
) -> list[Pose]:
    rng = np.random.default_rng(seed)
    corners = board.corners_in_board
    poses: list[Pose] = []
    for _ in range(2000 * count):
        if len(poses) == count:
            return poses
        viewer = cameras[int(rng.integers(len(cameras)))]
        width, height = viewer.camera.size_wh
        ray = viewer.camera.rays(np.array([rng.uniform(0, width), rng.uniform(0, height)]))
        centre_in_rig = viewer.cam_from_rig.inverse().apply(ray * rng.uniform(*distance_m))
        towards = np.mean([c.cam_from_rig.inverse().translation_m for c in cameras], axis=0) - centre_in_rig
        rotation = _facing(towards, viewer, rng)
        pose = Pose(rotation, centre_in_rig - rotation @ corners.mean(axis=0))
        if all(_sees_whole(camera, pose, corners) for camera in cameras):
            poses.append(pose)
    raise ValueError(f"found {len(poses)} of {count} board poses seen by {', '.join(c.id for c in cameras)}")


def _facing(towards: Floats, viewer: RigCamera, rng: np.random.Generator) -> Floats:
    """Rotation of a board whose front (its -z side) faces ``towards``, upright in the viewer, then tilted."""
    z_axis = -towards / np.linalg.norm(towards)
    x_axis = viewer.cam_from_rig.rotation[0] - (viewer.cam_from_rig.rotation[0] @ z_axis) * z_axis
    x_axis /= np.linalg.norm(x_axis)
    upright = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=1)
    tilt = Rotation.from_euler("xyz", [rng.uniform(-35, 35), rng.uniform(-35, 35), rng.uniform(-25, 25)], degrees=True)
    return np.asarray(upright @ tilt.as_matrix())


def _sees_whole(camera: RigCamera, rig_from_board: Pose, corners: Floats) -> bool:
    cam_from_board = camera.cam_from_rig @ rig_from_board
    away = cam_from_board.rotation[:, 2] @ cam_from_board.translation_m / np.linalg.norm(cam_from_board.translation_m)
    if away < 0.35:  # the camera sees the back, or the front at less than 20 degrees
        return False
    points = cam_from_board.apply(corners)
    if (points[:, 2] <= 0.1).any():
        return False
    pixels = camera.camera.project(points)
    margin = 0.03 * max(camera.camera.size_wh)
    width, height = camera.camera.size_wh
    return bool((pixels > margin).all() and (pixels < np.array([width, height]) - margin).all())


def exact_detections(
    rig: Rig, board: Board, rig_from_board: Sequence[Pose], *, seen_by: Sequence[Sequence[str]] | None = None
) -> SiteDetections:
    """What a perfect detector finds of boards at poses ``rig_from_board``, one instant each.

    Args:
        rig: The true rig.
        board: The board.
        rig_from_board: One pose per instant.
        seen_by: Per instant the cameras that may see it; None: every camera that sees it whole.
    """
    corners = board.corners_in_board
    frames = tuple(f"{i:06d}" for i in range(len(rig_from_board)))
    cameras = []
    for camera in rig.cameras:
        views = []
        for index, pose in enumerate(rig_from_board):
            allowed = seen_by is None or camera.id in seen_by[index]
            if allowed and _sees_whole(camera, pose, corners):
                pixels = camera.camera.project((camera.cam_from_rig @ pose).apply(corners))
                views.append(BoardView(index, np.arange(len(corners)), pixels))
        cameras.append(BoardDetections(camera.id, camera.camera.size_wh, frames, tuple(views)))
    numbers = np.arange(len(frames))
    frame_idx = np.repeat(numbers[:, None], len(rig.cameras), axis=1)
    instants = Instants("frame numbers", frame_idx, numbers.astype(float), np.zeros(frame_idx.shape))
    return SiteDetections(board, tuple(cameras), instants)


def with_noise(detections: SiteDetections, sigma_px: float, *, seed: int) -> SiteDetections:
    """The same detections with independent Gaussian noise of ``sigma_px`` per axis on every corner."""
    rng = np.random.default_rng(seed)
    return replace(
        detections,
        cameras=tuple(
            replace(
                camera,
                views=tuple(
                    replace(view, corners_px=view.corners_px + rng.normal(0, sigma_px, view.corners_px.shape))
                    for view in camera.views
                ),
            )
            for camera in detections.cameras
        ),
    )


@dataclass(frozen=True, slots=True, eq=False)
class BoardTexture:
    """A printed board as an image, and where it lies in the board frame."""

    image: GreyImage
    pixels_per_m: float
    origin_m: tuple[float, float]
    """Board coordinates of the centre of the image's top-left pixel."""


def draw_board(board: Board, *, pixels_per_square: int = 40) -> BoardTexture:
    """The printed pattern with a white margin of one square around it."""
    p = pixels_per_square
    if isinstance(board, Checkerboard):
        rows, columns = board.rows + 1, board.columns + 1
        cells = (np.indices((rows, columns)).sum(axis=0) % 2 == 1).astype(np.uint8) * 255
        pattern = np.kron(cells, np.ones((p, p), dtype=np.uint8))
        origin_squares = -2.0  # a margin and one square before the first inner corner
    elif isinstance(board, Charuco):
        drawn = opencv_charuco(board).generateImage((board.columns * p, board.rows * p), marginSize=0)
        pattern = np.asarray(255 - drawn if board.inverted else drawn, dtype=np.uint8)
        origin_squares = -2.0
    else:
        pattern = _draw_aprilgrid(board, p)
        origin_squares = -1.0 - board.spacing
    margin = 0 if isinstance(board, Charuco) and board.inverted else 255
    image = np.pad(pattern, p, constant_values=margin)
    pixels_per_m = p / board.square_size_m
    origin = origin_squares * board.square_size_m + 0.5 / pixels_per_m
    return BoardTexture(image, pixels_per_m, (origin, origin))


def opencv_charuco(board: Charuco) -> cv2.aruco.CharucoBoard:
    """OpenCV's object of a ChArUco board, in metres."""
    made = cv2.aruco.CharucoBoard(
        (board.columns, board.rows),
        board.square_size_m,
        board.square_size_m * board.marker_ratio,
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary)),
    )
    made.setLegacyPattern(board.legacy)
    return made


def _draw_aprilgrid(board: AprilGrid, pixels_per_tag: int) -> GreyImage:
    """Tags where the board's corners have them, and at every corner of a tag Kalibr's small black square."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    gap = round(pixels_per_tag * board.spacing)
    pitch = pixels_per_tag + gap
    image = np.full((pitch * board.rows + gap, pitch * board.columns + gap), 255, dtype=np.uint8)
    for row, column in np.ndindex(board.rows + 1, board.columns + 1):
        image[row * pitch : row * pitch + gap, column * pitch : column * pitch + gap] = 0
    for tag in range(board.rows * board.columns):
        row, column = divmod(tag, board.columns)
        top, left = row * pitch + gap, (board.columns - 1 - column) * pitch + gap
        drawn = cv2.aruco.generateImageMarker(dictionary, tag, pixels_per_tag, borderBits=board.border_bits)
        image[top : top + pixels_per_tag, left : left + pixels_per_tag] = drawn
    return image


class BoardRenderer:
    """Renders boards for one camera; the undistorted rays are computed once."""

    def __init__(self, camera: Camera, *, supersampling: int = 2) -> None:
        self._camera, self._ss = camera, supersampling
        width, height = camera.size_wh
        offsets = (np.arange(supersampling) + 0.5) / supersampling - 0.5
        u = (np.arange(width)[:, None] + offsets).ravel()
        v = (np.arange(height)[:, None] + offsets).ravel()
        grid = np.stack(np.meshgrid(u, v), axis=-1)
        self._rays = camera.undistort(grid.reshape(-1, 2)).reshape(*grid.shape).astype(np.float32)

    def render(
        self,
        texture: BoardTexture,
        cam_from_board: Pose,
        *,
        blur_px: float = 0.7,
        noise_dn: float = 2.0,
        rng: np.random.Generator,
        background: GreyImage | None = None,
    ) -> GreyImage:
        """One image (H, W) of the board before a background; from behind, the board is a plain plate.

        Args:
            texture: The printed board.
            cam_from_board: Where it is.
            blur_px: Sigma of the lens blur in pixels.
            noise_dn: Sigma of the sensor noise in grey levels.
            rng: Source of the noise.
            background: (H, W) image behind the board; mid-grey when None.
        """
        width, height = self._camera.size_wh
        image = np.full((height, width), 110.0, np.float32) if background is None else background.astype(np.float32)
        box = self._box(texture, cam_from_board)
        if box is not None:
            if cam_from_board.rotation[:, 2] @ cam_from_board.translation_m < 0:
                texture = replace(texture, image=np.full_like(texture.image, 170))
            left, top, right, bottom = box
            patch, covered = self._patch(texture, cam_from_board, box)
            view = image[top:bottom, left:right]
            image[top:bottom, left:right] = view * (1 - covered) + patch
        if blur_px > 0:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), dtype=np.float32)
        image = image + rng.normal(0, noise_dn, image.shape).astype(np.float32)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _box(self, texture: BoardTexture, cam_from_board: Pose) -> tuple[int, int, int, int] | None:
        height, width = texture.image.shape
        edge = np.linspace(0, 1, 9)
        border = np.concatenate(
            [np.stack([edge * 0 + side, edge], -1) for side in (0, 1)]
            + [np.stack([edge, edge * 0 + side], -1) for side in (0, 1)]
        )
        xy = border * [width, height] / texture.pixels_per_m + texture.origin_m
        pixels = self._camera.project(cam_from_board.apply(np.c_[xy, np.zeros(len(xy))]))
        if np.isnan(pixels).any():
            return None
        low = np.floor(pixels.min(axis=0)).astype(int) - 2
        high = np.ceil(pixels.max(axis=0)).astype(int) + 3
        (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, self._camera.size_wh)
        return (int(left), int(top), int(right), int(bottom)) if left < right and top < bottom else None

    def _patch(
        self, texture: BoardTexture, cam_from_board: Pose, box: tuple[int, int, int, int]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        ss, (left, top, right, bottom) = self._ss, box
        rays = self._rays[top * ss : bottom * ss, left * ss : right * ss]
        board_plane = np.column_stack([cam_from_board.rotation[:, :2], cam_from_board.translation_m])
        to_texture = np.array(
            [[1, 0, -texture.origin_m[0]], [0, 1, -texture.origin_m[1]], [0, 0, 1 / texture.pixels_per_m]]
        )
        H = (to_texture * texture.pixels_per_m @ np.linalg.inv(board_plane)).astype(np.float32)
        x, y = rays[..., 0], rays[..., 1]
        w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        u = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w
        v = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
        printed = texture.image.astype(np.float32) * (200 / 255) + 25  # paper and ink under room light
        colour = cv2.remap(printed, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        inside = cv2.remap(np.ones_like(printed), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        size = (right - left, bottom - top)
        return (
            np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), dtype=np.float32),
            np.asarray(cv2.resize(inside, size, interpolation=cv2.INTER_AREA), dtype=np.float32),
        )


def room_background(size_wh: tuple[int, int], *, seed: int) -> GreyImage:
    """A grey room to put behind a board: a lit wall, a darker floor, and clutter of soft rectangles."""
    rng = np.random.default_rng(seed)
    width, height = size_wh
    image = np.repeat(np.linspace(150, 95, height, dtype=np.float32)[:, None], width, axis=1)
    for _ in range(25):
        x, y = rng.integers(0, width), rng.integers(0, height)
        w, h = rng.integers(width // 40, width // 6), rng.integers(height // 40, height // 3)
        cv2.rectangle(image, (int(x), int(y)), (int(x + w), int(y + h)), float(rng.uniform(40, 200)), -1)
    return np.asarray(np.clip(cv2.GaussianBlur(image, (0, 0), 3), 0, 255), dtype=np.uint8)
