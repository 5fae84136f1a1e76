"""Claims about the catalogue of objects and the solids it is made of."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from tools.sicsg import shapes
from tools.sicsg.assets import is_sealed
from tools.sicsg.catalog import (
    CATEGORIES,
    CATEGORY_NAMES,
    against_wall_pose,
    canonical_order,
    category,
    footprint,
    item,
    leaning_pose,
    lying_pose,
    resting_pose,
    wall_distance_m,
)
from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Material, Mesh
from tools.sicsg.textures import TILE_M

VARIANTS = ("0000", "0003", "0007", "0011", "0023", "8000", "8007")
POINTED = tuple(entry.name for entry in CATEGORIES if entry.keypoints)
SIZES_M = {
    "hard_hat": ((0.25, 0.40), (0.21, 0.36), (0.10, 0.22)),
    "ladder": ((0.05, 0.25), (0.38, 1.1), (2.4, 3.6)),
    "step_ladder": ((0.6, 1.5), (0.45, 0.75), (1.2, 3.1)),
    "platform": ((1.2, 2.3), (0.5, 0.9), (0.4, 0.9)),
    "large_window": ((0.05, 0.16), (1.2, 1.75), (1.3, 1.95)),
    "small_window": ((0.04, 0.14), (0.4, 0.75), (0.4, 0.75)),
    "toolbox": ((0.13, 0.32), (0.39, 0.65), (0.2, 0.45)),
    "cone": ((0.28, 0.4), (0.28, 0.4), (0.45, 0.75)),
    "bucket": ((0.26, 0.36), (0.26, 0.38), (0.26, 0.56)),
    "drill": ((0.2, 0.36), (0.05, 0.09), (0.2, 0.29)),
    "saw_horse": ((0.3, 0.65), (0.65, 1.7), (0.65, 0.9)),
    "scaffold": ((1.3, 2.1), (0.6, 0.95), (1.0, 2.95)),
    "wheelbarrow": ((1.4, 1.9), (0.6, 0.8), (0.5, 0.75)),
    "barrel": ((0.53, 0.63), (0.53, 0.63), (0.8, 0.95)),
}
GREY = Material((0.5, 0.5, 0.5))


def every(name: str) -> list[Item]:
    return [item(name, variant) for variant in VARIANTS]


def is_closed(mesh: Mesh) -> bool:
    """Every edge is passed as often in one direction as in the other, vertices told apart by their positions."""
    _, place = np.unique(np.round(mesh.vertices_m, 6), axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.faces]
    edges = Counter(map(tuple, np.concatenate([corners[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]).tolist()))
    return all(edges[end, start] == count for (start, end), count in edges.items())


def volume(mesh: Mesh) -> float:
    corners = mesh.vertices_m.astype(np.float64)[mesh.faces]
    return float(np.linalg.det(corners).sum() / 6)


def distance_to_mesh(point: NDArray[np.float64], mesh: Mesh) -> float:
    """To the nearest of many points spread over the faces, about 4 mm apart or less on the nearby ones."""
    corners = mesh.vertices_m.astype(np.float64)[mesh.faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    near = corners[(np.maximum(low - point, point - high).max(axis=1) < 0.03)]
    weights = np.array([(a, b, 400 - a - b) for a in range(0, 401, 8) for b in range(0, 401 - a, 8)]) / 400
    return float(np.linalg.norm(np.einsum("wk,fka->fwa", weights, near) - point, axis=2).min())


def test_categories_keep_the_order_of_the_networks_outputs() -> None:
    assert CATEGORY_NAMES == (
        "hard_hat", "ladder", "step_ladder", "platform", "large_window", "small_window", "toolbox", "cone", "bucket",
        "drill", "saw_horse", "scaffold", "wheelbarrow", "barrel",
    )  # fmt: skip
    assert {entry.name for entry in CATEGORIES if entry.critical} == {
        "hard_hat", "ladder", "step_ladder", "platform", "large_window",
    }  # fmt: skip


@pytest.mark.parametrize("name", CATEGORY_NAMES)
def test_variants_have_realistic_sizes_and_modest_meshes(name: str) -> None:
    for what in every(name):
        extent = np.ptp(what.mesh.vertices_m, axis=0)
        assert what.size_m == pytest.approx(extent.tolist(), abs=1e-6)
        for size, (low, high) in zip(what.size_m, SIZES_M[name], strict=True):
            assert low <= size <= high, (what.variant, what.size_m)
        assert len(what.mesh.faces) < 4000
        assert np.isfinite(what.mesh.vertices_m).all()
        assert np.isfinite(what.mesh.corner_uv_m).all()


@pytest.mark.parametrize("name", CATEGORY_NAMES)
def test_variants_are_closed_and_face_outwards(name: str) -> None:
    for what in every(name):
        assert is_closed(what.mesh), what.variant
        assert volume(what.mesh) > 0


@pytest.mark.parametrize("name", sorted(set(CATEGORY_NAMES) - {"hard_hat", "drill"}))
def test_things_stand_on_the_floor_over_their_origin(name: str) -> None:
    for what in every(name):
        low, high = what.mesh.vertices_m.min(axis=0), what.mesh.vertices_m.max(axis=0)
        assert -0.012 < low[2] < 0.004
        assert np.abs(low + high)[:2].max() / 2 < 0.12


@pytest.mark.parametrize("name", sorted(set(POINTED) - {"hard_hat"}))
def test_keypoints_lie_on_the_surface(name: str) -> None:
    for what in every(name):
        assert what.keypoints_m.shape == (len(category(name).keypoints), 3)
        for point in what.keypoints_m:
            assert distance_to_mesh(point, what.mesh) < 0.02, (what.variant, point)


def test_hat_clears_the_crown_and_its_centre_lies_within_the_shell() -> None:
    for what in every("hard_hat"):
        shell = what.mesh.vertices_m[np.unique(what.mesh.faces[what.mesh.face_material == 0])]
        over = shell[np.hypot(shell[:, 0], shell[:, 1]) < 0.01, 2]
        assert 0.015 < over.min() < over.max() < 0.05
        assert -0.12 < shell[:, 2].min() < -0.075
        assert np.abs(shell[:, 0]).max() > np.abs(shell[:, 1]).max()
        (centre,) = what.keypoints_m
        assert (shell.min(axis=0) < centre).all()
        assert (centre < shell.max(axis=0)).all()


@pytest.mark.parametrize("name", ["platform", "scaffold"])
def test_deck_corners_bound_the_walked_surface_counter_clockwise(name: str) -> None:
    for what in every(name):
        deck = what.deck_m
        assert np.ptp(deck[:, 2]) == 0.0
        edges = np.roll(deck, -1, axis=0) - deck
        assert (np.cross(edges, np.roll(edges, -1, axis=0))[:, 2] > 0).all()
        assert np.array_equal(deck, what.keypoints_m)
        length, width = np.ptp(deck, axis=0)[:2]
        low, high = {"platform": (0.5, 0.8), "scaffold": (0.6, 0.85)}[name]
        assert low <= width <= high < length
        floor = what.mesh.vertices_m[np.isclose(what.mesh.vertices_m[:, 2], deck[0, 2], atol=2e-3)]
        assert np.ptp(floor, axis=0)[:2] == pytest.approx([length, width], abs=0.01)


@pytest.mark.parametrize("name", ["ladder", "step_ladder", "platform", "scaffold"])
def test_rungs_rise_evenly_between_the_rails_left_end_first(name: str) -> None:
    for what in every(name):
        left, right = what.steps_m[:, 0], what.steps_m[:, 1]
        assert (left[:, 1] < 0).all()
        assert np.allclose(left * (1, -1, 1), right)
        assert (right[:, 1] < what.size_m[1] / 2).all()
        rises = np.diff(left[:, 2])
        assert (rises > 0.18).all()
        assert (rises < 0.36).all()
        top = what.deck_m[0, 2] if len(what.deck_m) else what.keypoints_m[:, 2].max()
        assert 0.1 < left[0, 2] < 0.45
        assert left[-1, 2] < top


def test_rungs_of_a_ladder_are_as_far_apart_as_the_standard_asks() -> None:
    for what in every("ladder"):
        assert np.diff(what.steps_m[:, 0, 2]) == pytest.approx(0.28)
        assert len(what.steps_m) >= 7


@pytest.mark.parametrize("name", ["ladder", "step_ladder"])
def test_ladders_are_held_on_both_rails_at_hand_height(name: str) -> None:
    for what in every(name):
        left, right = what.grips_m
        assert left[1] < 0 < right[1]
        assert 1.0 <= left[2] <= 1.2
        assert left[2] == right[2]
        assert distance_to_mesh(left, what.mesh) < 0.04


@pytest.mark.parametrize("name", ["large_window", "small_window"])
def test_windows_are_held_at_their_side_edges_and_named_from_the_front(name: str) -> None:
    for what in every(name):
        half, height = what.keypoints_m[1, 1], what.keypoints_m[0, 2]
        assert what.keypoints_m.tolist() == [[0, -half, height], [0, half, height], [0, half, 0], [0, -half, 0]]
        assert (what.grips_m[:2, 1] == half).all()
        assert (what.grips_m[2:, 1] == -half).all()
        assert (np.diff(what.grips_m.reshape(2, 2, 3)[..., 2]) > 0).all()
        panes = [material.transmission for material in what.mesh.materials]
        assert max(panes) > 0.8


@pytest.mark.parametrize("name", POINTED)
def test_symmetries_are_a_group_of_congruences(name: str) -> None:
    group = category(name).symmetries
    count = len(category(name).keypoints)
    assert group[0] == tuple(range(count))
    assert len(set(group)) == len(group)
    for a, b in itertools.product(group, repeat=2):
        assert tuple(a[i] for i in b) in group
    for what in every(name):
        distances = np.linalg.norm(what.keypoints_m[:, None] - what.keypoints_m[None], axis=2)
        for order in group:
            assert distances[np.ix_(order, order)] == pytest.approx(distances)


@pytest.mark.parametrize("name", POINTED)
def test_canonical_order_does_not_depend_on_the_order_that_came_in(name: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        points = rng.uniform(0, 600, (len(category(name).keypoints), 2))
        figure = points[list(canonical_order(name, points))]
        for order in category(name).symmetries:
            turned = points[list(order)] * rng.uniform(0.1, 3) + rng.uniform(-500, 500, 2)
            again = points[list(order)][list(canonical_order(name, turned))]
            assert np.array_equal(again, figure)


def test_canonical_order_puts_left_to_the_left_and_top_to_the_top() -> None:
    rectangle = {"top_left": (10, 10), "top_right": (90, 12), "bottom_right": (92, 60), "bottom_left": (8, 58)}
    names = category("large_window").keypoints
    points = np.array([rectangle[name] for name in names], dtype=np.float64)
    for shuffled in category("large_window").symmetries:
        order = canonical_order("large_window", points[list(shuffled)])
        assert np.array_equal(points[list(shuffled)][list(order)], points)
    seen_from_behind = np.array([(80, 300), (20, 300), (70, 20), (30, 20)], dtype=np.float64)
    assert canonical_order("ladder", seen_from_behind) == (1, 0, 3, 2)
    assert canonical_order("toolbox", np.zeros((0, 2))) == ()


@pytest.mark.parametrize("name", CATEGORY_NAMES)
def test_variants_differ_and_repeat(name: str) -> None:
    shapes_seen = {what.mesh.vertices_m.tobytes() for what in every(name)}
    assert len(shapes_seen) == len(VARIANTS)
    looks = {what.mesh.materials for what in every(name)}
    assert len(looks) == len(VARIANTS)
    assert item(name, "0007") is item(name, "0007")
    again = item.__wrapped__(name, "0007").mesh
    assert again.vertices_m.tobytes() == item(name, "0007").mesh.vertices_m.tobytes()
    assert again.materials == item(name, "0007").mesh.materials


@pytest.mark.parametrize("name", CATEGORY_NAMES)
def test_sealed_variants_use_sealed_textures_and_open_ones_open(name: str) -> None:
    for what in every(name):
        for material in what.mesh.materials:
            if material.texture is not None:
                kind, number = material.texture.split("/")
                assert kind in TILE_M
                assert material.texture_m == TILE_M[kind]
                assert is_sealed(number) == is_sealed(what.variant)
                assert int(number) % 8000 < 24


def test_unknown_names_are_refused_with_what_is_expected() -> None:
    with pytest.raises(ValueError, match="category 'crane' is not in the catalogue; expected one of hard_hat, ladder"):
        item("crane", "0000")
    for wrong in ("17", "00017", "abcd", "٠٠٠١"):
        with pytest.raises(ValueError, match="of ladder: expected a name of four digits such as '0017'"):
            item("ladder", wrong)
    with pytest.raises(ValueError, match=r"expected 4 finite pixels, got an array \(3, 2\)"):
        canonical_order("ladder", np.zeros((3, 2)))
    with pytest.raises(ValueError, match="with 2 values that are not finite"):
        canonical_order("ladder", [[0, 0], [1, 0], [0, 1], [np.nan, np.nan]])


@pytest.mark.parametrize("name", CATEGORY_NAMES)
def test_poses_touch_the_floor(name: str) -> None:
    what = item(name, "0003")
    for pose in (
        resting_pose(what, (1, 2, 0.3), 0.7),
        leaning_pose(what, (1, 2, 0.3), 0.7, 0.26),
        lying_pose(what, (1, 2, 0.3), 0.7),
    ):
        assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3))
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        assert what.mesh.moved(pose).vertices_m[:, 2].min() == pytest.approx(0.3, abs=1e-5)
    half_x, half_y = footprint(what)
    assert half_x >= what.size_m[0] / 2 - 1e-6
    assert half_y >= what.size_m[1] / 2 - 1e-6


def test_a_leaning_ladder_stands_at_its_angle_and_its_top_touches_the_wall() -> None:
    what, lean = item("ladder", "0000"), np.deg2rad(15)
    pose = leaning_pose(what, (wall_distance_m(what, lean), 0, 0), 0.0, lean)
    rail = pose[:3, :3] @ (0, 0, 1)
    assert np.rad2deg(np.arcsin(rail[2])) == pytest.approx(75.0)
    assert rail[0] < 0
    moved = what.mesh.moved(pose).vertices_m
    assert moved[:, 0].min() == pytest.approx(0.0, abs=1e-5)
    assert moved[moved[:, 0].argmin(), 2] > 2.0
    window = item("large_window", "0000")
    stored = window.mesh.moved(against_wall_pose(window, (-3, 1, 0), 0.0)).vertices_m
    assert stored[:, 0].min() == pytest.approx(-3.0, abs=1e-5)
    assert stored[:, 2].min() == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize(
    ("mesh", "cubic_m"),
    [
        (shapes.box((1, 2, 3), GREY, centre_m=(5, 5, 5)), 6.0),
        (shapes.box((1, 1, 1), GREY, bevel_m=0.1), 1 - 12 * 0.005 * 0.8 - 8 * (0.001 - 0.001 / 6)),
        (shapes.beam((0, 0, 0), (3, 4, 0), 0.1, 0.2, GREY), 0.1),
        (shapes.cylinder((0, 0, 0), (1, 2, 2), 0.5, GREY, sides=96), 3 * np.pi * 0.25),
        (shapes.cylinder((0, 0, 0), (0, 3, 0), 0.5, GREY, end_radius_m=0, sides=96), np.pi * 0.25),
        (shapes.ellipsoid((1, 2, 3), GREY, sides=96), 8 * np.pi),
        (shapes.ring(1.0, 0.1, GREY, sides=96, section_sides=48), 2 * np.pi**2 * 0.01),
        (shapes.lathe([(0.5, 0), (0.5, 1), (0.4, 1), (0.4, 0.1)], GREY, sides=96), np.pi * (0.25 - 0.16 * 0.9)),
        (shapes.lathe([(1, 0), (2, 0), (2, 1), (1, 1)], GREY, sides=96, closed=True), 3 * np.pi),
        (shapes.frame((1.0, 2.0), 0.1, 0.05, GREY), (2 - 0.8 * 1.8) * 0.05),
        (shapes.prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 0.5, GREY), 1.5),
        (shapes.prism([(0, 0), (0, 2), (1, 2), (1, 1), (2, 1), (2, 0)], 0.5, GREY), 1.5),
        (shapes.tube([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)], 0.05, GREY, sides=64), 3 * np.pi * 0.0025),
    ],
)
def test_solids_are_closed_and_hold_the_volume_of_their_formula(mesh: Mesh, cubic_m: float) -> None:
    assert is_closed(mesh)
    assert volume(mesh) == pytest.approx(cubic_m, rel=5e-3)


def test_texture_coordinates_are_metres_on_the_surface() -> None:
    mesh = shapes.cylinder((0, 0, 0), (0, 0, 2), 0.5, GREY, sides=48)
    corners = mesh.vertices_m[mesh.faces].astype(np.float64)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        on_mesh = np.linalg.norm(corners[:, a] - corners[:, b], axis=1)
        on_image = np.linalg.norm(mesh.corner_uv_m[:, a] - mesh.corner_uv_m[:, b], axis=1)
        assert on_image == pytest.approx(on_mesh, abs=1e-5)


def test_an_outline_that_crosses_itself_is_refused() -> None:
    with pytest.raises(ValueError, match="5 points crosses or touches itself; give a simple polygon"):
        shapes.prism([(0, 0), (2, 2), (2, 0), (0, 2), (1, 3)], 1.0, GREY)
