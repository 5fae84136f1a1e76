"""Which board is really there: other sizes, inverted and other markers, a camera that sees none; word for word."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rigcal.board import AprilGrid, Charuco, Checkerboard, parse_board
from rigcal.captures import Capture, open_capture
from rigcal.detect import detect_boards
from rigcal.detections import BoardDetections, BoardView, Finding, SiteDetections
from rigcal.diagnose import check_boards
from rigcal.errors import (
    ImageSizeError,
    MirroredImagesError,
    NoBoardError,
    UnclearBoardError,
    WrongBoardError,
    WrongSpacingError,
)
from rigcal.instants import find_instants
from rigcal.synthetic import draw_board

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "calibration"
needs_real = pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")
PLACES = (
    [[60, 50], [420, 60], [410, 310], [70, 300]],
    [[90, 40], [400, 90], [380, 280], [80, 320]],
    [[100, 80], [350, 40], [380, 310], [60, 260]],
)
CHARUCO = Charuco(7, 5, 0.05, dictionary="DICT_4X4_50", inverted=True)


def checkerboard(columns=9, rows=6):
    cells = (np.indices((rows + 1, columns + 1)).sum(axis=0) % 2).astype(np.uint8) * 200 + 30
    return np.pad(np.kron(cells, np.ones((24, 24), np.uint8)), 24, constant_values=230)


def charuco():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawn = cv2.aruco.CharucoBoard((7, 5), 1.0, 0.75, dictionary).generateImage((7 * 24, 5 * 24))
    return 255 - np.pad(drawn, 24, constant_values=255)


def photo(drawing, place):
    height, width = drawing.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) - 0.5
    homography = cv2.getPerspectiveTransform(corners, np.array(place, np.float32))
    s = np.array([[3, 0, 1.0], [0, 3, 1.0], [0, 0, 1]])
    big = cv2.warpPerspective(drawing, s @ homography, (480 * 3, 360 * 3), borderValue=110)
    return cv2.resize(big, (480, 360), interpolation=cv2.INTER_AREA)


def capture(folder, **cameras):
    """Three images per camera: of a drawing, or of nothing where it is None."""
    for camera, drawing in cameras.items():
        (folder / camera).mkdir()
        for k, place in enumerate(PLACES):
            image = np.full((360, 480), 110, np.uint8) if drawing is None else photo(drawing, place)
            cv2.imwrite(str(folder / camera / f"{k}.png"), image)
    return open_capture(folder)


def detect(opened, board):
    return detect_boards(opened, board, instants=find_instants(opened))


def refusal(opened, board, error=WrongBoardError):
    with pytest.raises(error) as caught:
        check_boards(opened, detect(opened, board))
    return str(caught.value)


def test_the_right_board_passes(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard(), cam1=checkerboard())
    check_boards(opened, detect(opened, Checkerboard(9, 6, 0.025)))
    check_boards(opened, detect(opened, Checkerboard(6, 9, 0.025)))


def test_squares_counted_instead_of_inner_corners(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard(), cam1=checkerboard())
    assert refusal(opened, Checkerboard(10, 7, 0.025)) == (
        "the board is not checkerboard:10x7:25mm\n"
        "  where:    camera cam0, cam1\n"
        "  expected: checkerboard:10x7:25mm in most images\n"
        "  got:      checkerboard:10x7:25mm in 0 of 6 images; checkerboard:9x6:25mm in 6 of 6 images\n"
        "  do next:  run again with --board checkerboard:9x6:25mm"
    )


@pytest.mark.parametrize(("given", "found"), [((8, 6), "9x6"), ((5, 8), "6x9"), ((14, 9), "9x6")])
def test_other_sizes_than_the_board_has_are_refused_and_the_true_one_named(tmp_path, given, found):
    opened = capture(tmp_path, cam0=checkerboard())
    assert f"; checkerboard:{found}:25mm in 3 of 3 images" in refusal(opened, Checkerboard(*given, 0.025))


@pytest.mark.parametrize(
    "given",
    [
        replace(CHARUCO, inverted=False),
        replace(CHARUCO, columns=5, rows=7),
        replace(CHARUCO, dictionary="DICT_5X5_100"),
        replace(CHARUCO, columns=6, rows=4),
    ],
)
def test_other_markers_than_the_board_has_are_refused_and_the_true_ones_named(tmp_path, given):
    opened = capture(tmp_path, cam0=charuco())
    message = refusal(opened, given)
    assert ":inverted in 3 of 3 images" in message
    named = parse_board(message.rpartition("--board ")[2])
    assert replace(named, dictionary=CHARUCO.dictionary) == CHARUCO


def test_a_camera_without_a_board_is_named(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard(), cam1=None)
    assert refusal(opened, Checkerboard(9, 6, 0.025), NoBoardError) == (
        "no board found in camera cam1\n"
        "  where:    camera cam1, 3 images\n"
        "  expected: checkerboard:9x6:25mm in at least one image\n"
        "  got:      0 boards; the likeliest images have grey values 110 to 110 of 255 and no edge; not found in them "
        "either: checkerboard:8x5:25mm, checkerboard:8x7:25mm, checkerboard:8x6:25mm, checkerboard:10x5:25mm and 4 "
        "others\n"
        "  do next:  check that the whole board with its white margin is in view, sharp and lit, nearer than 40 "
        "squares' width, and that --board counts inner corners (checkerboard) or squares (charuco)"
    )


def test_another_board_in_one_camera_only_is_told_of_that_camera(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard(), cam1=checkerboard(7, 5))
    message = refusal(opened, Checkerboard(9, 6, 0.025))
    assert "where:    camera cam1\n" in message
    assert "checkerboard:7x5:25mm in 3 of 3 images" in message


def test_more_refused_boards_than_views_are_never_accepted(tmp_path):
    opened = capture(tmp_path, cam0=None)
    detections = detect(opened, Checkerboard(9, 6, 0.025))
    larger = "a checkerboard larger than 9x6 inner corners"
    camera = replace(
        detections.cameras[0],
        views=(BoardView(0, np.arange(6), np.zeros((6, 2))),),
        findings=tuple(Finding(frame, "dropped", larger) for frame in "12"),
    )
    with pytest.raises(WrongBoardError) as caught:
        check_boards(opened, replace(detections, cameras=(camera,)))
    assert str(caught.value) == (
        "the board is not checkerboard:9x6:25mm\n"
        "  where:    camera cam0\n"
        "  expected: checkerboard:9x6:25mm in most images\n"
        "  got:      checkerboard:9x6:25mm in 1 of 3 images; a checkerboard larger than 9x6 inner corners in 2 of 3 "
        "images\n"
        "  do next:  count the board's inner corners (checkerboard), squares (charuco) or tags (aprilgrid) and run "
        "again with --board"
    )


# ---- boards of another kind, and what is printed on them


def unfound(opened, board):
    """What a finder says that found nothing."""
    cameras = tuple(BoardDetections(c.id, c.size_wh, c.frames, ()) for c in opened.cameras)
    return SiteDetections(board, cameras, find_instants(opened))


def told(opened, board, error=WrongBoardError):
    """The message for a board that was found nowhere."""
    with pytest.raises(error) as caught:
        check_boards(opened, unfound(opened, board))
    return str(caught.value)


def printed(board):
    """The board's drawing, in grey values of paper and ink."""
    return (draw_board(board, pixels_per_square=40).image * 0.8 + 30).astype(np.uint8)


