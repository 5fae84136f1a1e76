"""Printed boards, read back from the PDF: true to scale, found by the detector, whole again when glued together."""

import cv2
import numpy as np
import pypdfium2
import pytest
from typer.testing import CliRunner

from rigcal.board import Checkerboard, parse_board
from rigcal.cli import app
from rigcal.detect import find_board
from rigcal.errors import TargetError
from rigcal.synthetic import draw_board
from rigcal.target import TargetOptions, draw_target, parse_margin, parse_page, plan_target, symmetry_warning
from rigcal.target.layout import OVERLAP_MM
from rigcal.target.pattern import pattern_of

SCALE_TOLERANCE = 0.001
KINDS = [
    ("checkerboard:9x6:25mm", "A4"),
    ("charuco:5x7:35mm:marker=0.75:dict=DICT_4X4_1000", "A4"),
    ("charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000:inverted", "A3"),
    ("charuco:5x6:35mm:marker=0.7:dict=DICT_5X5_100:legacy", "A4"),
    ("charuco:6x4:40mm:marker=0.7:dict=DICT_5X5_100:inverted:legacy", "A4"),
    ("aprilgrid:4x3:50mm:spacing=0.3:family=tag36h11", "A3"),
    ("aprilgrid:3x3:40mm:spacing=0.25:family=tag16h5:border=1", "letter"),
]


def pages_of(plan, dpi):
    document = pypdfium2.PdfDocument(draw_target(plan))
    images = [page.render(scale=dpi / 72, grayscale=True).to_numpy().squeeze() for page in document]
    document.close()
    return images


def words_of(plan):
    document = pypdfium2.PdfDocument(draw_target(plan))
    words = []
    for page in document:
        text = page.get_textpage()
        words.append(" ".join(text.get_text_range().split()))
        text.close()
    document.close()
    return words


def plan_for(spec, page="A4", **options):
    return plan_target(parse_board(spec), TargetOptions(parse_page(page), **options))


def px_per_mm(plan, image):
    """(2,) across and upright: a renderer stretches the page to whole pixels."""
    return np.array(image.shape[::-1]) / plan.frame.page_mm


def in_mm(corners_px, per_mm):
    """Pixel centres lie half a pixel inside the page."""
    return (corners_px + 0.5) / per_mm


def expected_mm(plan, ids, left_top_mm):
    return plan.board.corners_in_board[ids, :2] * 1e3 + plan.pattern.origin_mm + left_top_mm


@pytest.mark.parametrize(("spec", "page"), KINDS)
def test_every_kind_of_board_is_found_where_and_as_large_as_it_should_be(spec, page):
    plan = plan_for(spec, page)
    (image,) = pages_of(plan, 150)
    found = find_board(np.ascontiguousarray(image), plan.board)
    assert found.problem == ""
    assert len(found.corner_ids) == len(plan.board.corners_in_board)
    got, true = (
        in_mm(found.corners_px, px_per_mm(plan, image)),
        expected_mm(plan, found.corner_ids, plan.first_left_top_mm),
    )
    square = plan.pattern.square_mm
    for axis in (0, 1):
        scale = np.polyfit(true[:, axis], got[:, axis], 1)[0]
        assert scale == pytest.approx(1, abs=SCALE_TOLERANCE / 5)
    assert np.abs(np.diff(got, axis=0) - np.diff(true, axis=0)).max() < SCALE_TOLERANCE * square
    assert np.abs(got - true).max() < 0.02  # mm, absolute on the page


@pytest.mark.parametrize(
    "spec", [spec for spec, _ in KINDS] + ["checkerboard:4x7:60mm", "charuco:4x5:54mm", "charuco:7x6:40mm:legacy"]
)
def test_the_rectangles_are_the_pattern_that_the_simulation_draws(spec):
    board = parse_board(spec)
    per_square = 400
    drawn = draw_board(board, pixels_per_square=per_square).image[per_square:-per_square, per_square:-per_square]
    pattern = pattern_of(board)
    painted = np.full(drawn.shape, 255, dtype=np.uint8)
    for left, top, right, bottom in np.rint(pattern.black_mm * per_square / pattern.square_mm).astype(int):
        assert (painted[top:bottom, left:right] == 255).all()  # never painted twice
        painted[top:bottom, left:right] = 0
    off = (painted != drawn).astype(np.uint8)
    assert not cv2.erode(off, np.ones((5, 5))).any()  # the simulation rounds edges to pixels, two or three wide


