"""Crops of heads: who is bareheaded, how often that is shown, and what augmentation does to heads."""

import numpy as np
import pytest

from recognition.detectors.bundled.geometry import PAD, WORKER_WH
from tools.train.coco import Truth
from tools.train.heads import bareheaded, cut_at, head_of, spotlit

HEAD, SHOULDERS = (48.0, 30.0), (48.0, 40.0)
"""Middles in a crop."""


def crop(hats=(), *, flag=2.0):
    """A worker upright in the middle, and hats (left, top, right, bottom)."""
    boxes = np.array([(30.0, 20.0, 66.0, 120.0), *hats])
    points = np.zeros((len(boxes), 17, 3))
    points[0] = [48.0, 80.0, 2.0]
    points[0, :5] = [HEAD[0], HEAD[1], flag]
    points[0, 5:7, 1] = SHOULDERS[1]
    return Truth(np.array([0] + [1] * len(hats)), boxes, points, np.zeros(len(boxes), bool))


ON, IN_HAND = (42.0, 20.0, 54.0, 28.0), (60.0, 76.0, 72.0, 84.0)


@pytest.mark.parametrize(
    ("truth", "bare"),
    [
        (crop(), True),
        (crop([ON]), False),
        (crop([IN_HAND]), True),
        (crop([IN_HAND, ON]), False),
        (crop(flag=1.0), False),
        (crop(flag=0.0), False),
    ],
    ids=["without", "on", "in the hand", "both", "hidden head", "head outside"],
)
def test_a_head_is_bare_where_it_is_seen_and_no_hat_is_on_it(truth, bare):
    assert bareheaded(truth) is bare


def test_the_head_lies_beyond_the_joints_of_the_face_and_is_as_large_as_the_neck_is_long():
    x, y, radius = head_of(crop())
    assert (x, y, radius) == pytest.approx((48.0, 27.0, 6.0))
    assert head_of(crop(flag=1.0)) is None


def test_light_on_a_head_leaves_the_rest_alone():
    image = np.full((WORKER_WH[1], WORKER_WH[0], 3), 90, np.uint8)
    lit = [spotlit(image, np.random.default_rng(seed), (48.0, 27.0, 6.0)).astype(int) for seed in range(20)]
    assert all((one[60:] == 90).all() for one in lit)
    means = [one[24:30, 45:51].mean() for one in lit]
    assert min(means) < 75
    assert max(means) > 130


def test_an_image_that_ends_in_the_head_hides_what_is_beyond():
    image = np.full((WORKER_WH[1], WORKER_WH[0], 3), 200, np.uint8)
    seen = set()
    for seed in range(40):
        cut, truth = cut_at(image, crop([ON]), np.random.default_rng(seed), (48, 27, 6))
        beyond = (cut == PAD).all(axis=2)
        inside = np.argwhere(~beyond)[:, ::-1]
        low, high = inside.min(axis=0), inside.max(axis=0) + 1
        seen.add((low[0] > 0, low[1] > 0, high[0] < WORKER_WH[0]))
        assert (high - low).prod() == (~beyond).sum()
        assert (truth.boxes[:, :2] >= low).all()
        assert (truth.boxes[:, 2:] <= high).all()
        known = truth.points[0][truth.points[0, :, 2] > 0, :2]
        assert ((known >= low) & (known <= high)).all()
        assert truth.classes[0] == 0
    assert seen == {(True, False, False), (False, True, False), (False, False, True)}
