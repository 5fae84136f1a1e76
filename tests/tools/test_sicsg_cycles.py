"""Claims about the path tracer: its geometry, its radiance, its passes, and what it says when it cannot work."""

from __future__ import annotations

import io
import json
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tools.sicsg.blender import wire
from tools.sicsg.mesh import Instance, Material, Mesh, View, build
from tools.sicsg.rendering.cycles import CyclesRenderer
from tools.sicsg.rendering.cycles_job import PYTHON_VARIABLE, ROOT, CyclesError, blender_python
from tools.sicsg.scene import Lamp, Light
from tools.sicsg.shapes import ellipsoid

WIDE = np.array([[150.0, 0.0, 52.3], [0.0, 170.0, 55.7], [0.0, 0.0, 1.0]])
TALL = np.array([[170.0, 0.0, 70.3], [0.0, 150.0, 40.7], [0.0, 0.0, 1.0]])
SIZE_WH = (128, 96)
WHITE = Material((1.0, 1.0, 1.0), roughness=1.0)
GLASS = Material((1.0, 1.0, 1.0), roughness=0.02, transmission=1.0)
GREETING = '{"blender": "5", "device": "CPU", "arrays": []}'
needs_blender = pytest.mark.skipif(
    not blender_python().exists(), reason=f"no Python with bpy at {blender_python()}: `make sicsg-env` makes one"
)


@pytest.fixture(scope="module")
def cycles() -> Iterator[CyclesRenderer]:
    with CyclesRenderer(samples=4) as renderer:
        yield renderer


def rig(
    lamps: tuple[Lamp, ...] = (), sun: float = 0.0, direction: tuple[float, float, float] = (0, 0, 1), sky: float = 0.0
) -> Light:
    return Light(
        name="0000", kind="indoor", lamps=lamps, sun_direction=direction, sun=sun, sky=sky, ambient=(0, 0, 0),
        exposure_ev=0.0,
    )  # fmt: skip


def looking(eye_m: tuple[float, float, float], target_m: tuple[float, float, float]) -> np.ndarray:
    z = np.subtract(target_m, eye_m) / np.linalg.norm(np.subtract(target_m, eye_m))
    x = np.cross(z, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(z, [0.0, 0.0, 1.0]))
    matrix = np.eye(4)
    matrix[:3, :3] = [x, np.cross(z, x), z]
    matrix[:3, 3] = -matrix[:3, :3] @ eye_m
    return matrix


def slab(material: Material, z_m: float = 0.0, half_m: float = 20.0) -> Mesh:
    corners = [[-half_m, -half_m, z_m], [half_m, -half_m, z_m], [half_m, half_m, z_m], [-half_m, half_m, z_m]]
    return build(corners, [[0, 1, 2], [0, 2, 3]], material)


def shown(mesh: Mesh, entity: int = 1, world_from_mesh: np.ndarray | None = None) -> Instance:
    return Instance(mesh, np.eye(4) if world_from_mesh is None else world_from_mesh, entity)


ABOVE = View(SIZE_WH, WIDE, looking((0.5, -3.0, 2.0), (0.0, 0.0, 0.0)))
SMALL = View((48, 36), np.array([[60.0, 0.0, 24.0], [0.0, 60.0, 18.0], [0.0, 0.0, 1.0]]), ABOVE.cam_from_world)
"""Of the same place; its principal point is the pixel [18, 24]."""