def test_both_rulers_measure_100_mm():
    plan = plan_for("checkerboard:9x6:25mm")
    (image,) = pages_of(plan, 600)
    per_mm = image.shape[1] / plan.frame.page_mm[0]
    assert image.shape[0] / plan.frame.page_mm[1] == pytest.approx(per_mm, rel=2e-4)
    across, upright = plan.frame.bottom_band, plan.frame.left_band
    assert not plan.frame.words_below  # so the words, and the upright ruler after them, are in the left band
    row = image[round((across.top + 3.3) * per_mm) - 2 :][:4, : round((across.left + 108) * per_mm)]
    column = image[:, round((upright.right - 6 + 3.3) * per_mm) - 2 :][:, :4]
    for dark in (np.flatnonzero(row.min(axis=0) < 128), np.flatnonzero(column.min(axis=1) < 128)):
        ticks = np.array([group.mean() for group in np.split(dark, np.flatnonzero(np.diff(dark) > 20) + 1)])
        assert len(ticks) == 11  # those of every centimetre
        assert (ticks[-1] - ticks[0]) / per_mm == pytest.approx(100, rel=5e-4)


@pytest.mark.parametrize(
    ("spec", "page"),
    [
        ("checkerboard:5x4:60mm", "A4"),
        ("charuco:7x5:60mm:marker=0.75:dict=DICT_4X4_1000", "A4"),
        ("aprilgrid:3x2:120mm:spacing=0.3:family=tag36h11", "letter"),
    ],
)
def test_sheets_glued_as_the_ticks_say_make_the_whole_board(spec, page):
    plan = plan_for(spec, page)
    assert plan.tiled
    overview, *sheets = pages_of(plan, 120)
    assert find_board(np.ascontiguousarray(overview), plan.board) is None  # it must never be taken for the board
    assert len(sheets) == plan.rows * plan.columns
    glued = glue(plan, sheets)
    found = find_board(glued, plan.board)
    assert len(found.corner_ids) == len(plan.board.corners_in_board)
    got = in_mm(found.corners_px, px_per_mm(plan, sheets[0]))
    true = expected_mm(plan, found.corner_ids, plan.first_left_top_mm)
    assert np.abs(np.diff(got, axis=0) - np.diff(true, axis=0)).max() < SCALE_TOLERANCE * plan.pattern.square_mm


def glue(plan, sheets):
    """Cut each sheet at its left and top CUT ticks and lay it over its neighbours, edges at their JOIN ticks."""
    per_mm, window = px_per_mm(plan, sheets[0]), plan.frame.window
    step = np.array([window.width - OVERLAP_MM, window.height - OVERLAP_MM])
    size = np.array([window.right + step[0] * (plan.columns - 1), window.bottom + step[1] * (plan.rows - 1)])
    width, height = np.ceil(size * per_mm).astype(int) + 40
    whole = np.full((height, width), 255, dtype=np.uint8)
    for image, (row, column) in zip(sheets, np.ndindex(plan.rows, plan.columns), strict=True):
        shift = step * [column, row] * per_mm
        moved = cv2.warpAffine(
            np.ascontiguousarray(image),
            np.array([[1, 0, shift[0]], [0, 1, shift[1]]]),
            (int(width), int(height)),
            borderValue=255,
        )
        left, top = np.rint([window.left, window.top] * per_mm + shift).astype(int) + 1
        right, bottom = np.rint([window.right, window.bottom] * per_mm + shift).astype(int) - 1
        whole[top:bottom, left:right] = moved[top:bottom, left:right]
    return whole


