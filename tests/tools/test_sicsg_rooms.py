"""Textures, rooms, light rigs and cameras of the generator."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tools.sicsg.assets import is_sealed
from tools.sicsg.cameras import STEADY, anywhere, is_invertible, semicircle
from tools.sicsg.lighting import lamp_instances, light
from tools.sicsg.rooms import installation, is_door, prop_bounds, prop_footprints, room, room_instances
from tools.sicsg.rooms.props import KINDS as PROPS
from tools.sicsg.rooms.props import prop_mesh
from tools.sicsg.rooms.walls import WALLS, cut
from tools.sicsg.textures import HUED, KINDS, LEVEL, TILE_M, texture

ROOMS = ("0000", "0003", "0006", "0008", "0013", "8001")
LIGHTS = ("indoor", "backlight", "overexposed", "dusk")


def _room(name):
    return room(name, "test" if is_sealed(name) else "train")


def _half(one):
    return np.array(one.size_m[:2]) / 2


# textures


@pytest.mark.parametrize("kind", KINDS)
def test_a_texture_repeats_without_a_seam_and_is_near_its_level(kind):
    image = texture(f"{kind}/0005").astype(float)
    assert image.shape == (512, 512, 3)
    for axis in (0, 1):
        steps = np.abs(np.diff(image, axis=axis)).mean(axis=(1 - axis, 2))
        seam = np.abs(np.take(image, 0, axis) - np.take(image, -1, axis)).mean()
        assert seam <= 1.15 * steps.max()
    brightest = image.mean(axis=(0, 1)).max()
    assert LEVEL - 12 <= brightest <= LEVEL + 1


def test_the_seam_check_sees_a_picture_that_does_not_repeat():
    image = np.linspace(0, 255, 512)[None, :].repeat(512, 0)
    assert np.abs(image[:, 0] - image[:, -1]).mean() > 1.15 * np.abs(np.diff(image, axis=1)).mean(axis=0).max()


def test_textures_without_a_hue_of_their_own_are_nearly_grey():
    for kind in set(KINDS) - set(HUED):
        mean = texture(f"{kind}/0005").mean(axis=(0, 1))
        assert np.ptp(mean) < 25, kind


def test_a_texture_follows_from_its_name_alone():
    first = texture("osb/0003").copy()
    texture.cache_clear()
    assert np.array_equal(texture("osb/0003"), first)
    assert not np.array_equal(texture("osb/0004"), first)
    assert set(TILE_M) == set(KINDS)


@pytest.mark.parametrize("name", ["marble/0001", "brick", "brick/12", "brick/abcd"])
def test_a_texture_name_of_another_form_is_refused(name):
    with pytest.raises(ValueError, match=r"expected kind/number such as 'brick/0007'; kinds: concrete, plaster"):
        texture(name)


# rooms


def test_120_names_give_120_arrangements():
    arranged = {_room(f"{n:04d}").model_dump_json(exclude={"name"}) for n in range(120)}
    assert len(arranged) == 120


def test_a_name_of_the_other_half_is_refused():
    with pytest.raises(ValueError, match=r"room 8000: split 'train', but it is one of the sealed names"):
        room("8000", "train")
    with pytest.raises(ValueError, match=r"room 0001: split 'test', but it is one of the open names"):
        room("0001", "test")


@pytest.mark.parametrize("name", [f"{n:04d}" for n in range(0, 40, 3)])
def test_openings_lie_in_their_walls_and_apart(name):
    one = _room(name)
    x, y, height = one.size_m
    assert not installation(one).glazed
    assert not is_door(installation(one))
    assert np.prod(installation(one).size_m) > 2.0
    for number, opening in enumerate(one.openings):
        (u, z), (wide, tall) = opening.centre_m, opening.size_m
        assert abs(u) + wide / 2 < (y if opening.wall[1] == "x" else x) / 2 - 0.3
        assert z - tall / 2 >= -1e-6
        assert z + tall / 2 < height - 0.2
        for other in one.openings[:number]:
            assert other.wall != opening.wall or abs(other.centre_m[0] - u) > (other.size_m[0] + wide) / 2


def _inner_area(one, wall):
    """Square metres of triangles in the inner plane of a wall that look into the room and belong to the wall."""
    mesh, axis, sign = room_instances(one)[0].mesh, "xy".index(wall[1]), 1.0 if wall[0] == "+" else -1.0
    corners = mesh.vertices_m[mesh.faces].astype(float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    plane = (np.abs(corners[:, :, axis] - sign * one.size_m[axis] / 2) < 1e-4).all(axis=1) & (cross[:, axis] * sign < 0)
    names = np.array([material.texture == one.wall_texture for material in mesh.materials])
    return np.linalg.norm(cross[plane & names[mesh.face_material]], axis=1).sum() / 2


def test_walls_have_their_area_less_that_of_their_openings():
    checked = 0
    for name in ROOMS:
        one = _room(name)
        if one.wall_texture.startswith("drywall/"):
            continue
        for wall in WALLS:
            width = one.size_m[1 if wall[1] == "x" else 0]
            holes = sum(np.prod(opening.size_m) for opening in one.openings if opening.wall == wall)
            assert _inner_area(one, wall) == pytest.approx(width * one.size_m[2] - holes, abs=2e-3)
            checked += 1
    assert checked >= 12


def test_cutting_leaves_rectangles_that_cover_the_rest_once():
    rng = np.random.default_rng(3)
    holes = [(1.0, 0.0, 2.0, 2.1), (3.0, 0.9, 4.5, 2.0)]
    parts = cut((0.0, 0.0, 6.0, 2.8), holes)

    def within(p, areas):
        return sum(a[0] < p[0] < a[2] and a[1] < p[1] < a[3] for a in areas)

    for point in rng.uniform((0, 0), (6.0, 2.8), (500, 2)):
        assert within(point, parts) == 1 - within(point, holes)


def test_edges_that_meet_but_for_rounding_leave_no_sliver():
    beside = np.nextafter(1.2, 2.0)
    assert cut((0.0, 0.0, beside, 2.8), [(0.4, 0.9, 1.2, 2.1)]) == [
        (0.0, 0.0, 0.4, 0.9), (0.0, 0.9, 0.4, 2.1), (0.0, 2.1, 0.4, 2.8), (0.4, 0.0, 1.2, 0.9), (0.4, 2.1, 1.2, 2.8),
    ]  # fmt: skip


def test_no_light_comes_through_the_corners_of_a_room():
    """Rays from the middle meet the shell everywhere but in openings without a door."""
    for name in ("0006", "0013"):
        one = _room(name)
        mesh = room_instances(one)[0].mesh
        triangles = mesh.vertices_m[mesh.faces].astype(float)
        rng = np.random.default_rng(1)
        rays = rng.normal(size=(150, 3))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        for ray in rays:
            assert _hits(np.array([0.0, 0.0, 1.2]), ray, triangles)


def _hits(origin, ray, triangles):
    """Möller and Trumbore (1997)."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(ray, ac)
    det = np.einsum("fa,fa->f", ab, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("fa,fa->f", origin - a, p) / det
        q = np.cross(origin - a, ab)
        v, t = q @ ray / det, np.einsum("fa,fa->f", ac, q) / det
    return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).any())