@needs_blender
@pytest.mark.parametrize("matrix", [WIDE, TALL], ids=["fx<fy", "fx>fy"])
def test_blender_s_own_projection_is_the_pinhole_s_within_a_hundredth_of_a_pixel(matrix: np.ndarray) -> None:
    points = np.random.default_rng(5).uniform([-1.5, -1.0, 2.0], [1.5, 1.0, 8.0], (50, 3))
    world = (np.c_[points, np.ones(50)] @ np.linalg.inv(ABOVE.cam_from_world).T)[:, :3]
    script = """
import json, sys, bpy, numpy as np
from mathutils import Vector
from bpy_extras.object_utils import world_to_camera_view
from tools.sicsg.blender.camera import set_camera
given, scene = json.load(sys.stdin), bpy.context.scene
set_camera(scene, given["size_wh"], np.array(given["matrix"]), np.array(given["cam_from_world"]))
bpy.context.view_layer.update()
found = [world_to_camera_view(scene, scene.camera, Vector(point))[:2] for point in given["points"]]
print("FOUND", json.dumps(found))
"""
    given = {"size_wh": SIZE_WH, "matrix": matrix.tolist(), "cam_from_world": ABOVE.cam_from_world.tolist()}
    run = subprocess.run(
        [blender_python(), "-c", script], input=json.dumps(given | {"points": world.tolist()}), cwd=ROOT,
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    share = np.array(json.loads(run.stdout.split("FOUND", 1)[1].splitlines()[0]))
    found = np.stack([share[:, 0] * SIZE_WH[0] - 0.5, (1.0 - share[:, 1]) * SIZE_WH[1] - 0.5], axis=1)
    expected = points @ matrix.T
    assert np.abs(found - expected[:, :2] / expected[:, 2:]).max() < 0.01


@needs_blender
@pytest.mark.parametrize("matrix", [WIDE, TALL], ids=["fx<fy", "fx>fy"])
def test_every_pixel_of_the_passes_looks_along_its_ray_within_a_hundredth_of_a_pixel(
    cycles: CyclesRenderer, matrix: np.ndarray
) -> None:
    """The depths of two slanted planes through (0, 0, 4) of the camera give x/z and y/z of each pixel."""
    world_from_cam = np.linalg.inv(ABOVE.cam_from_world)
    seen = []
    for axis in (0, 1):
        corners = np.array([[-9.0, -9.0, 4.0], [9.0, -9.0, 4.0], [9.0, 9.0, 4.0], [-9.0, 9.0, 4.0]])
        corners[:, 2] += 0.3 * corners[:, axis]
        plane = build(corners, [[0, 1, 2], [0, 2, 3]], WHITE)
        _, depth = cycles.passes([shown(plane, 1, world_from_cam)], View(SIZE_WH, matrix, ABOVE.cam_from_world))
        seen.append((1.0 - 4.0 / depth.astype(float)) / 0.3)
    rows, columns = np.mgrid[: SIZE_WH[1], : SIZE_WH[0]]
    x_px = matrix[0, 0] * seen[0] + matrix[0, 2]
    y_px = matrix[1, 1] * seen[1] + matrix[1, 2]
    assert max(np.abs(x_px - columns).max(), np.abs(y_px - rows).max()) < 0.01


@needs_blender
@pytest.mark.parametrize("matrix", [WIDE, TALL], ids=["fx<fy", "fx>fy"])
def test_pictures_and_pinhole_agree_where_a_glowing_square_is(cycles: CyclesRenderer, matrix: np.ndarray) -> None:
    centre = np.array([0.15, 0.1, 3.0])
    corners = centre + 0.3 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    glowing = build(corners, [[0, 1, 2], [0, 2, 3]], Material((1.0, 1.0, 1.0), emission=1.0))
    instance = shown(glowing, 1, np.linalg.inv(ABOVE.cam_from_world))
    light = cycles.render([instance], rig(), View(SIZE_WH, matrix, ABOVE.cam_from_world)).sum(axis=2, dtype=float)
    rows, columns = np.mgrid[: SIZE_WH[1], : SIZE_WH[0]]
    found = np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()
    expected = matrix @ centre
    assert np.abs(found - expected[:2] / expected[2]).max() < 0.1  # the denoiser moves edges a little


@needs_blender
def test_ids_and_depths_are_those_of_rays_that_meet_a_sphere_and_the_floor(cycles: CyclesRenderer) -> None:
    centre, radius = np.array([0.2, 0.3, 0.6]), 0.5
    ball = ellipsoid((radius, radius, radius), WHITE, centre_m=centre, sides=160)
    ids, depth = cycles.passes([shown(slab(WHITE, half_m=2.0), 7), shown(ball, 300)], ABOVE)
    rows, columns = np.mgrid[: SIZE_WH[1], : SIZE_WH[0]].astype(float)
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(WIDE).T
    world_from_cam = np.linalg.inv(ABOVE.cam_from_world)
    eye, rays = world_from_cam[:3, 3], rays @ world_from_cam[:3, :3].T
    floor = -eye[2] / rays[..., 2]
    hit = eye + floor[..., None] * rays
    floor[(floor < 0) | (np.abs(hit[..., :2]) > 2.0).any(axis=-1)] = np.inf
    a, b, c = (rays**2).sum(-1), rays @ (eye - centre), (eye - centre) @ (eye - centre) - radius**2
    inside = b**2 - a * c
    sphere = np.where(inside > 0, (-b - np.sqrt(np.maximum(inside, 0.0))) / a, np.inf)
    expected = np.where(sphere < floor, 300, np.where(np.isfinite(floor), 7, 0))
    nearest = np.minimum(sphere, floor)
    assert set(np.unique(expected)) == {0, 7, 300}
    assert np.count_nonzero(ids != expected) <= 0.003 * ids.size  # the mesh lies inside the sphere: rim pixels
    same = (ids == expected) & (inside > 0.02)
    np.testing.assert_allclose(depth[same], nearest[same], atol=0.002)
    np.testing.assert_array_equal(np.isinf(depth), ids == 0)


@needs_blender
def test_glass_is_opaque_in_the_passes_and_clear_in_the_picture(cycles: CyclesRenderer) -> None:
    pane, floor = shown(slab(GLASS, 0.5), 4), shown(slab(WHITE), 3)
    ids, depth = cycles.passes([floor, pane], ABOVE)
    _, depth_of_pane = cycles.passes([pane], ABOVE)
    assert np.all(ids[depth < 50.0] == 4)
    np.testing.assert_array_equal(depth, depth_of_pane)
    under_sun = rig(sun=1.0)
    bare, behind = (cycles.render(what, under_sun, SMALL)[18, 24, 0] for what in ([floor], [floor, pane]))
    assert 0.75 * bare < behind < 0.99 * bare  # two passes of a surface that reflects 4 % at least


@needs_blender
@pytest.mark.parametrize("size_m", [(0.1, 0.1), (0.4, 0.2)], ids=["small", "larger"])
def test_a_lamp_of_power_one_gives_a_white_surface_at_two_metres_the_radiance_one(
    cycles: CyclesRenderer, size_m: tuple[float, float]
) -> None:
    lamp = Lamp(position_m=(0.0, 0.0, 2.0), size_m=size_m, power=1.0, colour=(1.0, 0.5, 0.25))
    picture = cycles.render([shown(slab(WHITE))], rig((lamp,)), SMALL)
    np.testing.assert_allclose(picture[18, 24], lamp.colour, rtol=0.04)  # the surface keeps 2 %


@needs_blender
def test_the_sun_is_the_radiance_of_a_white_surface_that_faces_it(cycles: CyclesRenderer) -> None:
    direction = np.array([0.3, -0.2, 0.8]) / np.linalg.norm([0.3, -0.2, 0.8])
    picture = cycles.render([shown(slab(WHITE))], rig(sun=2.0, direction=tuple(direction)), SMALL)
    assert picture[18, 24, 0] == pytest.approx(2.0 * direction[2], rel=0.04)  # red: the sun's light is warm


@needs_blender
@pytest.mark.parametrize("azimuth", [0.3, 2.4, -1.8])
def test_the_sky_has_its_radiance_and_is_brighter_about_the_sun(cycles: CyclesRenderer, azimuth: float) -> None:
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.02])
    below = shown(slab(WHITE, -50.0, 0.1))
    view = View(SMALL.size_wh, SMALL.matrix, looking((0, 0, 0), tuple(towards)))
    plain = cycles.render([below], rig(sky=1.5), view)[14, 24]
    np.testing.assert_allclose(plain, 1.5 * np.array([1.0, 1.0, 0.98]), rtol=0.03)
    glowing = cycles.render([below], rig(sky=1.5, sun=4.0, direction=tuple(towards)), view)[14, 24]
    np.testing.assert_allclose(glowing - plain, 0.15 * 4.0 * np.array([1.0, 0.9, 0.75]), rtol=0.05)