def test_a_charuco_where_a_checkerboard_was_given(tmp_path):
    opened = capture(tmp_path, cam0=charuco())
    assert told(opened, Checkerboard(6, 4, 0.025)) == (
        "the board is not checkerboard:6x4:25mm\n"
        "  where:    camera cam0\n"
        "  expected: checkerboard:6x4:25mm in most images\n"
        "  got:      checkerboard:6x4:25mm in 0 of 3 images; "
        "charuco:7x5:25mm:marker=0.75:dict=DICT_4X4_50:inverted in 3 of 3 images\n"
        "  do next:  run again with --board charuco:7x5:25mm:marker=0.75:dict=DICT_4X4_50:inverted, and in it the size "
        "measured on that board"
    )


def test_a_checkerboard_where_a_charuco_was_given(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard())
    assert "; checkerboard:9x6:50mm in 3 of 3 images" in told(opened, CHARUCO)


TAGS = AprilGrid(5, 4, 0.05)


@pytest.mark.parametrize(
    ("given", "true"),
    [
        (replace(TAGS, family="tag25h9"), TAGS),
        (replace(TAGS, border_bits=1), TAGS),
        (replace(TAGS, columns=4, rows=5), TAGS),
        (replace(TAGS, columns=6), TAGS),
        (TAGS, replace(TAGS, border_bits=1)),
        (Charuco(5, 4, 0.05), TAGS),
        (Charuco(6, 6, 0.05, dictionary="DICT_4X4_50"), Charuco(6, 6, 0.05, dictionary="DICT_4X4_50", legacy=True)),
        (
            Charuco(6, 6, 0.05, 0.5, dictionary="DICT_5X5_50"),
            Charuco(5, 7, 0.05, 0.6, dictionary="DICT_6X6_50", inverted=True),
        ),
    ],
    ids=lambda board: board.spec,
)
def test_marker_boards_are_read_off_the_images(tmp_path, given, true):
    opened = capture(tmp_path, cam0=printed(true))
    message = told(opened, given)
    assert f"; {true.spec} in 3 of 3 images" in message


