"""ChArUco boards and AprilGrids: both sides of a sheet, every way of printing them, and where their corners lie."""

from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigcal.board import AprilGrid, Charuco, parse_board
from rigcal.boardpose import board_poses
from rigcal.camera import Camera
from rigcal.captures import open_capture, read_frames
from rigcal.detect import detect_boards, find_board
from rigcal.detect.markers import shows_back
from rigcal.detections import BoardView
from rigcal.geometry import Pose
from rigcal.instants import find_instants
from rigcal.pipeline import CalibrateOptions, calibrate_lenses, calibrate_site
from rigcal.rig import Rig, RigCamera
from rigcal.site import GateLimits
from rigcal.synthetic import BoardRenderer, BoardTexture, draw_board, look_at, room_background

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "calibration"
needs_real = pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")

CAMERA = Camera("opencv5", (960, 540), np.array([700.0, 700.0, 479.5, 269.5, -0.1, 0.05, 0.0, 0.0, 0.0]))
RENDERER = BoardRenderer(CAMERA)
HALF_TURN = Pose(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
"""About the board's y axis: what lies at x on the front lies at -x on the back."""
TILTS_DEG = ((0.0, 0.0, 0.0), (30.0, -10.0, 40.0), (-20.0, 30.0, 170.0), (10.0, 35.0, -80.0))
BOARDS = [
    Charuco(7, 5, 0.05, dictionary="DICT_4X4_50"),
    Charuco(7, 5, 0.05, dictionary="DICT_4X4_1000", inverted=True),
    Charuco(6, 4, 0.05, 0.6, "DICT_5X5_100", legacy=True),
    Charuco(5, 6, 0.05, 0.8, "DICT_6X6_250"),
    AprilGrid(5, 4, 0.05),
    AprilGrid(4, 3, 0.06, border_bits=1),
    AprilGrid(4, 4, 0.05, spacing=0.25, family="tag25h9"),
]


def mirrored(texture: BoardTexture) -> BoardTexture:
    """The mirror image on the back of the sheet, each corner upon itself."""
    x, y = texture.origin_m
    width = texture.image.shape[1]
    image = np.ascontiguousarray(texture.image[:, ::-1])
    return replace(texture, image=image, origin_m=(-(x + (width - 1) / texture.pixels_per_m), y))


def photo(texture, cam_from_board, renderer=RENDERER, *, blur_px=0.7, noise_dn=2.0, seed=0, background=None):
    """A two-sided board: its front, or its back where the camera is behind it."""
    options = {"blur_px": blur_px, "noise_dn": noise_dn, "rng": np.random.default_rng(seed), "background": background}
    if cam_from_board.rotation[:, 2] @ cam_from_board.translation_m > 0:
        return renderer.render(texture, cam_from_board, **options)
    return renderer.render(mirrored(texture), cam_from_board @ HALF_TURN, **options)


def placed(board, tilt_deg, *, back=False, distance_m=0.6):
    rotation = Rotation.from_euler("xyz", tilt_deg, degrees=True).as_matrix()
    rotation = rotation @ HALF_TURN.rotation if back else rotation
    return Pose(rotation, np.array([0.01, -0.02, distance_m]) - rotation @ board.corners_in_board.mean(axis=0))


def truth(board, pose, camera=CAMERA):
    return camera.project(pose.apply(board.corners_in_board))


def rms(gaps):
    return float(np.sqrt((gaps**2).sum(axis=-1).mean()))


# ---- corners of both sides


@pytest.mark.parametrize("back", [False, True], ids=["front", "back"])
@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.spec)
def test_corners_of_either_side_carry_their_numbers_to_a_twentieth_of_a_pixel(board, back):
    texture = draw_board(board, pixels_per_square=60)
    gaps = []
    for seed, tilt in enumerate(TILTS_DEG):
        pose = placed(board, tilt, back=back)
        found = find_board(photo(texture, pose, seed=seed), board)
        assert found.problem == ""
        assert shows_back(board, found.corner_ids, found.corners_px) == back
        assert len(found.corner_ids) >= 0.8 * len(board.corners_in_board)
        gaps.append(found.corners_px - truth(board, pose)[found.corner_ids])
    assert rms(np.concatenate(gaps)) < 0.05


@pytest.mark.parametrize("board", [BOARDS[1], BOARDS[4]], ids=lambda board: board.kind)
def test_mirroring_an_image_mirrors_the_corners_and_keeps_their_numbers(board):
    image = photo(draw_board(board, pixels_per_square=60), placed(board, TILTS_DEG[1]), noise_dn=0.0)
    found, other = find_board(image, board), find_board(np.ascontiguousarray(image[:, ::-1]), board)
    assert np.array_equal(found.corner_ids, other.corner_ids)
    assert rms(found.corners_px - np.column_stack([959 - other.corners_px[:, 0], other.corners_px[:, 1]])) < 0.01


def test_a_board_seen_from_behind_has_the_camera_behind_it():
    board = BOARDS[0]
    for tilt in TILTS_DEG[1:]:
        pose = placed(board, tilt, back=True)
        ids = np.arange(len(board.corners_in_board))
        best, *_ = board_poses(CAMERA, board.corners_in_board, BoardView(0, ids, truth(board, pose)))
        assert best.rmse_px < 1e-6
        assert np.allclose(best.cam_from_board.rotation, pose.rotation, atol=1e-8)
        assert np.allclose(best.cam_from_board.translation_m, pose.translation_m, atol=1e-8)
        assert best.cam_from_board.inverse().translation_m[2] > 0


