"""Boards in images: where corners lie, in which order, what is no board, and what a second run remembers."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigcal.board import AprilGrid, Charuco, Checkerboard, parse_board
from rigcal.cache import DetectionCache, cache_key, default_cache
from rigcal.camera import Camera
from rigcal.captures import Capture, CaptureCamera, open_capture
from rigcal.detect import FoundBoard, detect_boards, find_board, sweep
from rigcal.detect.crossings import fit_crossings
from rigcal.detect.lattice import find_grids
from rigcal.detect.looks import closer_looks, first_looks
from rigcal.detect.saddles import find_saddles
from rigcal.detections import Instants
from rigcal.errors import BrokenFileError
from rigcal.geometry import Pose
from rigcal.instants import find_instants
from rigcal.synthetic import BoardRenderer, draw_board, room_background

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "calibration"
needs_real = pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")

BOARD = Checkerboard(9, 6, 0.025)
PX = 24  # of a square in the drawing
SIZE_WH = (480, 360)
VIEWS = {
    "facing": [[60, 50], [420, 60], [410, 310], [70, 300]],
    "tilted": [[90, 40], [400, 90], [380, 280], [80, 320]],
    "turned": [[420, 310], [60, 300], [70, 50], [410, 60]],
    "upright": [[320, 20], [330, 340], [130, 330], [140, 30]],
}


def checkerboard(board=BOARD, margin=1):
    cells = (np.indices((board.rows + 1, board.columns + 1)).sum(axis=0) % 2).astype(np.uint8) * 200 + 30
    return np.pad(np.kron(cells, np.ones((PX, PX), np.uint8)), margin * PX, constant_values=230)


def charuco(board):
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    made = cv2.aruco.CharucoBoard((board.columns, board.rows), 1.0, board.marker_ratio, dictionary)
    drawn = np.pad(made.generateImage((board.columns * PX, board.rows * PX)), PX, constant_values=255)
    return 255 - drawn if board.inverted else drawn


def kalibr_grid(board, tag=40):
    """As Kalibr prints it: tag 0 at the lower left, tags upwards, each a picture of OpenCV's turned by 180 degrees, a
    black square between every four corners."""
    gap = round(tag * board.spacing)
    pitch = tag + gap
    image = np.full((board.rows * pitch + gap, board.columns * pitch + gap), 255, np.uint8)
    for row in range(board.rows + 1):
        for column in range(board.columns + 1):
            image[row * pitch :, column * pitch :][:gap, :gap] = 0
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    for number in range(board.rows * board.columns):
        row, column = board.rows - 1 - number // board.columns, number % board.columns
        drawn = np.rot90(cv2.aruco.generateImageMarker(family, number, tag, borderBits=board.border_bits), 2)
        image[row * pitch + gap :, column * pitch + gap :][:tag, :tag] = drawn
    return np.pad(image, 2 * gap, constant_values=255)


def photo(drawing, view="facing", noise=2.0, blur=0.7, seed=0, supersampling=4):
    """The drawing's corners at the four given pixels; grey image and the homography from drawing to image."""
    height, width = drawing.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    homography = cv2.getPerspectiveTransform(corners.astype(np.float32), np.array(VIEWS[view], np.float32))
    s = supersampling
    finer = np.array([[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1.0]])
    big = cv2.warpPerspective(drawing, finer @ homography, (SIZE_WH[0] * s, SIZE_WH[1] * s), borderValue=110)
    image = cv2.GaussianBlur(cv2.resize(big, SIZE_WH, interpolation=cv2.INTER_AREA).astype(np.float64), (0, 0), blur)
    image += np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), homography


def truth(board, homography, px=PX, margin=2.0):
    """Pixels of every corner of a board whose first corner is ``margin`` squares from the drawing's edges."""
    flat = (board.corners_in_board[:, :2] / board.square_size_m + margin) * px - 0.5
    return cv2.perspectiveTransform(flat[None], homography)[0]


def rms(gaps):
    return np.sqrt((gaps**2).sum(axis=-1).mean())


# ---- corners to sub-pixel