def test_neighbouring_sheets_show_the_same_in_the_strip_that_they_share():
    plan = plan_for("charuco:7x5:60mm", "A4")
    _, first, second, *_ = pages_of(plan, 254)  # 10 px per mm
    window = plan.frame.window
    shared = first[:, round((window.right - OVERLAP_MM) * 10) + 2 : round(window.right * 10) - 2]
    same = second[:, round(window.left * 10) + 2 :][:, : shared.shape[1]]
    rows = slice(round(window.top * 10) + 2, round(window.bottom * 10) - 2)
    assert (np.abs(shared[rows].astype(int) - same[rows]) > 60).mean() < 0.01  # edges may round to the next pixel
    assert shared[rows].min() == 0


@pytest.mark.parametrize("landscape", [False, True])
def test_corners_of_the_back_lie_behind_those_of_the_front(landscape):
    plan = plan_for("charuco:5x4:30mm:marker=0.75:dict=DICT_4X4_1000", two_sided=True, landscape=landscape)
    front, back = pages_of(plan, 150)
    seen_through = np.flipud(back) if landscape else np.fliplr(back)  # turned over its long edge
    one, two = (find_board(np.ascontiguousarray(image), plan.board) for image in (front, seen_through))
    assert len(one.corner_ids) == len(plan.board.corners_in_board)
    np.testing.assert_array_equal(one.corner_ids, two.corner_ids)
    assert np.abs(one.corners_px - two.corners_px).max() < 0.05
    assert b"/Duplex /DuplexFlipLongEdge" in draw_target(plan)
    assert all(plan.board.spec in words for words in words_of(plan))


def test_every_sheet_carries_the_board_string_and_how_to_print_it():
    for spec in ("checkerboard:9x6:25mm", "charuco:7x5:60mm:marker=0.75:dict=DICT_4X4_1000:inverted"):
        plan = plan_for(spec)
        for words in words_of(plan)[plan.tiled :]:
            assert f"--board {spec} Print at 100 %" in words
            assert "Both rulers must measure 100 mm" in words
            assert "Origin: the dot in the sketch" in words


def test_sheets_are_numbered_and_the_first_page_says_how_to_glue_them():
    plan = plan_for("checkerboard:8x5:60mm")
    overview, *sheets = words_of(plan)
    assert "8 sheets, 2 x 4 (rows x columns); on A2 it fits as one sheet" in overview
    assert "CUT ticks at the left" in overview
    assert "the whole pattern 540 x 360 mm" in overview
    for words, (row, column) in zip(sheets, np.ndindex(2, 4), strict=True):
        assert f"row {row + 1}, column {column + 1}" in words
        assert ("CUT" in words) == (row > 0 or column > 0)


def test_a_usual_board_fits_its_usual_page_with_white_around_it():
    plan = plan_for("checkerboard:9x6:25mm")
    assert not plan.tiled
    assert plan.quiet_mm > 0.35 * 25
    large = plan_for("checkerboard:9x6:25mm", "A3")
    assert large.quiet_mm > 25


def test_the_same_plan_gives_the_same_bytes_and_asks_not_to_be_scaled():
    plan = plan_for("charuco:5x7:35mm")
    first = draw_target(plan)
    assert first == draw_target(plan)
    assert b"/PrintScaling /None" in first


@pytest.mark.parametrize(
    ("spec", "instead"),
    [
        ("checkerboard:8x6:25mm", "checkerboard:8x5:25mm"),
        ("checkerboard:7x7:25mm", "checkerboard:7x6:25mm"),
        ("checkerboard:5x3:25mm", "checkerboard:5x4:25mm"),
    ],
)
def test_a_symmetric_checkerboard_is_warned_of_in_print(spec, instead):
    board = parse_board(spec)
    assert instead in symmetry_warning(board)
    assert not parse_board(instead).is_symmetric
    assert f"Prefer one odd and one even count: {instead}" in words_of(plan_for(spec))[0]
    assert symmetry_warning(parse_board("checkerboard:9x6:25mm")) is None
    assert symmetry_warning(parse_board("charuco:6x6:25mm")) is None