def around(board, radius_m=1.5):
    """Two cameras on either side of a board that stands in the middle."""
    cameras = []
    for angle_deg in (-25.0, 25.0, 155.0, 205.0):
        a = np.deg2rad(angle_deg)
        cameras.append(look_at([radius_m * np.sin(a), -radius_m * np.cos(a), 0.15], [0.0, 0.0, 0.0]))
    cam0_from_world = cameras[0]
    members = tuple(
        RigCamera(f"cam{k}", CAMERA, pose @ cam0_from_world.inverse() if k else Pose.identity())
        for k, pose in enumerate(cameras)
    )
    return Rig("around", members, "cam0", "PASS", world_from_rig=cam0_from_world.inverse())


def in_the_middle(board, count, seed=0):
    """Poses world_from_board of an upright board, turned and tilted, its front towards -y."""
    rng = np.random.default_rng(seed)
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    for _ in range(count):
        tilt = Rotation.from_euler("xyz", [*rng.uniform(-28, 28, 2), rng.uniform(-180, 180)], degrees=True)
        rotation = upright @ tilt.as_matrix()
        centre = rng.uniform([-0.25, -0.2, -0.12], [0.25, 0.2, 0.12])
        yield Pose(rotation, centre - rotation @ board.corners_in_board.mean(axis=0))


@pytest.fixture(scope="module")
def two_sided(tmp_path_factory):
    """A capture of a two-sided board between two pairs of cameras, and its truth."""
    board = Charuco(6, 5, 0.08, dictionary="DICT_4X4_50")
    rig, folder = around(board), tmp_path_factory.mktemp("two_sided")
    texture, background = draw_board(board, pixels_per_square=60), room_background(CAMERA.size_wh, seed=1)
    for camera in rig.cameras:
        (folder / camera.id).mkdir()
    for k, world_from_board in enumerate(in_the_middle(board, 14)):
        for c, camera in enumerate(rig.cameras):
            cam_from_board = camera.cam_from_rig @ rig.world_from_rig.inverse() @ world_from_board
            image = photo(texture, cam_from_board, seed=100 * k + c, background=background)
            cv2.imwrite(str(folder / camera.id / f"{k:02d}.png"), image)
    return board, rig, open_capture(folder)


def test_cameras_around_a_two_sided_board_are_calibrated(two_sided):
    board, rig, capture = two_sided
    detections = detect_boards(capture, board, instants=find_instants(capture))
    backs = [sum(shows_back(board, v.corner_ids, v.corners_px) for v in c.views) for c in detections.cameras]
    assert [len(camera.views) for camera in detections.cameras] == [14] * 4
    assert backs == [0, 0, 14, 14]
    options = CalibrateOptions(model="opencv5")
    lenses = calibrate_lenses(detections, None, options)
    result = calibrate_site(detections, GateLimits(), lenses, options)
    for camera, cam_from_rig in zip(rig.cameras, result.joint.cam_from_rig, strict=True):
        gap = cam_from_rig.inverse().translation_m - camera.cam_from_rig.inverse().translation_m
        assert np.linalg.norm(gap) < 0.01


# ---- partial and real boards


def test_half_a_board_gives_its_half_and_what_is_cut_through_is_left_out():
    board = BOARDS[0]
    pose = placed(board, TILTS_DEG[0])
    image, corners = photo(draw_board(board, pixels_per_square=60), pose), truth(board, pose)
    for cut_px in range(int(corners[2, 0]), int(corners[4, 0]), 5):
        cut = image.copy()
        cut[:, cut_px:] = 110
        found = find_board(cut, board)
        assert 8 <= len(found.corner_ids) <= 20
        assert np.linalg.norm(found.corners_px - corners[found.corner_ids], axis=1).max() < 0.1


@pytest.mark.parametrize("dim", [0.05, 0.02], ids=["10 grey levels", "4 grey levels"])
def test_markers_are_read_in_the_dark(dim):
    board = BOARDS[0]
    image = photo(draw_board(board, pixels_per_square=60), placed(board, TILTS_DEG[1]), noise_dn=0.0)
    noise = np.random.default_rng(0).normal(0, 1, image.shape)
    found = find_board(np.clip(np.rint(image * dim + 3 + noise), 0, 255).astype(np.uint8), board)
    assert len(found.corner_ids) >= 20
    assert rms(found.corners_px - truth(board, placed(board, TILTS_DEG[1]))[found.corner_ids]) < 0.25


def test_several_sides_of_a_sheet_are_told_where_markers_are_mirror_images_of_themselves():
    board = Charuco(4, 5, 0.05, dictionary="DICT_4X4_1000")  # its markers 8 and 9 are
    texture = draw_board(board, pixels_per_square=60)
    for back in (False, True):
        found = find_board(photo(texture, placed(board, TILTS_DEG[1], back=back)), board)
        assert len(found.corner_ids) == 12
        assert shows_back(board, found.corner_ids, found.corners_px) == back


@needs_real
def test_no_back_is_seen_in_a_real_capture_of_fronts():
    board = parse_board("charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000:inverted")
    camera = open_capture(REAL / "caliscope_charuco_calibration/calibration/extrinsic").cameras[1]
    boards = [find_board(image, board) for _, image in islice(read_frames(camera), 90)]
    seen = [found for found in boards if found is not None]
    assert len(seen) >= 10
    assert not any(found.problem or shows_back(board, found.corner_ids, found.corners_px) for found in seen)


@needs_real
@pytest.mark.parametrize(
    ("name", "tags"), [("data/1520525725372653511", 36), ("tests_data/right", 19), ("tests_data/top_right", 14)]
)
def test_real_kalibr_grids_show_no_fewer_tags_than_to_opencv(name, tags):
    grey = cv2.imread(str(REAL / "aprilgrid_samples" / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
    found = find_board(grey, AprilGrid(6, 6, 0.088))
    assert found.problem == ""
    assert len(found.corner_ids) >= 4 * tags
