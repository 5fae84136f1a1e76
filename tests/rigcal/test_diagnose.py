"""Which board is really there: other sizes, inverted and other markers, a camera that sees none; word for word."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rigcal.board import Charuco, Checkerboard, parse_board
from rigcal.captures import Capture, open_capture
from rigcal.detect import detect_boards
from rigcal.detections import BoardView, Finding
from rigcal.diagnose import check_boards
from rigcal.errors import NoBoardError, WrongBoardError
from rigcal.instants import find_instants

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
        "  got:      0 boards; not found either in a sample of them: checkerboard:8x5:25mm, checkerboard:10x7:25mm\n"
        "  do next:  check that the whole board with its white margin is in view, sharp and lit, nearer than 40 "
        "squares' width, and that --board counts inner corners (checkerboard) or squares (charuco)"
    )


def test_many_boards_tried_in_vain_are_counted_not_listed(tmp_path):
    opened = capture(tmp_path, cam0=None)
    message = refusal(opened, CHARUCO, NoBoardError)
    got = next(line for line in message.splitlines() if line.startswith("  got:"))
    assert got.endswith(" others")
    assert got.count("charuco:") == 4


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
    assert f"{given.spec} in 0 of 12 sampled images; {given.spec}:inverted in 5 of 12 sampled images" in str(
        caught.value
    )
