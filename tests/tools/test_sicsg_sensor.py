"""Claims about the lens and the sensor."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigcal.camera import Camera
from tools.sicsg.rendering.lens import LensMap, camera_of
from tools.sicsg.rendering.sensor import expose, metered_exposure
from tools.sicsg.scene import Lamp, Light, SceneCamera

LENSES = {
    "opencv5": {
        "fx": 700.0, "fy": 703.0, "cx": 322.4, "cy": 176.7, "k1": -0.25, "k2": 0.08, "p1": 6e-4, "p2": -4e-4, "k3": 0.0,
    },
    "fisheye4": {"fx": 420.0, "fy": 421.0, "cx": 317.0, "cy": 183.0, "k1": 0.02, "k2": -0.01, "k3": 0.002, "k4": 0.0},
}  # fmt: skip
LUMA = np.array([0.2126, 0.7152, 0.0722])


def camera(model="opencv5", size_wh=(640, 360), **changed):
    x, y, z, w = Rotation.from_euler("xyz", [-100, 4, 20], degrees=True).as_quat().tolist()
    values = {
        "id": "cam0", "size_wh": size_wh, "model": model, "coefficients": LENSES[model],
        "quat_wxyz": (w, x, y, z), "translation_m": (0.1, 0.4, 5.0), "fps": 10.0,
    }  # fmt: skip
    return SceneCamera(**(values | changed))


def light(kind="indoor", exposure_ev=0.0):
    lamp = Lamp(position_m=(0.0, 0.0, 2.5), size_m=(1.2, 0.3), power=1.0, colour=(1.0, 0.9, 0.75))
    return Light(
        name="0003", kind=kind, lamps=(lamp,), sun_direction=(0.0, 0.6, 0.8), sun=0.0, sky=1.0,
        ambient=(0.3, 0.3, 0.3), exposure_ev=exposure_ev,
    )  # fmt: skip


def room(level=0.4, shape=(180, 320)):
    """A wall with some structure."""
    rng = np.random.default_rng(5)
    coarse = rng.uniform(0.5, 1.5, (shape[0] // 20, shape[1] // 20, 3)).astype(np.float32)
    return level * cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)


def disc(view, centre, radius=6.0):
    """A soft-edged disc in a picture of the view."""
    y, x = np.mgrid[: view.size_wh[1], : view.size_wh[0]]
    return np.clip(radius + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0.0, 1.0).astype(np.float32)


@pytest.mark.parametrize("model", ["opencv5", "fisheye4"])
def test_small_things_land_where_the_camera_projects_them(model):
    one = camera(model)
    lens, true = LensMap(one), camera_of(one)
    assert lens.view.size_wh[0] > 640 * 0.9
    for target in ((30.0, 40.0), (320.0, 180.0), (600.5, 331.0), (611.0, 22.5), (150.0, 290.0)):
        ray = true.rays(np.array(target))
        point = 4.2 * ray
        assert true.project(point) == pytest.approx(target, abs=1e-6)
        pinhole = lens.view.matrix @ point
        seen = lens.distort(disc(lens.view, pinhole[:2] / pinhole[2], radius=2.5))
        y, x = np.mgrid[:360, :640]
        landed = np.array([(x * seen).sum(), (y * seen).sum()]) / seen.sum()
        assert np.abs(landed - target).max() < 0.1


def test_colours_ids_and_depths_are_bent_alike_and_nothing_is_undefined():
    lens = LensMap(camera())
    mask = disc(lens.view, (300.0, 220.0), 40.0)
    bent = lens.distort(np.repeat(mask[:, :, None], 3, axis=2))
    assert bent.shape == (360, 640, 3)
    ids = lens.distort_nearest((mask > 0.5).astype(np.int32))
    depth = lens.distort_nearest(np.where(mask > 0.5, np.float32(2.5), np.float32(np.inf)))
    assert ids.dtype == np.int32
    assert np.isfinite(bent).all()
    assert np.array_equal(ids == 1, depth == 2.5)
    inside, outside = ids == 1, ids == 0
    assert bent[..., 0][inside].mean() > 0.97
    assert bent[..., 0][outside].max() < 0.95


def test_every_pixel_has_a_source_inside_the_view():
    lens = LensMap(camera())
    x, y = lens._map[..., 0], lens._map[..., 1]
    width, height = lens.view.size_wh
    assert x.min() >= 0 and y.min() >= 0  # noqa: PT018
    assert x.max() <= width - 1 and y.max() <= height - 1  # noqa: PT018
    true = camera_of(camera())
    rng = np.random.default_rng(1)
    for u, v in zip(rng.integers(0, 640, 50), rng.integers(0, 360, 50), strict=True):
        pinhole = lens.view.matrix @ true.rays(np.array([u, v], float))
        assert np.abs(pinhole[:2] / pinhole[2] - lens._map[v, u]).max() < 2e-3


def test_view_has_the_pose_of_the_camera():
    one = camera()
    matrix = LensMap(one).view.cam_from_world
    w, x, y, z = one.quat_wxyz
    assert matrix[:3, :3] == pytest.approx(Rotation.from_quat([x, y, z, w]).as_matrix())
    assert matrix[:3, 3] == pytest.approx(one.translation_m)
    assert isinstance(camera_of(one), Camera)


def test_lens_that_no_pinhole_can_stand_for_is_refused():
    wide = LENSES["fisheye4"] | {"fx": 150.0, "fy": 150.0}
    with pytest.raises(ValueError, match=r"camera cam0: the lens sees rays beyond 3 .* longer focal length"):
        LensMap(camera("fisheye4", coefficients=wide))
    short = {name: LENSES["opencv5"][name] for name in ("fx", "fy", "cx", "cy")}
    with pytest.raises(
        ValueError, match=r"camera cam0: lens model 'opencv5' has the coefficients .* got fx, fy, cx, cy;"
    ):
        LensMap(camera(coefficients=short))
    with pytest.raises(ValueError, match=r"\d+x\d+ pixels is expected.*got 20x10"):
        LensMap(camera()).distort(np.zeros((10, 20), np.float32))


def test_same_random_numbers_give_the_same_picture_and_others_other_noise():
    image, one = room(), camera()
    first, second, other = (expose(image, light(), one, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.shape == (180, 320, 3)
    assert first.dtype == np.uint8
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)
    assert abs(first.astype(float).mean() - other.astype(float).mean()) < 0.3


def test_channels_are_blue_green_red():
    image = np.zeros((90, 160, 3), np.float32)
    image[:] = (0.8, 0.2, 0.05)
    blue, green, red = expose(image, light(), camera(), np.random.default_rng(0)).reshape(-1, 3).mean(axis=0)
    assert red > green > blue


def test_exposure_follows_the_brightness_of_the_room_and_the_stops_asked_for():
    one = camera()
    metered = metered_exposure(room(), light(), one)
    assert metered_exposure(4 * room(), light(), one) == pytest.approx(metered / 4, rel=1e-4)
    assert metered_exposure(room(), light(exposure_ev=2.0), one) == pytest.approx(4 * metered, rel=1e-6)
    assert metered_exposure(room(), light(), camera(ev=-1.0)) == pytest.approx(metered / 2, rel=1e-6)
    means = [expose(room(level), light(), one, np.random.default_rng(0)).mean() for level in (0.1, 0.4, 1.6)]
    assert max(means) - min(means) < 6.0
    assert 90 < means[1] < 135


def test_backlight_meters_the_windows_so_that_the_room_is_darker_than_indoors():
    image = room(0.2)
    image[40:90, 180:280] = 8.0
    dark, normal = (metered_exposure(image, light(kind), camera()) for kind in ("backlight", "indoor"))
    assert dark < 0.75 * normal
    shown = expose(image, light("backlight"), camera(), np.random.default_rng(0))
    assert shown[45:85, 190:270].min() > 235
    assert shown[100:, :150].mean() < 110


def test_over_exposure_clips_what_is_bright():
    image = room()
    image[40:100, 80:240] *= 2.0  # a wall near a lamp
    plain = expose(image, light(), camera(), np.random.default_rng(0))
    over = expose(image, light("overexposed", 2.0), camera(), np.random.default_rng(0))
    assert (plain >= 250).mean() < 0.01
    assert (over[40:100, 80:240] >= 245).mean() > 0.5


def test_noise_grows_with_gain_and_in_the_dark():
    flat = np.full((180, 320, 3), 0.4, np.float32)

    def grain(level, gain):
        picture = expose(level * flat, light(), camera(gain=gain), np.random.default_rng(3))
        luma = picture[..., ::-1].astype(float) @ LUMA
        return float(np.std(luma - cv2.GaussianBlur(luma, (0, 0), 4.0)))

    assert grain(1.0, 3.0) > 1.4 * grain(1.0, 1.0)
    assert grain(0.05, 1.0) > 1.4 * grain(1.0, 1.0)
    assert 0.3 < grain(1.0, 1.0) < 4.0


def test_given_exposure_keeps_a_sequence_from_flickering():
    one = camera()
    before = room()
    after = before.copy()
    after[60:140, 100:200] = 3.0  # something bright comes into the picture
    metered = metered_exposure(before, light(), one)
    frames = [expose(image, light(), one, np.random.default_rng(7), exposure=metered) for image in (before, after)]
    corner = [frame[:40, :40].astype(float).mean() for frame in frames]
    assert abs(corner[0] - corner[1]) < 5.0


def test_highlights_bleed_into_their_neighbourhood():
    dark = np.full((180, 320, 3), 0.05, np.float32)
    lit = dark.copy()
    lit[80:100, 150:170] = 40.0
    shown = [
        expose(image, light(), camera(), np.random.default_rng(0), exposure=1.0).astype(float) for image in (dark, lit)
    ]
    near, far = (slice(70, 78), slice(150, 170)), (slice(0, 20), slice(0, 20))
    assert shown[1][near].mean() > shown[0][near].mean() + 5
    assert shown[1][near].mean() > shown[1][far].mean() + 5
