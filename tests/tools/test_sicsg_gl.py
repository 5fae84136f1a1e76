"""Claims about the fast path, against rays followed by hand and against projections."""

import numpy as np
import pytest

from tools.sicsg.mesh import Instance, Material, View, build, join
from tools.sicsg.rendering import gl, gl_meshes
from tools.sicsg.scene import Lamp, Light

SIZE = (160, 120)
FEW = 3
WHITE = Material((0.8, 0.8, 0.8), roughness=0.9)


@pytest.fixture(scope="module")
def renderer():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gl_meshes, "KEPT_TILES", FEW)
        try:
            made = gl.GlRenderer(plain_tiles)
        except gl.GlUnavailableError as error:
            pytest.skip(str(error))
        with made:
            yield made


def plain_tiles(name):
    level = {"plain/dark": 60, "plain/light": 188}.get(name, 128)
    return np.full((512, 512, 3), level, np.uint8)


def light(**changed):
    values = {
        "name": "0000", "kind": "indoor", "lamps": (), "sun_direction": (0.0, 0.0, 1.0), "sun": 0.0, "sky": 0.0,
        "ambient": (0.5, 0.5, 0.5), "exposure_ev": 0.0,
    }  # fmt: skip
    return Light(**(values | changed))


def lamp(x, y, z, size=(0.2, 0.2), power=1.0):
    return Lamp(position_m=(x, y, z), size_m=size, power=power, colour=(1.0, 1.0, 1.0))


def looking(eye, target, size=SIZE, focal=150.0):
    eye, target = np.array(eye, float), np.array(target, float)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.02, 0.01, 1.0])
    right /= np.linalg.norm(right)
    cam_from_world = np.eye(4)
    cam_from_world[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    cam_from_world[:3, 3] = -cam_from_world[:3, :3] @ eye
    matrix = np.array([[focal, 0.0, size[0] / 2 - 3.3], [0.0, focal * 1.01, size[1] / 2 + 2.2], [0.0, 0.0, 1.0]])
    return View(size, matrix, cam_from_world)


def rays(view):
    """(H, W, 3) directions of unit z-depth of the pixels' centres and the camera's place, in the world."""
    (width, height), K = view.size_wh, view.matrix
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    local = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=-1)
    rotation, shift = view.cam_from_world[:3, :3], view.cam_from_world[:3, 3]
    return local @ rotation, -rotation.T @ shift


def project(view, points):
    local = points @ view.cam_from_world[:3, :3].T + view.cam_from_world[:3, 3]
    image = local @ view.matrix.T
    return image[..., :2] / image[..., 2:]


def quad(corners, material=WHITE):
    return build(corners, [[0, 1, 2], [0, 2, 3]], material)


def floor(half=4.0, z=0.0, material=WHITE):
    return quad([(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)], material)