@pytest.mark.parametrize("other", [{"rows": 6}, {"rows": 4}, {"marker_ratio": 0.85}, {"legacy": True}])
def test_what_leaves_every_corner_in_its_place_is_no_error(tmp_path, other):
    opened = capture(tmp_path, cam0=charuco())
    given = replace(CHARUCO, **other)  # of five rows, each numbered alike; odd rows are legacy and new at once
    detections = detect(opened, given)
    check_boards(opened, detections)
    assert len(detections.cameras[0].views) == 3


def test_tags_that_are_set_wider_than_given_are_told_from_the_corners_alone(tmp_path):
    opened = capture(tmp_path, cam0=printed(replace(TAGS, spacing=0.25)))
    assert refusal(opened, TAGS, WrongSpacingError) == (
        "the tags of the board are not spaced as given\n"
        "  where:    3 views of the board\n"
        "  expected: spacing=0.3, the gap between two tags over the side of a tag\n"
        "  got:      spacing=0.250\n"
        "  do next:  measure gap and tag on the board, and run again with spacing=0.25 in --board"
    )
    check_boards(opened, detect(opened, replace(TAGS, spacing=0.25)))


# ---- mirrored images


def test_images_that_a_recorder_mirrored_are_told_in_two_cameras_and_harm_no_lens_by_itself(tmp_path):
    opened = capture(tmp_path, cam0=charuco(), cam1=charuco())
    for path in tmp_path.rglob("*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)[:, ::-1])
    assert refusal(opened, CHARUCO, MirroredImagesError) == (
        "the images are mirrored\n"
        "  where:    camera cam0, cam1\n"
        "  expected: the board as it was printed, in some view of some camera\n"
        "  got:      its mirror image in 6 of 6 views\n"
        "  do next:  switch off mirroring (flip, selfie view) in the cameras or the recorder and capture again; a "
        "board whose back is seen must show its front to a camera too"
    )
    alone = replace(opened, cameras=opened.cameras[:1])
    check_boards(alone, detect(alone, CHARUCO))


# ---- boards that are there, and not found


def changed(opened, change):
    """The same capture with every image changed."""
    for camera in opened.cameras:
        for path in camera.paths:
            cv2.imwrite(str(path), change(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)))
    return opened


def far_away(image, times=6.0):
    small = cv2.resize(image, None, fx=1 / times, fy=1 / times, interpolation=cv2.INTER_AREA)
    room = np.full((360, 480), 110, np.uint8)
    room[140 : 140 + small.shape[0], 200 : 200 + small.shape[1]] = small
    return room


def test_a_board_too_far_away(tmp_path):
    opened = changed(capture(tmp_path, cam0=checkerboard()), lambda image: far_away(image, 8.0))
    assert told(opened, Checkerboard(9, 6, 0.025), UnclearBoardError) == (
        "the board is too small in the images\n"
        "  where:    camera cam0\n"
        "  expected: squares of at least 6 px\n"
        "  got:      squares of 3.1 px, in 3 of 3 images that were looked at\n"
        "  do next:  bring the board nearer, to 52 % of its distance or less, or print a larger one"
    )


def test_markers_too_far_away_are_told_by_the_squares_around_them(tmp_path):
    opened = changed(capture(tmp_path, cam0=charuco()), lambda image: far_away(image, 2.5))
    assert told(opened, CHARUCO, UnclearBoardError) == (
        "the board is too small in the images\n"
        "  where:    camera cam0\n"
        "  expected: squares of at least 22 px\n"
        "  got:      squares of 13.1 px, in 3 of 3 images that were looked at\n"
        "  do next:  bring the board nearer, to 59 % of its distance or less, or print a larger one"
    )