@pytest.mark.parametrize(
    ("noise", "blur", "within_px"), [(0.0, 0.5, 0.02), (2.0, 0.7, 0.02), (8.0, 0.7, 0.05), (2.0, 2.5, 0.06)]
)
def test_the_fit_is_nearer_to_the_truth_than_corner_sub_pix(noise, blur, within_px):
    image, homography = photo(checkerboard(), noise=noise, blur=blur)
    corners = truth(BOARD, homography)
    grid = corners.reshape(BOARD.rows, BOARD.columns, 2)
    along_x, along_y = (np.gradient(grid, axis=axis).reshape(-1, 2) for axis in (1, 0))
    guess = corners + np.random.default_rng(1).normal(0, 0.5, corners.shape)
    fit = fit_crossings(image, guess, along_x, along_y, reach=0.42)
    assert rms(fit.corners_px - corners) < within_px
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    windows = [
        cv2.cornerSubPix(image, np.float32(guess)[:, None].copy(), (w, w), (-1, -1), criteria) for w in (5, 8, 11)
    ]
    assert rms(fit.corners_px - corners) < 0.7 * min(rms(theirs[:, 0] - corners) for theirs in windows)
    assert fit.misfit.max() < 0.2
    assert np.allclose(fit.moved_px, np.linalg.norm(fit.corners_px - guess, axis=1))


def test_corners_outside_of_the_image_are_told_by_their_misfit():
    image, _ = photo(checkerboard())
    far = np.array([[-300.0, 20.0], [100.0, 900.0]])
    fit = fit_crossings(image, far, np.tile([[20.0, 0.0]], (2, 1)), np.tile([[0.0, 20.0]], (2, 1)), reach=0.42)
    assert fit.misfit.tolist() == [1.0, 1.0]
    assert np.array_equal(fit.corners_px, far)


@pytest.mark.parametrize("blur", [0.7, 1.5, 3.0])
def test_the_fit_measures_how_wide_the_edges_are(blur):
    image, homography = photo(checkerboard(), blur=blur)
    found = find_board(image, BOARD)
    assert found.blur_px == pytest.approx(np.hypot(blur, 0.29), rel=0.12)  # 0.29: of a pixel's own width
    smeared = cv2.GaussianBlur(image, (25, 1), 3.0)  # as if it moved to the side
    found = find_board(smeared, BOARD)
    assert found.blur_px == pytest.approx(np.hypot(blur, 3.0), rel=0.12)
    assert rms(found.corners_px - truth(BOARD, homography)) < 0.1


def test_a_window_that_the_image_cuts_in_half_is_no_crossing():
    image, homography = photo(checkerboard())
    corners = truth(BOARD, homography)
    grid = corners.reshape(BOARD.rows, BOARD.columns, 2)
    along_x, along_y = (np.gradient(grid, axis=axis).reshape(-1, 2) for axis in (1, 0))
    left = int(np.ceil(corners[0, 0]))
    fit = fit_crossings(image[:, left:], corners - [left, 0], along_x, along_y, reach=0.42)
    assert fit.misfit[0] == 1.0
    assert (fit.misfit[1 : BOARD.columns] < 0.2).all()


# ---- saddles and grids


@pytest.mark.parametrize("view", VIEWS)
def test_grids_of_saddles_have_every_corner_within_half_a_pixel(view):
    image, homography = photo(checkerboard(), view)
    (grid,) = find_grids(find_saddles(image), (BOARD.columns, BOARD.rows))
    gaps = np.linalg.norm(grid.reshape(-1, 1, 2) - truth(BOARD, homography), axis=-1)
    assert grid.shape == (BOARD.rows, BOARD.columns, 2)
    assert gaps.min(axis=1).max() < 0.5
    assert sorted(gaps.argmin(axis=1)) == list(range(54))


def test_light_is_where_the_bisector_says_and_the_edges_cross_beside_it():
    rows, columns = np.indices((41, 41)) - 20
    skew = columns - 0.6 * rows
    image = cv2.GaussianBlur(np.where(rows * skew > 0, 200, 50).astype(np.uint8), (5, 5), 1.0)
    saddles = find_saddles(image)
    nearest = np.linalg.norm(saddles.points_px - 20, axis=1).argmin()
    assert np.allclose(saddles.points_px[nearest], 20, atol=0.6)
    light = saddles.light[nearest]
    ahead = np.rint(20 + 9 * np.array([np.sin(light), np.cos(light)])).astype(int)
    assert image[tuple(ahead)] > 190
    angles = np.sort(np.rad2deg(np.arctan2(saddles.edges[nearest, :, 1], saddles.edges[nearest, :, 0])) % 180)
    assert np.allclose(angles, [0, np.rad2deg(np.arctan2(1, 0.6))], atol=12) or np.allclose(angles[1], 180, atol=12)