@pytest.mark.parametrize("name", ROOMS)
def test_props_stand_inside_the_room_and_out_of_the_middle(name):
    one = _room(name)
    bounds = prop_bounds(one)
    assert (bounds[:, 0, :2] >= -_half(one) - 0.01).all()
    assert (bounds[:, 1, :2] <= _half(one) + 0.01).all()
    assert (bounds[:, 0, 2] > -0.01).all()
    assert (bounds[:, 1, 2] <= one.size_m[2] + 0.01).all()
    for x0, y0, x1, y1 in prop_footprints(one):
        assert not (x0 < 2.0 and x1 > -2.0 and y0 < 2.0 and y1 > -2.0)


@pytest.mark.parametrize("kind", PROPS)
def test_a_prop_has_a_sensible_size_and_textures_of_known_kinds(kind):
    mesh = prop_mesh(kind, "0002", (8.0, 9.0, 3.0))
    size = np.ptp(mesh.vertices_m, axis=0)
    assert (size[:2] <= 9.01).all()
    assert size[2] <= 3.01
    assert size.max() > 0.1
    assert len(mesh.faces) < 6000
    for material in mesh.materials:
        assert 0 <= min(material.colour) <= max(material.colour) <= 1
        assert material.texture is None or material.texture.partition("/")[0] in KINDS


def test_an_unknown_prop_is_refused():
    with pytest.raises(ValueError, match=r"prop 'crane', variant 0001: unknown kind; one of "):
        prop_mesh("crane", "0001", (8.0, 8.0, 3.0))


