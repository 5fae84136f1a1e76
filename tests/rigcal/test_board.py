"""Board specifications: what is read, what is refused with which words, and where the corners lie."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigcal.board import AprilGrid, Charuco, Checkerboard, board_from_dict, board_to_dict, parse_board
from rigcal.errors import BoardSpecError
from rigcal.synthetic import opencv_charuco


def test_specifications_of_the_interface_are_read():
    assert parse_board("checkerboard:9x6:25mm") == Checkerboard(9, 6, 0.025)
    assert parse_board("charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000:inverted") == Charuco(
        4, 5, 0.054, 0.75, "DICT_4X4_1000", inverted=True
    )
    assert parse_board("aprilgrid:6x6:88mm:spacing=0.3:family=tag36h11") == AprilGrid(6, 6, 0.088, 0.3, "tag36h11")


@pytest.mark.parametrize(("text", "metres"), [("25mm", 0.025), ("2.5cm", 0.025), ("0.025m", 0.025), (".06m", 0.06)])
def test_lengths_carry_their_unit(text, metres):
    assert parse_board(f"checkerboard:9x6:{text}").square_size_m == metres


@pytest.mark.parametrize(
    ("spec", "problem"),
    [
        ("checkerboard:9x6:25", "the size '25' has no unit"),
        ("checkerboard:9x6:25in", "unknown unit 'in'"),
        ("checkerboard:9x6:0mm", "not positive"),
        ("checkerboard:9x6:mm", "not a length"),
        ("checkerboard:9x6", "too short"),
        ("checkerboard:9:25mm", "not COLUMNSxROWS"),
        ("checkerboard:2x6:25mm", "too few inner corners"),
        ("chessboard:9x6:25mm", "unknown kind 'chessboard'"),
        ("checkerboard:9x6:25mm:inverted", "unknown option 'inverted'"),
        ("charuco:4x5:54mm:marker=1.5", "marker=1.5"),
        ("charuco:4x5:54mm:marker=x", "marker=x"),
        ("charuco:4x5:54mm:dict=DICT_9X9", "unknown dictionary"),
        ("charuco:4x5:54mm:inverted=yes", "inverted=yes"),
        ("charuco:2x5:54mm", "too few squares"),
        ("charuco:14x9:54mm:dict=DICT_4X4_50", "it needs 63 markers, DICT_4X4_50 has 50"),
        ("aprilgrid:6x6:88mm:family=tag99", "unknown family"),
        ("aprilgrid:6x6:88mm:family=tag16h5", "it needs 36 markers, DICT_APRILTAG_16H5 has 30"),
        ("aprilgrid:6x6:88mm:border=3", "border=3"),
    ],
)
def test_a_wrong_specification_says_what_is_wrong_and_how_to_write_it(spec, problem):
    with pytest.raises(BoardSpecError) as caught:
        parse_board(spec)
    assert problem in str(caught.value)
    assert "do next:  write it like checkerboard:9x6:25mm" in str(caught.value)


def test_a_bare_number_is_refused_word_for_word():
    with pytest.raises(BoardSpecError) as caught:
        parse_board("checkerboard:9x6:25")
    assert str(caught.value) == (
        "cannot read the board 'checkerboard:9x6:25': the size '25' has no unit\n"
        "  expected: a length with its unit: 25mm, 2.5cm or 0.025m\n"
        "  got:      'checkerboard:9x6:25'\n"
        "  do next:  write it like checkerboard:9x6:25mm, charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000 "
        "or aprilgrid:6x6:88mm:spacing=0.3:family=tag36h11"
    )


boards = st.one_of(
    st.builds(Checkerboard, st.integers(3, 20), st.integers(3, 20), st.sampled_from([0.025, 0.06, 0.1085, 1.5])),
    st.builds(
        Charuco,
        st.integers(3, 12),
        st.integers(3, 12),
        st.sampled_from([0.054, 0.1]),
        st.sampled_from([0.5, 0.75]),
        st.sampled_from(["DICT_4X4_1000", "DICT_5X5_100"]),
        st.booleans(),
        st.booleans(),
    ),
    st.builds(
        AprilGrid,
        st.integers(2, 8),
        st.integers(2, 8),
        st.just(0.088),
        st.just(0.3),
        st.just("tag36h11"),
        st.sampled_from([1, 2]),
    ),
)


@given(boards)
def test_boards_round_trip_through_their_specification_and_the_rig_file(board):
    assert parse_board(board.spec) == board
    assert board_from_dict(board_to_dict(board)) == board


def test_charuco_corners_lie_as_opencv_has_them_up_to_the_origin():
    board = Charuco(5, 4, 0.05)
    theirs = np.asarray(opencv_charuco(board).getChessboardCorners())
    assert np.allclose(board.corners_in_board - board.corners_in_board[0], theirs - theirs[0], atol=1e-7)


def test_checkerboard_corners_run_along_the_columns_first():
    corners = Checkerboard(4, 3, 0.1).corners_in_board
    assert np.allclose(corners[[0, 1, 4]], [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    assert len(corners) == 12


@pytest.mark.parametrize(("columns", "rows", "symmetric"), [(9, 6, False), (8, 6, True), (7, 7, True)])
def test_boards_that_look_alike_when_turned_are_known(columns, rows, symmetric):
    assert Checkerboard(columns, rows, 0.1).is_symmetric is symmetric