def test_a_corner_hidden_by_a_finger_is_left_out_and_the_board_kept():
    image, homography = photo(checkerboard())
    corners = truth(BOARD, homography)
    cv2.circle(image, np.rint(corners[22]).astype(int).tolist(), 9, 150, -1)
    found = find_board(image, BOARD, thorough=False)
    assert 22 not in found.corner_ids
    assert len(found.corner_ids) >= 52
    assert rms(found.corners_px - corners[found.corner_ids]) < 0.03


def test_corners_that_the_edge_of_a_shadow_runs_through_are_left_out():
    image, homography = photo(checkerboard(), noise=0.0)
    corners = truth(BOARD, homography)
    shade = np.where(np.arange(SIZE_WH[0]) < corners[4, 0] + 2, 0.4, 1.0)
    shadowed = np.clip(image * cv2.GaussianBlur(shade[None], (9, 1), 1.5), 0, 255).astype(np.uint8)
    found = find_board(shadowed, BOARD, thorough=False)
    assert len(found.corner_ids) >= 45
    assert rms(found.corners_px - corners[found.corner_ids]) < 0.06


# ---- checkerboards


@pytest.mark.parametrize(
    ("camera", "distance_m", "most_tilt_deg", "within_px"),
    [
        (Camera("opencv5", (960, 540), np.array([700, 700, 480, 270, -0.2, 0.08, 0, 0, 0])), 2.4, 65, 0.04),
        (Camera("opencv5", (544, 960), np.array([700, 700, 272, 480, -0.1, 0.05, 0, 0, 0])), 1.6, 55, 0.03),
        (Camera("opencv4", (320, 240), np.array([240, 240, 160, 120, 0, 0, 0, 0])), 1.5, 40, 0.06),
        (Camera("fisheye4", (800, 600), np.array([260, 260, 400, 300, -0.02, 0.01, 0, 0])), 0.6, 45, 0.06),
    ],
)
def test_rendered_boards_are_found_quickly_wherever_they_are(camera, distance_m, most_tilt_deg, within_px):
    rng, board = np.random.default_rng(7), Checkerboard(9, 6, 0.06)
    renderer, texture = BoardRenderer(camera, supersampling=3), draw_board(board)
    background = room_background(camera.size_wh, seed=1)
    for tilt_deg in (0, 0.6 * most_tilt_deg, most_tilt_deg):
        turn = Rotation.from_euler("zyx", [12, 0.7 * tilt_deg, -0.7 * tilt_deg], degrees=True).as_matrix()
        pose = Pose(turn, np.array([0.1, -0.1, distance_m]) - turn @ board.corners_in_board.mean(axis=0))
        image = renderer.render(texture, pose, noise_dn=2.5, rng=rng, background=background)
        found = find_board(image, board, thorough=False)
        corners = camera.project(pose.apply(board.corners_in_board))
        assert rms(found.corners_px - corners[found.corner_ids]) < within_px
        assert len(found.corner_ids) == 54
    assert find_board(background, board, thorough=False) is None


@pytest.mark.parametrize("view", VIEWS)
def test_checkerboards_are_found_in_the_order_that_their_colours_say(view):
    image, homography = photo(checkerboard(), view)
    found = find_board(image, BOARD)
    assert found.problem == ""
    assert found.corner_ids.tolist() == list(range(54))
    assert rms(found.corners_px - truth(BOARD, homography)) < 0.02


@pytest.mark.parametrize("board", [Checkerboard(8, 6, 0.025), Checkerboard(7, 7, 0.025)])
@pytest.mark.parametrize("view", ["turned", "upright"])
def test_boards_that_look_alike_when_turned_begin_at_the_upper_left_and_are_never_mirrored(board, view):
    image, homography = photo(checkerboard(board), view)
    found = find_board(image, board)
    grid = found.corners_px.reshape(board.rows, board.columns, 2)
    assert grid[0, 0].sum() < grid[-1, -1].sum()
    right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    assert right[0] * down[1] - right[1] * down[0] > 0
    corners = truth(board, homography)
    gaps = np.linalg.norm(found.corners_px[:, None] - corners[None], axis=-1).min(axis=1)
    assert gaps.max() < 0.1
    assert not found.turned


@pytest.mark.parametrize(
    ("size", "view"), [((8, 6), "facing"), ((8, 6), "upright"), ((7, 6), "turned"), ((8, 5), "tilted")]
)
def test_a_part_of_a_larger_board_is_not_taken_for_a_board(size, view):
    found = find_board(photo(checkerboard(margin=0), view)[0], Checkerboard(*size, 0.025))
    assert found is None or found.problem == f"a checkerboard larger than {size[0]}x{size[1]} inner corners"