def box(low, high, material=WHITE):
    corners = np.array([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return build(corners, [t for a, b, c, d in sides for t in ([a, b, c], [a, c, d])], material)


def ball(centre, radius, material=WHITE, rings=120):
    polar, around = np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    rows = np.stack(np.meshgrid(polar, around, indexing="ij"), axis=-1)
    points = np.stack(
        [
            np.sin(rows[..., 0]) * np.cos(rows[..., 1]),
            np.sin(rows[..., 0]) * np.sin(rows[..., 1]),
            np.cos(rows[..., 0]),
        ],
        axis=-1,
    )
    count = 2 * rings
    faces = []
    for i in range(rings - 1):
        a = i * count + np.arange(count)
        b = i * count + (np.arange(count) + 1) % count
        faces += [np.stack([a, a + count, b], axis=1), np.stack([b, a + count, b + count], axis=1)]
    return build(points.reshape(-1, 3) * radius + centre, np.concatenate(faces), material, smooth=True)


def here(mesh, entity=0, matrix=None):
    return Instance(mesh, np.eye(4) if matrix is None else matrix, entity)


def test_depth_and_ids_of_a_plane_and_a_sphere_are_those_of_rays_followed_by_hand(renderer):
    view = looking((1.2, -3.0, 1.4), (0.1, 0.2, 0.5))
    centre, radius = np.array([0.2, 0.3, 0.7]), 0.6
    ids, depth = renderer.passes([here(floor(), 3), here(ball(centre, radius), 7)], view)
    directions, eye = rays(view)
    with np.errstate(divide="ignore"):
        plane = np.where(directions[..., 2] < 0, -eye[2] / directions[..., 2], np.inf)
    hits = eye + directions * plane[..., None]
    plane[(np.abs(hits[..., :2]) > 4.0).any(axis=-1)] = np.inf
    a, b = (directions**2).sum(-1), directions @ (eye - centre)
    root = b**2 - a * (((eye - centre) ** 2).sum() - radius**2)
    sphere = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    true = np.minimum(plane, sphere)
    wanted = np.where(np.isinf(true), 0, np.where(sphere < plane, 7, 3))
    agree = ids == wanted
    assert agree.mean() > 0.998  # the facets' outline is up to 0.2 mm inside the sphere's
    finite = agree & np.isfinite(true)
    steep = finite & ((wanted == 3) | (root > 0.05))
    assert np.abs(depth[steep] - true[steep]).max() < 5e-4
    flat = finite & (wanted == 3)
    assert np.abs(depth[flat] / true[flat] - 1).max() < 2e-6
    assert np.isinf(depth[agree & np.isinf(true)]).all()


def test_first_pixel_centre_is_the_origin_of_pixel_coordinates(renderer):
    matrix = np.array([[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 1.0]])
    view = View((40, 30), matrix, np.eye(4))
    for edge_px, first in ((4.9, 5), (5.1, 6)):
        x = edge_px / 100.0
        ids, _ = renderer.passes([here(quad([(x, -1, 1), (2, -1, 1), (2, 2, 1), (x, 2, 1)]), 9)], view)
        assert np.flatnonzero(ids[0] == 9)[0] == first
        ids, _ = renderer.passes([here(quad([(-1, x, 1), (2, x, 1), (2, 2, 1), (-1, 2, 1)]), 9)], view)
        assert np.flatnonzero(ids[:, 0] == 9)[0] == first


@pytest.mark.parametrize("supersample", [1.0, 2.0])
def test_bright_quads_lie_where_projection_puts_them(renderer, supersample):
    view = looking((0.3, -4.0, 1.0), (0.0, 0.0, 1.0))
    glow = Material((1.0, 1.0, 1.0), emission=5.0)
    dark = light(ambient=(0.0, 0.0, 0.0))
    for x, z in ((-0.913, 0.61), (0.01, 1.02), (0.577, 1.44)):
        corners = np.array([(x - 0.1, 0, z - 0.1), (x + 0.1, 0, z - 0.1), (x + 0.1, 0, z + 0.1), (x - 0.1, 0, z + 0.1)])
        image = renderer.render([here(quad(corners, glow))], dark, view, supersample=supersample)[..., 0]
        v, u = np.mgrid[: image.shape[0], : image.shape[1]]
        measured = np.array([(u * image).sum(), (v * image).sum()]) / image.sum()
        steps = (np.arange(60) + 0.5) / 60 * 0.2 - 0.1
        spread = np.array([(x + a, 0.0, z + b) for a in steps for b in steps])
        local = spread @ view.cam_from_world[2, :3] + view.cam_from_world[2, 3]
        weights = local**-3.0  # solid angle of a small facet of this plane, up to a constant
        expected = (project(view, spread) * weights[:, None]).sum(axis=0) / weights.sum()
        assert np.abs(measured - expected).max() < 0.05


def test_white_wall_two_metres_from_a_lamp_of_power_one_has_radiance_one(renderer):
    view = looking((0.0, 0.0, 1.5), (0.0, 0.01, 0.0))
    white = Material((1.0, 1.0, 1.0), roughness=1.0)
    image = renderer.render([here(floor(material=white))], light(lamps=(lamp(0, 0, 2.0),), ambient=(0, 0, 0)), view)
    assert project(view, np.array([0.0, 0.0, 0.0])) == pytest.approx([77, 62], abs=3)
    assert image[62, 77] == pytest.approx([1.0] * 3, rel=0.03)
    far = image[5, 5, 0]
    assert far < 0.9 * image[62, 77, 0]


def test_box_lit_from_above_throws_a_shadow_that_lies_below_it(renderer):
    view = looking((0.0, -3.0, 2.5), (0.0, 0.0, 0.3))
    lit = light(lamps=(lamp(0.0, 0.0, 3.0),), ambient=(0.05, 0.05, 0.05))
    table = box((-0.4, -0.4, 0.8), (0.4, 0.4, 0.9))
    image = renderer.render([here(floor()), here(table, 1)], lit, view)[..., 0]
    bare = renderer.render([here(floor())], lit, view)[..., 0]
    under = np.round(project(view, np.array([0.0, -0.25, 0.0]))).astype(int)
    beside = np.round(project(view, np.array([1.3, 0.0, 0.0]))).astype(int)
    assert image[under[1], under[0]] < 0.35 * bare[under[1], under[0]]
    assert image[beside[1], beside[0]] == pytest.approx(bare[beside[1], beside[0]], rel=0.05)


@pytest.mark.parametrize("height", [0.6, 1.5])
def test_edge_of_a_shadow_is_as_soft_as_similar_triangles_say(renderer, height):
    view = looking((0.0, -2.4, 0.5), (0.0, 0.0, 0.0), size=(320, 240), focal=300.0)
    lit = light(lamps=(lamp(0.0, 0.0, 3.0, size=(0.3, 0.3)),), ambient=(0, 0, 0))
    plate = box((-3.0, -0.6, height), (0.0, 0.6, height + 0.02), Material((0.0, 0.0, 0.0)))
    image = renderer.render([here(floor()), here(plate, 1)], lit, view)[..., 0]
    bare = renderer.render([here(floor())], lit, view)[..., 0]
    x = np.linspace(-0.3, 0.3, 25)
    at = np.round(project(view, np.stack([x, 0 * x, 0 * x], axis=1))).astype(int)
    half = 0.15 * height / (3.0 - height)
    share = image[at[:, 1], at[:, 0]] / bare[at[:, 1], at[:, 0]]
    assert np.abs(share - np.clip((x + half) / (2 * half), 0.0, 1.0)).mean() < 0.06


def test_sun_shines_through_a_hole_and_nowhere_else(renderer):
    roof = join([quad([(x0, y0, 2.5), (x1, y0, 2.5), (x1, y1, 2.5), (x0, y1, 2.5)]) for x0, y0, x1, y1 in (
        (-4, -4, -0.5, 4), (0.5, -4, 4, 4), (-0.5, -4, 0.5, -0.5), (-0.5, 0.5, 0.5, 4))])  # fmt: skip
    direction = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
    view = looking((-1.5, -3.0, 2.0), (-0.5, 0.0, 0.0))
    lit = light(sun=5.0, sun_direction=tuple(direction), ambient=(0.02, 0.02, 0.02))
    image = renderer.render([here(floor()), here(roof)], lit, view)[..., 0]
    middle = -2.5 * direction[:2] / direction[2]
    for offset, bright in (((0.0, 0.0), True), ((0.42, 0.0), True), ((0.62, 0.0), False), ((0.0, -0.65), False)):
        u, v = np.round(project(view, np.array([*(middle + offset), 0.0]))).astype(int)
        assert (image[v, u] > 0.8 * 5.0 * direction[2] * 0.8) == bright
        assert bright or image[v, u] < 0.2


def test_skylight_enters_by_panes_of_the_room_and_not_by_a_carried_window(renderer):
    glass = Material((1.0, 1.0, 1.0), roughness=0.02, transmission=1.0)
    pane = quad([(-0.8, 3.0, 0.5), (0.8, 3.0, 0.5), (0.8, 3.0, 2.0), (-0.8, 3.0, 2.0)], glass)
    view = looking((0.0, -3.0, 1.5), (0.0, 1.0, 0.0))
    lit = light(sky=5.0, ambient=(0.01, 0.01, 0.01))
    at = np.round(project(view, np.array([0.0, 1.2, 0.0]))).astype(int)[::-1]
    of_room = renderer.render([here(floor()), here(pane, 0)], lit, view)[tuple(at)]
    of_worker = renderer.render([here(floor()), here(pane, 4)], lit, view)[tuple(at)]
    assert of_room[0] > 5 * of_worker[0]


def test_pane_passes_coloured_light_and_is_opaque_in_ids_and_depth(renderer):
    view = looking((0.0, -3.0, 1.0), (0.0, 0.0, 1.0))
    glass = Material((0.2, 0.9, 0.4), roughness=0.05, transmission=1.0)
    wall = quad([(-3, 2, -1), (3, 2, -1), (3, 2, 3), (-3, 2, 3)])
    pane = quad([(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, 1.5), (-0.5, 0, 1.5)], glass)
    lit = light()
    bare = renderer.render([here(wall, 1)], lit, view)[60, 77]
    behind = renderer.render([here(wall, 1), here(pane, 2)], lit, view)[60, 77]
    assert behind / bare == pytest.approx(0.96 * np.array([0.2, 0.9, 0.4]), abs=0.08)
    assert behind[1] > 2 * behind[0]
    ids, depth = renderer.passes([here(wall, 1), here(pane, 2)], view)
    assert ids[60, 77] == 2
    assert depth[60, 77] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("transmission", [0.0, 0.9])
def test_a_surface_seen_head_on_everywhere_has_no_pixel_without_a_value(renderer, transmission):
    glossy = Material((0.8, 0.8, 0.8), roughness=0.2, metallic=0.5, transmission=transmission)
    around = ball((0.0, 0.0, 0.0), 2.0, glossy)
    view = looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert np.isfinite(renderer.render([here(around)], light(lamps=(lamp(0.5, 0.5, 1.0),)), view)).all()


def test_moved_vertices_show_although_everything_else_is_kept(renderer):
    view = looking((0.0, -3.0, 1.0), (0.0, 0.0, 1.0))
    one = box((-0.3, -0.3, 0.7), (0.3, 0.3, 1.3))
    matrix = np.eye(4)
    matrix[:3, 3] = [0.4, 0.5, -0.2]
    moved = one.moved(matrix)
    assert moved.faces is one.faces
    _, before = renderer.passes([here(one, 1)], view)
    _, by_vertices = renderer.passes([here(moved, 1)], view)
    _, by_instance = renderer.passes([here(one, 1, matrix)], view)
    _, again = renderer.passes([here(one, 1)], view)
    finite = np.isfinite(by_instance)
    assert (np.isfinite(by_vertices) != finite).sum() <= 2
    assert (
        np.abs(
            by_vertices[finite & np.isfinite(by_vertices)] / by_instance[finite & np.isfinite(by_vertices)] - 1
        ).max()
        < 1e-5
    )
    assert not np.array_equal(before, by_vertices)
    assert np.array_equal(before, again)


def test_pictures_do_not_depend_on_what_was_drawn_before(renderer):
    view = looking((1.0, -3.0, 1.6), (0.0, 0.0, 0.6))
    lit = light(lamps=(lamp(0.5, 0.0, 2.6), lamp(-1.0, 0.4, 2.6)), sky=1.0)
    things = [
        here(floor(material=Material((0.5, 0.5, 0.5), texture="plain/dark"))),
        here(ball(np.array([0, 0, 0.5]), 0.5), 1),
    ]
    first = renderer.render(things, lit, view)
    many = [here(floor(material=Material((1, 1, 1), texture=f"plain/{k}"))) for k in range(FEW)]
    renderer.render(many, light(sun=2.0), looking((0, 0, 3), (0.1, 0, 0), size=(64, 48)))
    assert np.array_equal(renderer.render(things, lit, view), first)
    with gl.GlRenderer(plain_tiles) as other:
        assert np.array_equal(other.render(things, lit, view), first)


def test_textures_multiply_the_colour_in_linear_light(renderer):
    view = looking((0.0, 0.0, 2.0), (0.0, 0.01, 0.0))
    lit = light(lamps=(lamp(0, 0, 2.5),), ambient=(0, 0, 0))
    shown = [
        renderer.render([here(floor(material=Material((0.6, 0.6, 0.6), texture=name)))], lit, view)[60, 77, 0]
        for name in (None, "plain/light", "plain/dark")
    ]
    linear = [((level / 255 + 0.055) / 1.055) ** 2.4 for level in (188, 60)]
    assert shown[1] / shown[0] == pytest.approx(linear[0], rel=0.02)
    assert shown[2] / shown[0] == pytest.approx(linear[1], rel=0.02)


def test_ambient_light_takes_the_colour_of_the_room(renderer):
    view = looking((0.0, -3.0, 1.0), (0.0, 0.0, 0.5))
    patch = quad(
        [(-0.3, 0, 0.2), (0.3, 0, 0.2), (0.3, 0, 0.8), (-0.3, 0, 0.8)], Material((0.5, 0.5, 0.5), roughness=1.0)
    )
    seen = []
    for colour in ((0.4, 0.4, 0.4), (0.5, 0.25, 0.15), (0.1, 0.1, 0.1)):
        walls = here(floor(material=Material(colour, roughness=1.0)))
        seen.append(renderer.render([walls, here(patch, 1)], light(), view)[60, 77])
    grey, brick, dark = seen
    assert brick[0] / brick[2] > 2.0
    assert grey[0] == pytest.approx(grey[2], rel=1e-3)
    assert dark[0] < 0.4 * grey[0]


def test_too_many_lamps_and_textures_are_refused_with_what_to_do(renderer):
    view = looking((0.0, -3.0, 1.0), (0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match=r"65 lamps and 0 windows; the renderer takes 64 in all: merge lamps"):
        renderer.render([here(floor())], light(lamps=tuple(lamp(0.1 * k, 0, 2) for k in range(65))), view)
    many = [here(floor(material=Material((1, 1, 1), texture=f"plain/{k}"))) for k in range(FEW + 1)]
    with pytest.raises(ValueError, match=rf"{FEW + 1} textures; the renderer takes {FEW}"):
        renderer.passes(many, view)


def test_missing_opengl_says_what_it_needs(monkeypatch):
    def fail(**_):
        raise RuntimeError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(gl.moderngl, "create_context", fail)
    with pytest.raises(gl.GlUnavailableError, match=r"no OpenGL context through EGL: libEGL.*OpenGL 4\.5.*libegl1"):
        gl.GlRenderer(plain_tiles)
