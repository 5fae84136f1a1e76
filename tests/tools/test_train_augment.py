"""Augmentation moves pixels, boxes and points together, and knows what a mirror does to names."""

import numpy as np
import pytest

from recognition.detectors.bundled.geometry import PAD, SITE_WH, WORKER_WH, Placing, crop_placing, crop_xyxy
from recognition.observations import JOINTS
from tools.sicsg.catalog import CATEGORIES, canonical_order
from tools.train.cache import AROUND, CROP_WH, letterboxed, moved, placed, widened
from tools.train.coco import Category, Truth
from tools.train.geometry import letterbox, mirrored
from tools.train.pixels import holed, recoloured
from tools.train.warp import Mirror, clipped, hidden, side_by_side, similarity, warp_image, warp_truth

PERSON = Category("person", JOINTS)


def spot(size_wh, places):
    """A grey image, as is the padding, with bright squares of 13 x 13 pixels around whole pixels."""
    image = np.full((size_wh[1], size_wh[0], 3), PAD, np.uint8)
    for x, y in places:
        image[y - 6 : y + 7, x - 6 : x + 7] = 255
    return image


def centroid_edges(image):
    """Middle of the brightness in edge coordinates."""
    weight = image[..., 0].astype(float) - PAD
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(weight * (x + 0.5)).sum(), (weight * (y + 0.5)).sum()]) / weight.sum()


def person(points_xy, box=(10, 10, 60, 60), flag=2.0):
    points = np.zeros((1, 17, 3))
    points[0, : len(points_xy), :2] = points_xy
    points[0, : len(points_xy), 2] = flag
    return Truth(np.zeros(1, int), np.array([box], float), points, np.zeros(1, bool))


@pytest.mark.parametrize("flip", [False, True])
def test_pixels_and_points_go_to_the_same_place(flip):
    matrix = similarity(1.7, 0.3, (40.0, 30.0), (70.0, 52.0), flip=flip)
    image = warp_image(spot((80, 60), [(33, 24)]), matrix, (140, 110))
    truth = warp_truth(person([(33.5, 24.5)]), matrix, (140, 110), Mirror.of((PERSON,)))
    middle = centroid_edges(image)
    assert np.allclose(middle, truth.points[0, 0, :2], atol=0.05)


def test_a_mirror_image_has_left_and_right_exchanged():
    points = [(float(k), 10.0 + k) for k in range(17)]
    matrix = similarity(1.0, 0.0, (50.0, 0.0), (50.0, 0.0), flip=True)
    mirror = warp_truth(person(points), matrix, (100, 100), Mirror.of((PERSON,)))
    left, right = JOINTS.index("left_wrist"), JOINTS.index("right_wrist")
    assert np.allclose(mirror.points[0, left, :2], [100.0 - points[right][0], points[right][1]])
    assert np.allclose(mirror.points[0, 0, :2], [100.0 - points[0][0], points[0][1]])
    assert np.allclose(mirror.boxes, [[40.0, 10.0, 90.0, 60.0]])


def test_mirrored_twice_is_unchanged_for_every_category_of_the_catalogue():
    for category in CATEGORIES:
        order = np.array(mirrored(category.keypoints), dtype=int)
        assert (order[order] == np.arange(len(category.keypoints))).all()


@pytest.mark.parametrize("category", [c for c in CATEGORIES if len(c.keypoints) > 1], ids=lambda c: c.name)
def test_the_canonical_order_survives_the_mirror(category):
    rng = np.random.default_rng(5)
    for _ in range(50):
        points = rng.uniform(0.0, 100.0, (len(category.keypoints), 2))
        canonical = points[list(canonical_order(category.name, points))]
        flipped = (canonical * [-1.0, 1.0] + [100.0, 0.0])[list(mirrored(category.keypoints))]
        assert canonical_order(category.name, flipped) == tuple(range(len(points)))


def test_a_turned_box_holds_the_turned_ellipse():
    angles = np.linspace(0.0, 2.0 * np.pi, 2000)
    ellipse = np.column_stack([35.0 + 25.0 * np.cos(angles), 30.0 + 10.0 * np.sin(angles)])
    matrix = similarity(1.3, 0.4, (0.0, 0.0), (40.0, 20.0), flip=True)
    turned = ellipse @ matrix[:, :2].T + matrix[:, 2] + [60.0, 0.0]
    matrix[0, 2] += 60.0
    found = warp_truth(person([(0.0, 0.0)], box=(10, 20, 60, 40)), matrix, (300, 300), Mirror.of((PERSON,)))
    assert np.allclose(found.boxes[0], [*turned.min(axis=0), *turned.max(axis=0)], atol=1e-3)