def test_parts_of_larger_boards_are_met_so_that_the_guard_is_needed():
    image, _ = photo(checkerboard(margin=0))
    assert cv2.findChessboardCorners(image, (8, 6))[0]
    assert find_board(image, Checkerboard(8, 6, 0.025)).problem


@pytest.mark.parametrize(("size", "margin"), [((9, 7), 0), ((9, 7), 1), ((10, 6), 0), ((10, 7), 1)])
def test_the_border_of_the_printed_squares_is_no_row_of_corners(size, margin):
    assert find_board(photo(checkerboard(margin=margin))[0], Checkerboard(*size, 0.025)) is None


def test_boards_of_low_contrast_and_noise_are_found_by_the_thorough_finders():
    faint = (checkerboard().astype(float) * 0.12 + 90).astype(np.uint8)
    image, homography = photo(faint, noise=4.0, blur=1.0)
    found = find_board(image, BOARD, thorough=True)
    assert rms(found.corners_px - truth(BOARD, homography)[found.corner_ids]) < 0.15


def test_no_board_is_found_where_none_is():
    rng = np.random.default_rng(3)
    clutter = cv2.resize(rng.integers(0, 255, (24, 32), dtype=np.uint8), SIZE_WH, interpolation=cv2.INTER_NEAREST)
    for image in (clutter, np.full((360, 480), 128, np.uint8)):
        for board in (BOARD, Charuco(5, 4, 0.05), AprilGrid(4, 3, 0.05)):
            assert find_board(image, board) is None


# ---- markers


@pytest.mark.parametrize(
    ("view", "inverted"), [("facing", True), ("tilted", False), ("turned", True), ("upright", False)]
)
def test_charuco_corners_carry_their_numbers(view, inverted):
    board = Charuco(7, 5, 0.05, dictionary="DICT_4X4_50", inverted=inverted)
    image, homography = photo(charuco(board), view, blur=0.5)
    found = find_board(image, board)
    assert found.corner_ids.tolist() == list(range(24))
    assert rms(found.corners_px - truth(board, homography)) < 0.06
    assert find_board(image, replace(board, inverted=not inverted)) is None


def test_a_board_partly_in_view_gives_the_corners_that_are_there_and_a_single_row_none():
    board = Charuco(7, 5, 0.05, dictionary="DICT_4X4_50")
    image, homography = photo(charuco(board), blur=0.5)
    corners = truth(board, homography)
    cut = image.copy()
    cut[:, 240:] = 110
    found = find_board(cut, board)
    assert 6 <= len(found.corner_ids) <= 16
    assert rms(found.corners_px - corners[found.corner_ids]) < 0.06
    cut = image.copy()
    cut[160:] = 110  # one row of corners
    assert find_board(cut, board) is None


def test_charuco_markers_in_another_layout_are_not_believed():
    board = Charuco(7, 5, 0.05, dictionary="DICT_4X4_50")
    image, _ = photo(charuco(board), blur=0.5)
    for other in (Charuco(5, 7, 0.05, dictionary="DICT_4X4_50"), Charuco(6, 5, 0.05, dictionary="DICT_4X4_50")):
        found = find_board(image, other)
        assert found is None or found.problem == f"its markers do not lie as on {other.spec}"