def test_a_board_too_blurred(tmp_path):
    opened = changed(capture(tmp_path, cam0=checkerboard()), lambda image: cv2.GaussianBlur(image, (0, 0), 9.0))
    assert told(opened, Checkerboard(9, 6, 0.025), UnclearBoardError) == (
        "the board is too blurred in the images\n"
        "  where:    camera cam0\n"
        "  expected: edges blurred over at most 5.5 px\n"
        "  got:      edges blurred over 6.7 px, on squares of 25 px, in 3 of 3 images that were looked at\n"
        "  do next:  hold the board still for every view, shorten the exposure, and focus the lens at the board's "
        "distance"
    )


def test_markers_too_blurred(tmp_path):
    opened = changed(capture(tmp_path, cam0=charuco()), lambda image: cv2.GaussianBlur(image, (0, 0), 5.0))
    assert told(opened, CHARUCO, UnclearBoardError) == (
        "the board is too blurred in the images\n"
        "  where:    camera cam0\n"
        "  expected: edges blurred over at most 1.6 px\n"
        "  got:      edges blurred over 4.8 px, on squares of 33 px, in 3 of 3 images that were looked at\n"
        "  do next:  hold the board still for every view, shorten the exposure, and focus the lens at the board's "
        "distance"
    )


def test_a_board_too_dark(tmp_path):
    opened = changed(capture(tmp_path, cam0=checkerboard()), lambda image: (image * 0.02 + 4).astype(np.uint8))
    assert told(opened, Checkerboard(9, 6, 0.025), UnclearBoardError) == (
        "the board is too dark or too faint in the images\n"
        "  where:    camera cam0\n"
        "  expected: at least 5 grey levels from black to white\n"
        "  got:      4 grey levels from black to white, in 3 of 3 images that were looked at\n"
        "  do next:  add light, or lengthen the exposure and hold the board still"
    )


def test_a_board_of_which_hands_hide_a_part(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard())
    for k, (rows, columns) in enumerate([((0, 120), (0, 120)), ((0, 192), (200, 264)), ((90, 192), (0, 264))]):
        drawing = checkerboard()
        drawing[slice(*rows), slice(*columns)] = 110
        cv2.imwrite(str(tmp_path / "cam0" / f"{k}.png"), photo(drawing, PLACES[0]))
    assert told(opened, Checkerboard(9, 6, 0.025), UnclearBoardError) == (
        "only a part of the board is seen\n"
        "  where:    camera cam0\n"
        "  expected: all of its 54 corners\n"
        "  got:      a part with 44 corners, in 2 of 3 images that were looked at\n"
        "  do next:  keep the whole board and a white margin of half a square in view, with no hand or stand on "
        "its squares"
    )


def test_the_camera_that_sees_too_little_is_named_where_the_others_see_the_board(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard(), cam1=checkerboard(), cam2=checkerboard())
    changed(replace(opened, cameras=opened.cameras[1:2]), lambda image: far_away(image, 8.0))
    assert "where:    camera cam1\n" in refusal(opened, Checkerboard(9, 6, 0.025), UnclearBoardError)


def test_images_of_two_sizes_in_one_folder_are_refused(tmp_path):
    opened = capture(tmp_path, cam0=checkerboard())
    cv2.imwrite(str(tmp_path / "cam0" / "2.png"), np.zeros((480, 360), np.uint8))
    with pytest.raises(ImageSizeError) as caught:
        detect(opened, Checkerboard(9, 6, 0.025))
    assert "camera cam0 has images of another size" in str(caught.value)
    assert "expected: 480x360 px, as in 0.png" in str(caught.value)
    assert "got:      360x480 px" in str(caught.value)


@needs_real
@pytest.mark.parametrize("given", ["8x5", "9x7"])
def test_wrong_sizes_of_a_real_checkerboard(given):
    whole = open_capture(REAL / "opencv_stereo_chess")
    left = whole.cameras[0]
    opened = Capture(whole.path, (replace(left, paths=left.paths[:2], frames=left.frames[:2]),))
    message = refusal(opened, parse_board(f"checkerboard:{given}:25mm"))
    assert f"checkerboard:{given}:25mm in 0 of 2 images; checkerboard:9x6:25mm in 2 of 2 images" in message


@needs_real
def test_a_real_inverted_charuco_given_as_a_usual_one():
    whole = open_capture(REAL / "caliscope_charuco_calibration/calibration/extrinsic")
    opened = Capture(whole.path, whole.cameras[:1])
    instants = find_instants(whole)
    given = parse_board("charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000")
    with pytest.raises(WrongBoardError) as caught:
        check_boards(opened, detect_boards(opened, given, instants=instants))
    assert (
        f"{given.spec} in 0 of the 10 likeliest images; {given.spec}:inverted in 10 of the 10 likeliest images"
        in str(caught.value)
    )