@pytest.mark.parametrize("name", ["8001", "8005", "0013", "0042"])
def test_a_room_and_all_in_it_come_from_its_half_of_the_assets(name):
    one = _room(name)
    used = {one.wall_texture, one.floor_texture, one.ceiling_texture}
    for instance in room_instances(one):
        assert instance.entity == 0
        used |= {material.texture for material in instance.mesh.materials if material.texture}
    numbers = {texture_name.partition("/")[2] for texture_name in used} | {prop.variant for prop in one.props}
    assert {is_sealed(number) for number in numbers} == {is_sealed(name)}
    assert len(numbers) > 3


def test_windows_have_one_pane_each():
    for name in ROOMS:
        mesh = room_instances(_room(name))[0].mesh
        glass = np.array([material.transmission > 0 for material in mesh.materials])[mesh.face_material]
        windows = [opening for opening in _room(name).openings if not is_door(opening)]
        assert glass.sum() == 2 * len(windows)


def test_a_room_is_made_once():
    assert room_instances(_room("0003")) is room_instances(_room("0003"))


# light rigs


@pytest.mark.parametrize("kind", LIGHTS)
def test_lamps_hang_inside_the_room_beside_its_ducts(kind):
    for name in ROOMS:
        one = _room(name)
        rig = light(name, one, kind)
        assert 1 <= len(rig.lamps) <= 6
        bounds = prop_bounds(one)
        for lamp in rig.lamps:
            low, high = (np.array(lamp.position_m[:2]) + s * np.array(lamp.size_m) / 2 for s in (-1, 1))
            assert (low > -_half(one)).all()
            assert (high < _half(one)).all()
            assert 2.2 < lamp.position_m[2] < one.size_m[2]
            assert max(lamp.colour) == pytest.approx(1.0)
            z = lamp.position_m[2]
            through = (bounds[:, 0, :2] < high).all(axis=1) & (bounds[:, 1, :2] > low).all(axis=1)
            assert not (through & (bounds[:, 0, 2] < z) & (bounds[:, 1, 2] > z)).any()
        assert np.linalg.norm(rig.sun_direction) == pytest.approx(1.0, abs=1e-3)
        assert lamp_instances(rig, one)[0].mesh.materials


def test_kinds_of_light_differ_as_they_should():
    def brightness(kind):
        rigs = [light(f"{n:04d}", _room(f"{n:04d}"), kind) for n in range(12)]
        return rigs, np.median([np.mean(rig.ambient) for rig in rigs])

    (_, indoor), (back, _), (over, bright), (dusk, dark) = (brightness(kind) for kind in LIGHTS)
    assert dark < 0.2 * indoor < 0.2 * bright
    assert all(1.2 <= rig.exposure_ev <= 2.2 for rig in over)
    assert all(rig.exposure_ev < 0 and rig.sun > 0 for rig in back)
    assert all(rig.sun == 0 and rig.sky < 0.2 for rig in dusk)


def test_back_light_shines_in_through_the_installation_opening():
    for name in ROOMS:
        one = _room(name)
        axis, sign = "xy".index(installation(one).wall[1]), 1.0 if installation(one).wall[0] == "+" else -1.0
        assert light(name, one, "backlight").sun_direction[axis] * sign > 0.3


def test_an_unknown_kind_of_light_is_refused():
    with pytest.raises(ValueError, match=r"light 0001: unknown kind 'disco'; one of indoor, backlight"):
        light("0001", _room("0000"), "disco")


# cameras


def _matrices(camera):
    """World centre, rotation rows and (K, distortion) of a scene camera, by OpenCV alone."""
    w, x, y, z = camera.quat_wxyz
    angle = 2 * np.arctan2(np.linalg.norm((x, y, z)), w)
    axis = np.array((x, y, z)) / max(np.linalg.norm((x, y, z)), 1e-12)
    rotation = cv2.Rodrigues(axis * angle)[0]
    return -rotation.T @ np.array(camera.translation_m), rotation


def _pixel(camera, point):
    c = camera.coefficients
    _, rotation = _matrices(camera)
    matrix = np.array([[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1.0]])
    bent = np.array([c[name] for name in ("k1", "k2", "p1", "p2", "k3")])
    moved = cv2.Rodrigues(rotation)[0], np.array(camera.translation_m)
    return cv2.projectPoints(np.array([point], dtype=float), *moved, matrix, bent)[0].ravel()