@pytest.mark.parametrize(("view", "border_bits"), [*((view, 2) for view in VIEWS), ("facing", 1)])
def test_kalibr_grids_have_their_corners_where_the_board_says(view, border_bits):
    board = AprilGrid(4, 3, 0.05, border_bits=border_bits)
    image, homography = photo(kalibr_grid(board), view, blur=0.5)
    found = find_board(image, board)
    assert found.corner_ids.tolist() == list(range(48))
    tag, gap = 40, 12
    tags = [(3 * gap + (tag + gap) * (k % 4), 3 * gap + (tag + gap) * (2 - k // 4)) for k in range(12)]
    drawn = [(x + dx, y + dy) for x, y in tags for dx, dy in ((tag, tag), (0, tag), (0, 0), (tag, 0))]
    expected = cv2.perspectiveTransform(np.array([drawn], float) - 0.5, homography)[0]
    assert rms(found.corners_px - expected) < 0.06
    flat = cv2.perspectiveTransform(expected[None], np.linalg.inv(homography))[0]
    plane = np.column_stack([board.corners_in_board[:, :2], np.ones(48)])
    placed, *_ = np.linalg.lstsq(plane, flat)  # turned and scaled only: as printed, and not mirrored
    assert np.allclose(plane @ placed, flat, atol=1e-3)
    assert placed[0, 0] == pytest.approx(placed[1, 1])
    assert placed[0, 1] == pytest.approx(-placed[1, 0], abs=1e-3)


def test_tags_of_other_boards_and_grids_of_another_width_are_left_out():
    image, _ = photo(kalibr_grid(AprilGrid(4, 3, 0.05)), blur=0.5)
    lower = find_board(image, AprilGrid(4, 2, 0.05))
    assert lower.corner_ids.tolist() == list(range(32))
    assert lower.problem == ""
    for columns in (3, 5):
        wrong = AprilGrid(columns, 3, 0.05)
        assert find_board(image, wrong).problem == f"its markers do not lie as on {wrong.spec}"


# ---- a whole capture


@pytest.fixture
def capture(tmp_path):
    for camera, views in {"cam0": ("facing", "tilted"), "cam1": ("upright", "turned")}.items():
        (tmp_path / camera).mkdir()
        for k, view in enumerate(views):
            cv2.imwrite(str(tmp_path / camera / f"{k}.png"), photo(checkerboard(), view)[0])
    cv2.imwrite(str(tmp_path / "cam1" / "2.png"), np.full((360, 480), 120, np.uint8))
    return open_capture(tmp_path)


def detect(capture, board=BOARD, **options):
    return detect_boards(capture, board, instants=find_instants(capture), **options)


def same(first, second):
    assert [c.findings for c in first.cameras] == [c.findings for c in second.cameras]
    for one, two in zip(first.cameras, second.cameras, strict=True):
        assert [v.frame_idx for v in one.views] == [v.frame_idx for v in two.views]
        for v, w in zip(one.views, two.views, strict=True):
            assert np.array_equal(v.corners_px, w.corners_px)
            assert np.array_equal(v.corner_ids, w.corner_ids)


def test_every_camera_of_a_capture_is_searched(capture):
    calls = []
    found = detect(capture, progress=lambda done, total: calls.append((done, total)))
    assert found.camera_ids == ("cam0", "cam1")
    assert [[v.frame_idx for v in camera.views] for camera in found.cameras] == [[0, 1], [0, 1]]
    assert found.cameras[1].frames == ("0", "1", "2")
    assert found.cameras[0].size_wh == SIZE_WH
    assert found.board == BOARD
    assert found.instants.rule == "frame numbers"
    assert found.digest == capture.digest()
    assert calls[-1] == (6, 6)  # five frames, and one without a board once more
    assert all(a <= b for a, b in pairwise(calls))


def test_the_number_of_workers_and_the_cache_change_nothing(capture, tmp_path):
    cache = DetectionCache(tmp_path / "cache")
    one = detect(capture, workers=1)
    same(one, detect(capture, workers=3, cache=cache))
    same(one, detect(capture, cache=cache))


def test_a_second_run_reads_no_image(capture, tmp_path, monkeypatch):
    cache = DetectionCache(tmp_path / "cache")
    first = detect(capture, cache=cache)
    assert len(list(cache.folder.rglob("*.npz"))) == 5

    def fail(*_args, **_options):
        raise AssertionError("an image was read")

    monkeypatch.setattr(sweep, "read_image", fail)
    calls = []
    same(first, detect(capture, cache=cache, progress=lambda *call: calls.append(call)))
    assert calls[-1] == (5, 5)
    with pytest.raises(AssertionError, match="an image was read"):
        detect(capture, Checkerboard(9, 6, 0.03), cache=cache)


def test_a_video_in_the_cache_is_not_decoded_again(tmp_path, monkeypatch):
    with av.open(str(tmp_path / "cam0.mp4"), "w") as container:
        stream = container.add_stream("mpeg4", rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = *SIZE_WH, "yuv420p", 10_000_000
        for view in VIEWS:
            image = cv2.cvtColor(photo(checkerboard(), view)[0], cv2.COLOR_GRAY2BGR)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    capture, cache = open_capture(tmp_path), DetectionCache(tmp_path / "cache")
    first = detect(capture, cache=cache)
    assert [v.frame_idx for v in first.cameras[0].views] == [0, 1, 2, 3]

    def fail(*_args, **_options):
        raise AssertionError("a video was read")

    monkeypatch.setattr(sweep, "read_frames", fail)
    same(first, detect(capture, cache=cache))


@pytest.mark.parametrize("damage", ["nothing", "half", "other arrays", "wrong counts"])
def test_damaged_cache_entries_are_made_again(capture, tmp_path, damage):
    cache = DetectionCache(tmp_path / "cache")
    first = detect(capture, cache=cache)
    for path in cache.folder.rglob("*.npz"):
        content = path.read_bytes()
        with np.load(path) as stored:
            arrays = dict(stored)
        match damage:
            case "nothing":
                path.write_bytes(b"")
            case "half":
                path.write_bytes(content[: len(content) // 2])
            case "other arrays":
                np.savez(path, a=np.zeros(3))
            case "wrong counts":
                np.savez(path, **(arrays | {"counts": arrays["counts"] + 1}))
    same(first, detect(capture, cache=cache))
    if damage != "wrong counts":
        assert all(cache.load(path.stem) is not None for path in cache.folder.rglob("*.npz"))


def test_a_cache_that_cannot_be_written_costs_time_only(capture, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("x")
    same(detect(capture), detect(capture, cache=DetectionCache(blocked)))


def test_the_environment_names_the_cache_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("RIGCAL_CACHE", str(tmp_path / "here"))
    assert default_cache().folder == tmp_path / "here"
    monkeypatch.delenv("RIGCAL_CACHE")
    assert default_cache().folder.name == "rigcal"
    keys = {cache_key(c, board=b, version=v) for c in "ab" for b in "cd" for v in "ef"}
    assert len(keys) == 8


def test_opencv_keeps_its_threads_and_a_broken_image_is_named(capture):
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    path = capture.cameras[1].paths[1]
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(BrokenFileError) as caught:
        detect(capture)
    assert str(path) in str(caught.value)
    assert cv2.getNumThreads() == 2
    cv2.setNumThreads(before)


def board_at(frame, **more):
    return FoundBoard(np.arange(6), np.full((6, 2), float(frame)), **more)


@pytest.fixture
def pretended(tmp_path, monkeypatch):
    """A camera of 40 frames whose finders are pretended: ``results[effort][frame]``, and what they were asked."""
    for k in range(40):
        (tmp_path / "cam0").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / "cam0" / f"{k}.png"), np.full((8, 8), k, np.uint8))
    results, asked = {False: {}, True: {}}, []

    def find(grey, _board, *, thorough):
        frame = int(grey[0, 0])
        asked.append((thorough, frame))
        return results[thorough].get(frame)

    monkeypatch.setattr(sweep, "find_board", find)
    return open_capture(tmp_path), results, asked


def test_frames_whose_order_is_turned_against_the_majority_are_named(pretended):
    capture, results, _ = pretended
    results[False] |= {k: board_at(k, turned=k not in (20, 27)) for k in range(40)}
    (camera,) = detect(capture).cameras
    assert [(f.frame, f.action) for f in camera.findings] == [("20", "unflipped"), ("27", "unflipped")]
    assert camera.findings[0].reason == (
        "its corners came turned by 180 degrees; put right by the colours of the squares"
    )
    assert len(camera.views) == 40


def test_boards_that_must_not_be_used_are_findings_and_no_views(pretended):
    capture, results, _ = pretended
    results[False] |= {k: board_at(k) for k in range(35)} | {36: board_at(36, problem="a larger one")}
    (camera,) = detect(capture).cameras
    assert len(camera.views) == 35
    assert [(f.frame, f.action, f.reason) for f in camera.findings] == [("36", "dropped", "a larger one")]


def test_second_chances_end_with_five_frames_that_show_nothing(pretended):
    capture, _, asked = pretended
    assert detect(capture).cameras[0].views == ()
    again = sorted(frame for thorough, frame in asked if thorough)
    assert len(again) == 5
    assert again[0] < 5
    assert again[-1] > 30
    assert np.diff(again).max() <= 10


def test_second_chances_go_on_where_they_find_something_and_are_the_same_from_the_cache(pretended, tmp_path):
    capture, results, asked = pretended
    results[False][5] = board_at(5)
    results[True] |= {k: board_at(k) for k in range(40)}
    cache = DetectionCache(tmp_path / "cache")
    first = detect(capture, cache=cache)
    assert len([1 for thorough, _ in asked if thorough]) == 20
    assert len(first.cameras[0].views) == 21
    asked.clear()
    same(first, detect(capture, cache=cache))
    assert asked == []


def test_cameras_with_enough_views_are_not_searched_again(pretended):
    capture, results, asked = pretended
    results[False] |= {k: board_at(k) for k in range(30)}
    detect(capture)
    assert not [1 for thorough, _ in asked if thorough]


def test_boards_blurred_far_beyond_the_others_are_dropped_with_their_figure(pretended):
    capture, results, _ = pretended
    results[False] |= {k: board_at(k, blur_px=0.9) for k in range(38)}
    results[False] |= {38: board_at(38, blur_px=3.6), 39: board_at(39, blur_px=1.9)}
    (camera,) = detect(capture).cameras
    assert [view.frame_idx for view in camera.views] == [*range(38), 39]
    assert camera.views[0].blur_px == 0.9
    assert [(f.frame, f.action, f.reason) for f in camera.findings] == [
        ("38", "dropped", "blurred: edges 3.6 px wide, 4.0 times the camera's median view")
    ]


# ---- long videos


def long_capture(*frames, fps=30.0):
    """Cameras with videos of so many frames, which are never read."""
    cameras = [
        CaptureCamera(f"cam{k}", "video", (Path(f"cam{k}.mp4"),), tuple(f"{i:06d}" for i in range(n)), SIZE_WH, fps)
        for k, n in enumerate(frames)
    ]
    return Capture(Path(), tuple(cameras))


def numbered(*frames):
    idx = np.arange(max(frames))[:, None] * np.ones((1, len(frames)), int)
    return Instants("frame numbers", np.where(idx < frames, idx, -1), np.arange(max(frames)), np.zeros(idx.shape))


def test_long_videos_are_looked_at_five_times_a_second_at_the_same_instants():
    one, two = first_looks(long_capture(1800, 1750), numbered(1800, 1750))
    assert sorted(one) == [*range(0, 1800, 6), 1799]
    assert sorted(two) == [*range(0, 1750, 6), 1749]
    assert [len(looks) for looks in first_looks(long_capture(100, 90), numbered(100, 90))] == [100, 90]
    assert len(first_looks(long_capture(450), numbered(450))[0]) == 114  # a hundred looks at least


def test_cameras_that_share_no_instant_are_looked_at_alike():
    count = 1800
    frame_idx = np.full((2 * count, 2), -1)
    frame_idx[0::2, 0] = frame_idx[1::2, 1] = np.arange(count)
    apart = Instants("file times", frame_idx, np.arange(2 * count) / 60, np.zeros((2 * count, 2)))
    for looks in first_looks(long_capture(count, count), apart):
        assert 300 <= len(looks) <= 302
        assert np.diff(sorted(looks)).max() <= 7


def test_instants_of_most_cameras_are_looked_at_first():
    frame_idx = numbered(1800, 1800, 1800).frame_idx.copy()
    frame_idx[::2, 2] = -1  # the third camera runs at half the rate
    instants = Instants("timestamps.csv", frame_idx, np.arange(1800) / 30, np.zeros((1800, 3)))
    looks = first_looks(long_capture(1800, 1800, 1800), instants)
    assert len(looks[0] & looks[1] & looks[2]) >= 300


def test_frames_around_the_boards_of_cameras_with_few_views_are_looked_at_in_those_that_saw_it():
    capture, instants = long_capture(1800, 1800, 1800), numbered(1800, 1800, 1800)
    plenty = set(range(0, 600, 6))
    near = set(range(595, 606))
    looks = closer_looks(capture, instants, [{600}, plenty | {600}, plenty], enough=30)
    assert looks == [near, near, near - set(range(600, 606))]
    assert closer_looks(capture, instants, [plenty, plenty, set()], enough=30) == [set(), set(), set()]


def test_the_nth_frame_of_a_long_video_stays_the_nth_frame(tmp_path):
    boards = {view: photo(checkerboard(), view)[0] for view in VIEWS}
    empty = np.full(SIZE_WH[::-1], 110, np.uint8)
    with av.open(str(tmp_path / "cam0.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = *SIZE_WH, "yuv420p"
        stream.options = {"preset": "veryfast", "crf": "12", "bf": "3"}
        for index in range(420):
            image = boards[list(VIEWS)[index // 100]] if index % 100 < 20 and index < 400 else empty
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode())
    (camera,) = detect(open_capture(tmp_path)).cameras
    assert len(camera.frames) == 420
    assert [v.frame_idx for v in camera.views] == [100 * k + i for k in range(4) for i in range(20)]  # few, so all
    for view in camera.views:
        corners = truth(BOARD, photo(checkerboard(), list(VIEWS)[view.frame_idx // 100])[1])
        assert rms(view.corners_px - corners) < 0.1


# ---- real captures


def lens_rms(camera, board):
    objects = [board.corners_in_board[v.corner_ids].astype(np.float32) for v in camera.views]
    corners = [v.corners_px.astype(np.float32) for v in camera.views]
    return cv2.calibrateCamera(objects, corners, camera.size_wh, None, None)


def only(capture, *cameras):
    return Capture(capture.path, tuple(camera for camera in capture.cameras if camera.id in cameras))


def stereo(found, lenses):
    first, second = ({v.frame_idx: v for v in camera.views} for camera in found.cameras)
    objects, left, right = [], [], []
    for a, b in found.instants.frame_idx.tolist():
        ids, at_a, at_b = np.intersect1d(first[a].corner_ids, second[b].corner_ids, return_indices=True)
        objects.append(found.board.corners_in_board[ids].astype(np.float32))
        left.append(first[a].corners_px[at_a].astype(np.float32))
        right.append(second[b].corners_px[at_b].astype(np.float32))
    (_, K1, d1, *_), (_, K2, d2, *_) = lenses
    size_wh, flags = found.cameras[0].size_wh, cv2.CALIB_FIX_INTRINSIC
    solved = cv2.stereoCalibrate(objects, left, right, K1, d1, K2, d2, size_wh, flags=flags)
    return solved[0], float(np.linalg.norm(solved[6]))


@needs_real
@pytest.mark.parametrize(
    ("folder", "views", "most_rms_px", "pair_px", "baseline_m"),
    [
        ("opencv_stereo_chess", 13, (0.16, 0.16), 0.18, 0.0832),
        ("stereopi_pairs/pairs", 30, (0.165, 0.165), 0.17, 0.0575),
    ],
)
def test_real_stereo_pairs_of_a_checkerboard(folder, views, most_rms_px, pair_px, baseline_m):
    found = detect(open_capture(REAL / folder))
    lenses = [lens_rms(camera, BOARD) for camera in found.cameras]
    assert [len(camera.views) for camera in found.cameras] == [views, views]
    assert all(lens[0] < most for lens, most in zip(lenses, most_rms_px, strict=True))
    error_px, length_m = stereo(found, lenses)
    assert error_px < pair_px
    assert length_m == pytest.approx(baseline_m, abs=0.0003)


@needs_real
def test_the_real_view_that_was_thought_bad_is_good_with_better_corners():
    board = parse_board("checkerboard:4x7:60mm")
    capture = only(open_capture(REAL / "pose2sim_singleperson/calibration/intrinsics"), "int_cam04_img")
    (camera,) = detect(capture, board).cameras
    assert [len(view.corner_ids) for view in camera.views] == [28, 28, 28, 26, 28, 28, 28]  # one is cut by the image
    assert lens_rms(camera, board)[0] < 0.1  # 0.92 with corners of the older finder


@needs_real
def test_a_real_inverted_charuco():
    board = parse_board("charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000:inverted")
    capture = open_capture(REAL / "caliscope_charuco_calibration/calibration/extrinsic")
    (camera,) = (detect_boards(only(capture, "cam_1"), board, instants=find_instants(capture))).cameras
    assert len(camera.views) >= 28
    assert lens_rms(camera, board)[0] < 0.05


@needs_real
@pytest.mark.parametrize(
    ("name", "size", "tags"),
    [("data/1520525725372653511", (6, 6), 36), ("tests_data/EuRoC", (6, 6), 35), ("tests_data/iphone", (11, 6), 66)],
)
def test_real_kalibr_grids(name, size, tags):
    board = AprilGrid(*size, 0.088)
    grey = cv2.imread(str(REAL / "aprilgrid_samples" / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
    found = find_board(grey, board)
    assert len(found.corner_ids) == 4 * tags
    assert found.problem == ""
    plane = board.corners_in_board[found.corner_ids, :2]
    fitted, _ = cv2.findHomography(plane, found.corners_px)
    off = np.linalg.norm(cv2.perspectiveTransform(plane[None], fitted)[0] - found.corners_px, axis=1)
    assert np.linalg.det(fitted) > 0
    assert np.median(off) < 3  # what the lens bends