@needs_blender
def test_a_mesh_that_moved_its_vertices_is_seen_where_it_is_now_and_the_same_again_when_it_is_back(
    cycles: CyclesRenderer,
) -> None:
    start = slab(Material((0.8, 0.2, 0.1), texture="fabric/0001", texture_m=0.5), half_m=0.4)
    floor, light = slab(WHITE, -0.5), rig(sun=1.0)
    moved = start.moved([[1, 0, 0, 0.9], [0, 1, 0, 0.0], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    first = cycles.render([shown(floor), shown(start, 2)], light, SMALL)
    ids_first, _ = cycles.passes([shown(floor), shown(start, 2)], SMALL)
    second = cycles.render([shown(floor), shown(moved, 2)], light, SMALL)
    ids_second, _ = cycles.passes([shown(floor), shown(moved, 2)], SMALL)
    again = cycles.render([shown(floor), shown(start, 2)], light, SMALL)
    np.testing.assert_array_equal(again, first)
    assert np.nonzero(ids_second == 2)[1].mean() > np.nonzero(ids_first == 2)[1].mean() + 5
    assert second[ids_second == 2][:, 2].mean() < 0.5 * second[ids_second == 1][:, 2].mean()


@needs_blender
def test_several_views_at_once_are_those_rendered_one_by_one(cycles: CyclesRenderer) -> None:
    things, light = [shown(slab(WHITE))], rig(sun=1.0, sky=0.5)
    other = View((40, 30), TALL, looking((-2.0, 1.0, 1.5), (0.0, 0.0, 0.0)))
    both = cycles.render_many(things, light, (SMALL, other))
    assert [picture.shape for picture in both] == [(36, 48, 3), (30, 40, 3)]
    for picture, view in zip(both, (SMALL, other), strict=True):
        np.testing.assert_array_equal(picture, cycles.render(things, light, view))


def fake_python(folder: Path, *lines: str) -> Path:
    script = folder / "python"
    script.write_text("\n".join(("#!/bin/sh", *lines, "")))
    script.chmod(0o755)
    return script


def test_without_an_interpreter_the_error_says_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PYTHON_VARIABLE, str(tmp_path / "missing"))
    with pytest.raises(CyclesError) as caught:
        CyclesRenderer()
    assert str(caught.value) == (
        f"no Python for bpy at {tmp_path / 'missing'}: No such file or directory; "
        "make it with `make sicsg-env`, or name another in SICSG_BPY_PYTHON"
    )


def test_an_interpreter_without_bpy_is_named_with_what_to_do() -> None:
    with pytest.raises(CyclesError) as caught:
        CyclesRenderer(python=Path(sys.executable))
    assert str(caught.value) == (
        f"{sys.executable} cannot import bpy: No module named 'bpy'; renew it with `make sicsg-env`"
    )


def test_a_process_that_dies_at_once_leaves_its_last_words(tmp_path: Path) -> None:
    dying = fake_python(tmp_path, "echo 'libGL.so.1: cannot open' >&2", "exit 3")
    with pytest.raises(CyclesError, match=r"python\) ended: libGL\.so\.1: cannot open; if that does not say why"):
        CyclesRenderer(python=dying)


def test_a_process_that_dies_without_a_word_leaves_its_exit_status(tmp_path: Path) -> None:
    with pytest.raises(CyclesError, match="ended: exit status -11, no message"):
        CyclesRenderer(python=fake_python(tmp_path, "kill -SEGV $$"))


def test_a_process_that_dies_while_it_renders_leaves_its_last_words(tmp_path: Path) -> None:
    dying = fake_python(tmp_path, f"echo '{GREETING}'", "read -r job", "echo 'malloc returns null' >&2", "exit 1")
    with CyclesRenderer(python=dying) as renderer, pytest.raises(CyclesError, match="ended: malloc returns null"):
        renderer.render([shown(slab(WHITE))], rig(), ABOVE)


def test_an_answer_that_is_no_message_is_quoted(tmp_path: Path) -> None:
    chatty = fake_python(tmp_path, "echo 'Welcome to Blender'")
    with pytest.raises(CyclesError, match=r"answered with something else \(Welcome to Blender\)"):
        CyclesRenderer(python=chatty)


def test_a_process_that_is_silent_for_too_long_is_ended(tmp_path: Path) -> None:
    silent = fake_python(tmp_path, f"echo '{GREETING}'", "exec sleep 60")
    with CyclesRenderer(python=silent, timeout_s=0.3) as renderer:
        assert renderer.device == "CPU"
        with pytest.raises(CyclesError, match=r"gave no answer within 0\.3 s"):
            renderer.passes([shown(slab(WHITE))], ABOVE)


def test_its_errors_come_whole_through_a_pool_of_processes() -> None:
    error = pickle.loads(pickle.dumps(CyclesError("Blender is silent", "nothing in 600 s", "start it again")))
    assert str(error) == "Blender is silent: nothing in 600 s; start it again"


def test_less_than_one_sample_is_refused() -> None:
    with pytest.raises(ValueError, match="samples: expected at least 1 light path per pixel, got 0"):
        CyclesRenderer(samples=0)


def test_a_message_arrives_as_it_was_sent() -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3)[:, ::2], "none": np.zeros((0, 4), np.int32), "b": np.array([True])}
    pipe = io.BytesIO()
    wire.send(pipe, {"do": "test"}, arrays)
    pipe.seek(0)
    header, found = wire.receive(pipe)
    assert header == {"do": "test"}
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    assert wire.receive(pipe) is None


@pytest.mark.parametrize("missing", [1, 40])
def test_a_message_that_stops_halfway_is_an_error(missing: int) -> None:
    pipe = io.BytesIO()
    wire.send(pipe, {}, {"a": np.arange(10.0)})
    with pytest.raises(wire.WireError, match=rf"ended {missing} bytes before the end of an array \[10\]"):
        wire.receive(io.BytesIO(pipe.getvalue()[:-missing]))