def test_points_outside_become_unlabelled_and_cut_boxes_ignored():
    truth = person([(20.0, 20.0), (55.0, 55.0)], box=(10, 10, 60, 60))
    mostly_inside = clipped(truth, (0, 0, 50, 100))
    assert mostly_inside.points[0, :2, 2].tolist() == [2.0, 0.0]
    assert np.allclose(mostly_inside.boxes, [[10, 10, 50, 60]])
    assert not mostly_inside.ignore[0]
    assert clipped(truth, (0, 0, 20, 100)).ignore[0]
    assert len(clipped(truth, (70, 0, 100, 100)).classes) == 0


def test_holes_hide_joints_and_whole_boxes():
    truth = person([(20.0, 20.0), (55.0, 55.0)])
    part = hidden(truth, np.array([[15.0, 15.0, 25.0, 25.0]]))
    assert part.points[0, :2, 2].tolist() == [1.0, 2.0]
    assert not part.ignore[0]
    assert hidden(truth, np.array([[0.0, 0.0, 58.0, 58.0]])).ignore[0]


def test_two_pictures_side_by_side_keep_what_lies_in_their_half():
    left, right = np.full((100, 200, 3), 10, np.uint8), np.full((100, 200, 3), 20, np.uint8)
    first, second = person([(30.0, 30.0)], box=(20, 20, 60, 60)), person([(30.0, 30.0)], box=(120, 20, 160, 60))
    image, truth = side_by_side((left, first), (right, second), 100)
    assert image[0, 99, 0] == 10
    assert image[0, 100, 0] == 20
    assert truth.boxes.tolist() == [[20, 20, 60, 60], [120, 20, 160, 60]]
    assert len(side_by_side((left, second), (right, first), 100)[1].classes) == 0


def test_letterbox_keeps_the_aspect_and_whole_pixels():
    assert letterbox((1280, 720), SITE_WH) == Placing(0.4, (0.0, 0.0))
    square = letterbox((720, 720), SITE_WH)
    assert square == Placing(0.4, (112.0, 0.0))
    image = letterboxed(spot((720, 720), [(102, 202)]), SITE_WH)
    inside = image[:, 112:400]
    assert (image[:, :112] == PAD).all()
    expected = square.to_input([102.5, 202.5]) - [112.0, 0.0]
    assert np.allclose(centroid_edges(inside), expected, atol=0.01)


@pytest.mark.parametrize("scale", [0.2, 0.45, 0.9, 2.3])
def test_a_placed_image_has_its_pixels_where_its_truth_is(scale):
    placing = Placing(scale, (80.7 - 153.5 * scale, 60.1 - 95.5 * scale))
    image = placed(spot((299, 241), [(153, 95)]), placing, (160, 160))
    wanted = moved(person([(153.5, 95.5)]), placing).points[0, 0, :2]
    assert np.allclose(centroid_edges(image), wanted, atol=0.05)
    assert np.allclose(placing.to_image(placing.to_input([[3.0, 4.0]])), [[3.0, 4.0]])


def test_the_crop_has_the_inputs_aspect_and_holds_the_box_with_more_room_above():
    boxes = np.array([[100.0, 100.0, 140.0, 200.0], [100.0, 100.0, 300.0, 160.0]])
    for box, crop in zip(boxes, crop_xyxy(boxes), strict=True):
        width, height = crop[2:] - crop[:2]
        assert width / height == pytest.approx(WORKER_WH[0] / WORKER_WH[1])
        assert (crop[:2] < box[:2]).all()
        assert (crop[2:] > box[2:]).all()
        assert box[1] - crop[1] > crop[3] - box[3]
        placing = crop_placing(crop)
        assert np.allclose(placing.to_input([crop[:2], crop[2:]]), [[0, 0], WORKER_WH])
        wide = widened(crop)
        assert np.allclose(wide[2:] - wide[:2], AROUND * (crop[2:] - crop[:2]))
        assert np.allclose(crop_placing(wide, CROP_WH).to_input(wide[2:]), CROP_WH)


def test_colours_and_holes_follow_from_the_seed_and_leave_the_input_alone():
    image = np.random.default_rng(3).integers(0, 256, (72, 128, 3)).astype(np.uint8)
    before = image.copy()
    results = [[recoloured(image, np.random.default_rng(seed)) for seed in range(40)] for _ in range(2)]
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))
    assert {result.shape for result in results[0]} == {image.shape}
    assert {result.dtype for result in results[0]} == {np.dtype(np.uint8)}
    changed, holes = holed(image, np.random.default_rng(1), image[::-1])
    assert np.array_equal(image, before)
    outside = np.ones(image.shape[:2], bool)
    for left, top, right, bottom in holes.astype(int):
        outside[top:bottom, left:right] = False
    assert np.array_equal(changed[outside], image[outside])