@pytest.mark.parametrize("name", ROOMS)
@pytest.mark.parametrize("make", [semicircle, anywhere])
def test_cameras_stand_free_inside_the_room_and_see_its_middle(name, make):
    one = _room(name)
    cameras = make(np.random.default_rng(5), (1280, 720), one, count=4)
    assert [camera.id for camera in cameras] == ["cam0", "cam1", "cam2", "cam3"]
    for camera in cameras:
        centre, rotation = _matrices(camera)
        assert (np.abs(centre[:2]) < _half(one) - 0.2).all()
        assert 0.8 <= centre[2] < one.size_m[2] - 0.3
        for low, high in prop_bounds(one):
            assert not ((low < centre) & (centre < high)).all()
        assert rotation[2] @ ((0, 0, 1.1) - centre) > 0
        x, y = _pixel(camera, (0.0, 0.0, 1.1))
        if make is semicircle:
            assert 1.85 < centre[2] < 2.2
            assert 3.0 <= np.linalg.norm(centre[:2]) <= 11.0
            assert np.hypot(x - 640, y - 360) < 110
        else:
            assert 2.0 <= np.linalg.norm(centre - (0, 0, 1.1)) <= 11.0


def test_the_first_camera_of_a_semicircle_is_a_front_one_and_the_arc_is_wide():
    for name in ROOMS:
        one = _room(name)
        axis, sign = "xy".index(installation(one).wall[1]), 1.0 if installation(one).wall[0] == "+" else -1.0
        inwards = -sign * np.eye(3)[axis, :2]
        towards = [_matrices(c)[0][:2] for c in semicircle(np.random.default_rng(2), (960, 540), one)]
        angles = [np.degrees(np.arccos(inwards @ t / np.linalg.norm(t))) for t in towards]
        assert angles[0] < 75
        unit = [t / np.linalg.norm(t) for t in towards]
        assert max(np.degrees(np.arccos(np.clip(a @ b, -1, 1))) for a in unit for b in unit) > 90


def test_lenses_bend_inwards_and_can_be_inverted_over_the_image():
    one = _room("0003")
    for seed in range(6):
        for camera in anywhere(np.random.default_rng(seed), (640, 360), one, sensors=STEADY):
            c = camera.coefficients
            assert -0.25 <= c["k1"] <= -0.05
            assert camera.exposure_s == pytest.approx(0.008)
            matrix = np.array([[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1.0]])
            bent = np.array([c[name] for name in ("k1", "k2", "p1", "p2", "k3")])
            corners = np.array([[0, 0], [639, 0], [0, 359], [639, 359]], dtype=float)
            rays = cv2.undistortPoints(corners, matrix, bent, criteria=(3, 200, 1e-12)).reshape(-1, 2)
            again = cv2.projectPoints(np.column_stack([rays, np.ones(4)]), np.zeros(3), np.zeros(3), matrix, bent)[0]
            np.testing.assert_allclose(again.reshape(-1, 2), corners, atol=0.01)


def test_a_lens_that_folds_over_is_recognised():
    from rigcal.camera import Camera

    params = [400.0, 400.0, 319.5, 179.5, -0.45, 0.0, 0.0, 0.0, 0.0]
    assert not is_invertible(Camera("opencv5", (640, 360), np.array(params)))
    params[4] = -0.1
    assert is_invertible(Camera("opencv5", (640, 360), np.array(params)))


def test_clocks_go_wrong_only_where_asked_and_never_the_first():
    one = _room("0000")
    right = semicircle(np.random.default_rng(0), (640, 360), one)
    wrong = semicircle(np.random.default_rng(0), (640, 360), one, fps=15.0, clocks=True)
    assert all(camera.clock_offset_s == camera.clock_drift_ppm == 0 for camera in right)
    assert wrong[0].clock_offset_s == 0
    assert all(camera.clock_offset_s != 0 and camera.clock_drift_ppm != 0 for camera in wrong[1:])
    assert {camera.fps for camera in wrong} == {15.0}


def test_a_room_without_a_free_place_says_so():
    one = _room("0003")
    walled = one.model_copy(update={"size_m": (3.0, 3.0, 2.8), "props": ()})
    with pytest.raises(ValueError, match=r"room 0003: no free place for a camera at camera 0 in 400 tries"):
        anywhere(np.random.default_rng(0), (640, 360), walled)