@pytest.mark.parametrize(
    ("spec", "page", "options", "message"),
    [
        (
            "checkerboard:9x6:25mm",
            "A4",
            {"two_sided": True},
            "cannot print this board: only ChArUco boards can have two sides\n"
            "  where:    checkerboard:9x6:25mm\n"
            "  expected: a charuco board with --two-sided\n"
            "  got:      kind checkerboard\n"
            "  do next:  leave --two-sided out, or choose a charuco board",
        ),
        (
            "charuco:4x5:54mm",
            "A4",
            {"two_sided": True},
            "cannot print this board: a board with two sides must fit on one sheet\n"
            "  where:    charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000\n"
            "  expected: one sheet\n"
            "  got:      2 sheets of page A4\n"
            "  do next:  give --page A3, on which it fits as one sheet",
        ),
        (
            "checkerboard:9x6:25mm",
            "100x100mm",
            {},
            "cannot print this board: page 100x100mm is too small\n"
            "  where:    checkerboard:9x6:25mm\n"
            "  expected: room for two rulers of 100 mm and words inside margins of 10 mm\n"
            "  got:      page 100x100mm\n"
            "  do next:  give --page A4, on which it fits as one sheet",
        ),
        (
            "checkerboard:9x6:1m",
            "A4",
            {},
            "cannot print this board: it takes too many sheets\n"
            "  where:    checkerboard:9x6:1m\n"
            "  expected: at most 50 sheets\n"
            "  got:      2048 sheets of page A4\n"
            "  do next:  give a larger --page, such as A0 or 2000x1500mm for a print shop, or choose smaller squares",
        ),
        (
            "checkerboard:9x6:0.025mm",
            "A4",
            {},
            "cannot print this board: its cells are too fine to print\n"
            "  where:    checkerboard:9x6:0.025mm\n"
            "  expected: cells of 0.5 mm or more\n"
            "  got:      cells of 0.025 mm\n"
            "  do next:  choose a size of 0.5 mm or more, and check its unit",
        ),
    ],
)
def test_a_board_that_cannot_be_printed_true_to_scale_is_refused(spec, page, options, message):
    with pytest.raises(TargetError) as refused:
        plan_for(spec, page, **options)
    assert str(refused.value) == message


def test_pages_and_margins_that_mean_nothing_are_refused():
    with pytest.raises(TargetError, match="unknown page"):
        parse_page("B7")
    with pytest.raises(TargetError, match="unknown page"):
        parse_page("600x400")
    with pytest.raises(TargetError, match="unknown page"):
        parse_page("6x4m")
    with pytest.raises(TargetError, match="the margin: the size '10' has no unit"):
        parse_margin("10")
    with pytest.raises(TargetError, match="the printer's margin leaves no paper"):
        TargetOptions(parse_page("A4"), margin_mm=110)
    assert parse_page("60x40cm") == (600, 400)
    assert parse_page("a3") == (297, 420)
    assert parse_margin("5mm") == 5


def test_the_command_writes_the_file_and_warns_on_standard_error(tmp_path):
    output = tmp_path / "folder" / "board.pdf"
    done = CliRunner().invoke(app, ["target", "checkerboard:8x6:25mm", "-o", str(output), "--page", "A3"])
    assert done.exit_code == 0
    assert output.read_bytes().startswith(b"%PDF")
    assert "one sheet of A3" in done.stdout
    assert done.stderr.startswith("warning: 8x6 inner corners look the same turned by 180 degrees")


def test_a_board_of_any_size_is_never_scaled():
    for size_mm in (10.0, 25.4, 33.333, 61.0):
        board = Checkerboard(6, 5, size_mm / 1e3)
        plan = plan_target(board, TargetOptions())
        assert plan.pattern.size_mm == pytest.approx((7 * size_mm, 6 * size_mm), rel=1e-12)
