"""What goes into the bundled networks and comes out of them: places survive both ways, to a fraction of a pixel."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from recognition.detectors.bundled.decode import decode_hats, decode_joints, decode_site, site_shapes, suppressed
from recognition.detectors.bundled.geometry import PAD, WORKER_WH, crop_placing, crop_xyxy
from recognition.detectors.bundled.images import halves, site_input, worker_input

CELLS = 64 * 36 + 32 * 18 + 16 * 9
FINE = 5 * 64 + 10
"""The cell of stride 8 whose centre is (84, 44)."""
COARSE = 64 * 36 + 3 * 32 + 7
"""The cell of stride 16 whose centre is (120, 56)."""


def shift_px(size_wh, along, seen, shown_by):
    """How far the input shows things from where its placing says, in image pixels; ramps up and down share roundings.

    ``seen`` is the part of the image, first and last pixel, that the ramps cover. ``shown_by`` gives, of an image, grey
    values of the input and the image pixels (..., 2) that they show.
    """
    step, middle = 200.0 / (seen[1] - seen[0]), sum(seen) / 2
    bias = []
    for sign in (1, -1):
        line = np.rint(np.clip(120 + sign * step * (np.arange(size_wh[along]) - middle), 0, 255)).astype(np.uint8)
        grey = np.broadcast_to(line if along == 0 else line[:, None], size_wh[::-1])
        shown, px = shown_by(np.repeat(grey[..., None], 3, axis=-1))
        error = shown - (120 + sign * step * (px[..., along] - middle))
        assert np.abs(error).max() < 2
        bias.append(error.mean())
    return (bias[0] - bias[1]) / (2 * step)


@pytest.mark.parametrize("size_wh", [(1920, 1080), (1088, 1920), (512, 288), (333, 177), (300, 1000)])
@pytest.mark.parametrize("along", [0, 1])
def test_what_a_pixel_of_the_site_input_shows_lies_where_the_fit_says(size_wh, along):
    def shown_by(image):
        fit = site_input(image)
        low = np.ceil(fit.offset_xy).astype(int) + 4
        high = np.floor(fit.offset_xy + fit.scale_xy * size_wh).astype(int) - 4
        columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        return fit.tensor[0, rows, columns, 1], fit.image_px(np.stack([columns, rows], axis=-1) + 0.5)

    assert abs(shift_px(size_wh, along, (0, size_wh[along]), shown_by)) < 0.15


def test_beside_an_image_of_another_aspect_the_site_input_is_grey():
    fit = site_input(np.full((1920, 1080, 3), 7, np.uint8))
    assert (fit.tensor[0, :, :170] == PAD).all()
    assert (fit.tensor[0, :, 175:335] == 7).all()
    assert (fit.tensor[0, :, 342:] == PAD).all()


@pytest.mark.parametrize("image", [np.zeros((9, 9), np.uint8), np.zeros((9, 9, 3), np.float32)])
@pytest.mark.parametrize("look", [site_input, halves])
def test_what_is_no_colour_image_is_refused(look, image):
    with pytest.raises(ValueError, match=r"expected \(H, W, 3\) uint8"):
        look(image)


def noise(width, height):
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_a_pixel_of_a_half_is_the_mean_of_four():
    image = noise(2560, 1440)
    levels = halves(image)
    assert [level.shape[:2] for level in levels] == [(1440, 2560), (720, 1280), (360, 640)]
    assert levels[0] is image
    for level, half in pairwise(levels):
        four = level.astype(int).reshape(half.shape[0], 2, half.shape[1], 2, 3)
        assert np.array_equal(half, (four.sum(axis=(1, 3)) + 2) // 4)


@pytest.mark.parametrize(("size_wh", "count"), [((640, 360), 1), ((2050, 1154), 2), ((1919, 1080), 1)])
def test_an_image_is_halved_while_it_is_twice_the_input_and_even(size_wh, count):
    assert len(halves(noise(*size_wh))) == count


@pytest.mark.parametrize("size_wh", [(1920, 1080), (2560, 1440), (1088, 1920), (2050, 1154), (1919, 1080), (333, 177)])
def test_halves_that_somebody_has_change_no_input(size_wh):
    image, *smaller = halves(noise(*size_wh))
    alone, together = site_input(image), site_input(image, *smaller)
    assert np.array_equal(together.tensor, alone.tensor)
    assert np.array_equal(together.scale_xy, alone.scale_xy)
    for height in np.array([0.05, 0.2, 0.45, 0.9, 2.5]) * size_wh[1]:
        for left, top in [(0.31, 0.27), (-0.1, 0.5), (0.8, -0.2), (0.9, 0.8)]:
            corner = np.array([left, top]) * size_wh
            placing = crop_placing(crop_xyxy([[*corner, *corner + (0.4 * height, height)]])[0])
            assert np.array_equal(worker_input(image, placing, *smaller), worker_input(image, placing))


@pytest.mark.parametrize("height_px", [40.3, 150.4, 210.7, 700.1])
@pytest.mark.parametrize("along", [0, 1])
def test_what_a_pixel_of_a_crop_shows_lies_where_its_placing_says(height_px, along):
    crop = crop_xyxy([[803.3, 180.9, 803.3 + 0.4 * height_px, 180.9 + height_px]])[0]
    placing = crop_placing(crop)

    def shown_by(image):
        columns, rows = np.meshgrid(np.arange(WORKER_WH[0]), np.arange(WORKER_WH[1]))
        return worker_input(image, placing)[..., 0], placing.to_image(np.stack([columns, rows], axis=-1) + 0.5) - 0.5

    assert abs(shift_px((1920, 1080), along, crop[[along, along + 2]], shown_by)) < 0.06 / placing.scale


def test_a_crop_that_leaves_the_image_is_grey_there():
    image = np.full((481, 641, 3), 7, np.uint8)
    placing = crop_placing(crop_xyxy([[580.0, 100.0, 700.0, 420.0]])[0])
    crop = worker_input(image, placing)
    edge = placing.to_input((641.0, 200.0))[0]
    assert (crop[:, : int(edge) - 3] == 7).all()
    assert (crop[:, int(edge) + 3 :] == PAD).all()


def test_a_crop_beside_the_image_is_grey():
    placing = crop_placing(crop_xyxy([[900.0, 100.0, 950.0, 220.0]])[0])
    assert (worker_input(np.zeros((480, 640, 3), np.uint8), placing) == PAD).all()


def test_a_crop_holds_the_box_with_room_above():
    (crop,) = crop_xyxy([[100.0, 200.0, 140.0, 300.0]])
    assert crop == pytest.approx([120 - 46.875, 250 - 6.25 - 62.5, 120 + 46.875, 250 - 6.25 + 62.5])
    (wide,) = crop_xyxy([[100.0, 200.0, 250.0, 300.0]])
    assert wide[2] - wide[0] == pytest.approx(1.25 * 150)


def site_outputs(classes=3):
    scores, places = (np.zeros(shape[1:], np.float32) for shape in site_shapes(classes))
    assert len(scores) == CELLS
    places[FINE, :4] = np.log([2, 1, 3, 4])  # 16 px left, 8 up, 24 right, 32 down
    places[FINE, 4:6], places[FINE, 38] = (0.5, -1), 2.0  # nose at (88, 36)
    places[FINE, 55:57] = (1.25, 0)
    places[COARSE, :4] = np.log([1, 1, 2, 2])
    return scores, places


def test_boxes_joints_and_keypoints_are_read_from_their_cells():
    scores, places = site_outputs()
    scores[FINE, 0], scores[COARSE, 2] = 0.7, 0.9
    found = decode_site(scores, places)
    assert found.classes.tolist() == [2, 0]
    assert found.scores == pytest.approx([0.9, 0.7])
    assert found.boxes == pytest.approx(np.array([[104, 40, 152, 88], [68, 36, 108, 76]]))
    assert found.joints[1, 0] == pytest.approx([88, 36, 1 / (1 + np.exp(-2.0))])
    assert found.joints[1, 1] == pytest.approx([84, 44, 0.5])
    assert found.keypoints[1, 0] == pytest.approx([94, 44])


def test_each_class_has_its_threshold():
    scores, places = site_outputs()
    scores[FINE], scores[COARSE] = [0.5, 0.5, 0.5], [0.2, 0.7, 0.5]
    found = decode_site(scores, places, threshold=[0.6, 0.6, 0.5])
    assert sorted(zip(found.classes.tolist(), found.scores.tolist(), strict=True)) == [
        (1, pytest.approx(0.7)),
        (2, 0.5),
        (2, 0.5),
    ]


def test_of_overlapping_boxes_of_one_class_the_best_stays():
    scores, places = site_outputs()
    scores[FINE, 1], scores[FINE + 1, 1], scores[FINE, 2] = 0.6, 0.8, 0.5
    places[FINE + 1] = places[FINE]
    places[FINE + 1, [0, 2]] = np.log([3, 2])  # the same box, seen from the next cell
    found = decode_site(scores, places)
    assert found.classes.tolist() == [1, 2]
    assert found.scores == pytest.approx([0.8, 0.5])


@pytest.mark.parametrize(("aside", "people", "objects"), [(1.0, 1, 1), (1.6, 2, 1), (2.4, 2, 2)])
def test_people_may_overlap_more_than_objects(aside, people, objects):
    """Boxes of 5 by 5 strides, one ``aside`` of the other: they share 0.67, 0.52 and 0.35 of their union."""
    scores, places = site_outputs()
    scores[FINE, :2], scores[FINE + 1, :2] = 0.8, 0.6
    places[FINE, :4], places[FINE + 1, :4] = np.log([2, 2, 3, 3]), np.log([3 - aside, 2, 2 + aside, 3])
    found = decode_site(scores, places)
    assert [found.classes.tolist().count(label) for label in (0, 1)] == [people, objects]


def test_what_only_a_suppressed_box_overlaps_stays():
    boxes = np.array([[0.0, 0, 10, 10], [3, 0, 13, 10], [6, 0, 16, 10]])
    assert suppressed(boxes, 0.5).tolist() == [0, 2]
    assert suppressed(boxes[:0], 0.5).tolist() == []
    assert suppressed(boxes, [0.6, 0.5, 0.5]).tolist() == [0, 1]


def test_a_joint_is_the_top_of_its_heat_between_cells():
    rows, columns = np.mgrid[:32, :24]
    heat = np.exp(-((columns + 0.5 - 10.3) ** 2 + (rows + 0.5 - 20.8) ** 2) / 2)
    heat = (heat / heat.sum())[None, None].astype(np.float32)
    (((x, y, score, visible),),) = decode_joints(heat, np.array([[[0.8, 0.4]]], np.float32))
    assert (x, y) == pytest.approx((41.2, 83.2), abs=1e-3)
    assert visible == pytest.approx(0.4)
    assert score == pytest.approx(0.8 * heat[0, 0, 19:22, 9:12].sum(), rel=1e-5)


def test_a_joint_at_the_border_of_the_grid_stays_in_its_cell():
    heat = np.zeros((1, 1, 32, 24), np.float32)
    heat[0, 0, 0, 23] = 1
    assert decode_joints(heat, np.ones((1, 1, 2), np.float32))[0, 0, :3] == pytest.approx([94, 2, 1])


@pytest.mark.parametrize("cell", [(0, 0), (0, 23), (31, 0), (31, 23), (15, 0), (16, 23), (0, 11), (31, 12)])
def test_heat_of_other_rows_and_other_joints_is_not_around_a_joint_at_the_border(cell):
    heat = np.full((2, 3, 32, 24), 0.25, np.float32)
    heat[1, 1] = 0.125
    heat[1, 1, *cell] = 0.5
    rows, columns = (range(max(at - 1, 0), min(at + 2, size)) for at, size in zip(cell, (32, 24), strict=True))
    x, y, score, _ = decode_joints(heat, np.ones((2, 3, 2), np.float32))[1, 1]
    assert (x, y) == (4 * cell[1] + 2, 4 * cell[0] + 2)
    assert score == 0.5 + 0.125 * (len(rows) * len(columns) - 1)


def test_a_hat_of_one_crop_suppresses_none_of_another():
    hats = np.zeros((3, 5, 32, 24), np.float32)
    hats[0, :, 3, 10], hats[2, :, 3, 10] = [0.6, 30, 8, 50, 20], [0.9, 30, 8, 50, 20]
    found = decode_hats(hats, threshold=0.5)
    assert [scores.tolist() for _, scores in found] == [[pytest.approx(0.6)], [], [pytest.approx(0.9)]]
    assert np.array_equal(found[0][0], found[2][0])


def test_hats_are_read_crop_by_crop():
    hats = np.zeros((2, 5, 32, 24), np.float32)
    hats[1, :, 3, 10], hats[1, :, 3, 11] = [0.6, 30, 8, 50, 20], [0.9, 31, 8, 51, 20]
    hats[1, :, 20, 4] = [0.7, 10, 70, 24, 84]
    nothing, found = decode_hats(hats, threshold=0.5)
    assert nothing[0].shape == (0, 4)
    assert found[0] == pytest.approx(np.array([[31, 8, 51, 20], [10, 70, 24, 84]]))
    assert found[1] == pytest.approx([0.9, 0.7])
