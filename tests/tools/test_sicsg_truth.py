"""Claims about the truth of a picture: projection, boxes, visibility, all against independent arithmetic."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tools.sicsg.scene import SceneCamera
from tools.sicsg.truth import Passes, Visibility, boxes_of_ids, project, visibility

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def camera(seed):
    rng = np.random.default_rng(seed)
    values = (1000 + rng.normal(0, 40), 1003 + rng.normal(0, 40), 640 + rng.normal(0, 9), 360 + rng.normal(0, 9))
    lens = (-0.2 + rng.normal(0, 0.03), 0.05, rng.normal(0, 5e-4), rng.normal(0, 5e-4), 0.0)
    turn = Rotation.from_euler("xyz", rng.normal(0, 0.2, 3)) * Rotation.from_euler("x", -95, degrees=True)
    x, y, z, w = turn.as_quat().tolist()
    return SceneCamera(
        id="cam0",
        size_wh=(1280, 720),
        coefficients=dict(zip(NAMES, (*values, *lens), strict=True)),
        quat_wxyz=(w, x, y, z),
        translation_m=tuple(rng.normal(0, 0.3, 3) + [0, 1, 6]),
        fps=5.0,
    )


def projected_by_hand(one, point):
    """Brown and Conrady's model, written out (OpenCV's documentation of calib3d), one point at a time."""
    w, x, y, z = one.quat_wxyz
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    local = [sum(r * p for r, p in zip(row, point, strict=True)) for row in rotation]
    local = [value + shift for value, shift in zip(local, one.translation_m, strict=True)]
    a, b = local[0] / local[2], local[1] / local[2]
    c, r2 = one.coefficients, a * a + b * b
    radial = 1 + c["k1"] * r2 + c["k2"] * r2**2 + c["k3"] * r2**3
    u = a * radial + 2 * c["p1"] * a * b + c["p2"] * (r2 + 2 * a * a)
    v = b * radial + c["p1"] * (r2 + 2 * b * b) + 2 * c["p2"] * a * b
    return c["fx"] * u + c["cx"], c["fy"] * v + c["cy"], local[2]


@pytest.mark.parametrize("seed", range(5))
def test_points_project_as_written_out_by_hand(seed):
    one = camera(seed)
    points = np.random.default_rng(seed).uniform([-1.5, -1, 0], [1.5, 1, 2], (40, 3))
    pixels, depth = project(one, points)
    for pixel, z, point in zip(pixels, depth, points, strict=True):
        u, v, expected = projected_by_hand(one, point.tolist())
        assert pixel == pytest.approx((u, v), abs=0.01)
        assert z == pytest.approx(expected, abs=1e-9)


def test_boxes_hold_their_pixels_from_edge_to_edge():
    ids = np.zeros((20, 30), np.int32)
    ids[3:7, 5:9] = 2
    ids[10, 12] = 1
    ids[6, 20] = 2  # a second part of the same entity, seen past what hides the middle
    boxes, pixels = boxes_of_ids(ids, 3)
    assert boxes[2].tolist() == [4.5, 2.5, 20.5, 6.5]
    assert boxes[1].tolist() == [11.5, 9.5, 12.5, 10.5]
    assert np.isnan(boxes[3]).all()
    assert pixels.tolist()[1:] == [1, 17, 0]


def scene_of_passes():
    """A wall at 8 m, its owner (1) at 5 m on the left, somebody else (2) at 3 m in the middle."""
    ids, depth = np.zeros((40, 60), np.int32), np.full((40, 60), 8.0, np.float32)
    ids[:, :20], depth[:, :20] = 1, 5.0
    ids[:, 20:40], depth[:, 20:40] = 2, 3.0
    return Passes(ids, depth)


@pytest.mark.parametrize(
    ("pixel", "z", "expected"),
    [
        ((10.2, 20.0), 5.08, Visibility.VISIBLE),
        ((10.2, 20.0), 5.30, Visibility.SELF_OCCLUDED),
        ((30.0, 20.0), 5.05, Visibility.OCCLUDED),
        ((50.0, 20.0), 5.05, Visibility.VISIBLE),  # the surface is thinner than a pixel there: nothing is before it
        ((50.0, 20.0), 8.50, Visibility.OCCLUDED),
        ((-0.6, 20.0), 5.05, Visibility.OUTSIDE),
        ((59.4, 39.4), 8.00, Visibility.VISIBLE),
        ((59.6, 20.0), 5.05, Visibility.OUTSIDE),
        ((np.nan, np.nan), 5.05, Visibility.OUTSIDE),
    ],
)
def test_a_joint_is_visible_unless_something_lies_more_than_its_flesh_before_it(pixel, z, expected):
    seen = visibility(scene_of_passes(), np.array([pixel]), np.array([z]), (1,), np.array([0.1]))
    assert seen[0] == expected


def test_a_worn_hat_hides_as_the_own_body_does():
    passes = scene_of_passes()
    points, depths, slack = np.array([[30.0, 20.0]]), np.array([5.0]), np.array([0.1])
    assert visibility(passes, points, depths, (1, 2), slack)[0] == Visibility.SELF_OCCLUDED
    assert visibility(passes, points, depths, (1,), slack)[0] == Visibility.OCCLUDED
