"""Bodies and clothes of workers: where their surface lies, and how it follows the bones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tools.sicsg.assets import is_sealed
from tools.sicsg.mesh import Mesh
from tools.sicsg.skeleton import BONES, JOINTS, PARENT, body, bone_matrices, crown, rest_coco, rest_joints
from tools.sicsg.workers.clothes import clothes
from tools.sicsg.workers.cutting import split, trim
from tools.sicsg.workers.fields import Capsule, Ellipsoid, HalfSpace, Loft, Solid, surface
from tools.sicsg.workers.skinning import SkinnedMesh, posed, worker_mesh

WORKERS = [("0000", "0000"), ("0007", "0005"), ("0012", "0010"), ("0019", "8003")]
UP, FORWARD = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
REST = np.tile(np.eye(4), (len(BONES), 1, 1))


def turned(name: str, rotations_deg: dict[str, tuple[float, float, float]]) -> np.ndarray:
    """Bone matrices of a body whose bones are turned against their parents by rotation vectors."""
    rest = rest_joints(body(name))
    matrices, joints = np.zeros((len(BONES), 3, 3)), rest.copy()
    for i, bone in enumerate(BONES):
        local = Rotation.from_rotvec(np.deg2rad(rotations_deg.get(bone, (0.0, 0.0, 0.0)))).as_matrix()
        parent = PARENT[i]
        matrices[i] = local if parent < 0 else matrices[parent] @ local
        if parent >= 0:
            joints[i] = joints[parent] + matrices[parent] @ (rest[i] - rest[parent])
    return bone_matrices(joints, matrices, rest)


def corners(mesh: Mesh) -> np.ndarray:
    return mesh.vertices_m[mesh.faces].astype(np.float64)


def solid_angle(mesh: Mesh, point: np.ndarray) -> float:
    """Share of the sphere about the point that the outward faces cover: 1 or more inside, 0 outside of closed meshes.

    After Van Oosterom and Strackee, The solid angle of a plane triangle, 1983, equation 8.
    """
    a, b, c = np.moveaxis(corners(mesh) - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (a, c), (b, c))]
    below = la * lb * lc + dots[0] * lc + dots[1] * lb + dots[2] * la
    return float(2 * np.arctan2(above, below).sum() / (4 * np.pi))


def hits(mesh: Mesh, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances at which a ray meets the mesh, ascending, and whether it comes from outside (Moeller and Trumbore)."""
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    p = np.cross(direction, c - a)
    det = np.einsum("ij,ij->i", b - a, p)
    safe = np.where(np.abs(det) < 1e-12, np.inf, det)
    u = np.einsum("ij,ij->i", start - a, p) / safe
    q = np.cross(start - a, b - a)
    v, t = (q @ direction) / safe, np.einsum("ij,ij->i", c - a, q) / safe
    met = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0))
    met = met[np.argsort(t[met])]
    return t[met], det[met] > 0


@pytest.fixture(scope="module", params=WORKERS, ids="-".join)
def worker(request: pytest.FixtureRequest) -> tuple[str, SkinnedMesh]:
    name, garments = request.param
    return name, worker_mesh(name, garments)


def test_every_limb_joint_lies_inside(worker: tuple[str, SkinnedMesh]) -> None:
    name, skinned = worker
    for joint, point in list(zip(JOINTS, rest_coco(body(name)), strict=True))[5:]:
        assert solid_angle(skinned.mesh, point) > 0.7, joint


@pytest.mark.parametrize(
    ("joint", "least_m", "most_m"), [("wrist", 0.015, 0.06), ("elbow", 0.025, 0.085), ("knee", 0.04, 0.11)]
)
def test_limb_joints_lie_on_the_axis_of_the_limb(
    worker: tuple[str, SkinnedMesh], joint: str, least_m: float, most_m: float
) -> None:
    """Behind and before a joint there is as much flesh and cloth, to a factor of 2."""
    name, skinned = worker
    for side in ("left", "right"):
        point = rest_coco(body(name))[JOINTS.index(f"{side}_{joint}")]
        front, back = (hits(skinned.mesh, point, sign * FORWARD)[0][-1] for sign in (1.0, -1.0))
        assert 0.5 < front / back < 2.0
        assert least_m < min(front, back) <= max(front, back) < most_m


def test_face_joints_lie_on_the_skin(worker: tuple[str, SkinnedMesh]) -> None:
    name, skinned = worker
    for joint in JOINTS[:5]:
        point = rest_coco(body(name))[JOINTS.index(joint)]
        outwards = np.array([0.0, np.sign(point[1]), 0.0]) if "ear" in joint else FORWARD
        depth, _ = hits(skinned.mesh, point - 0.03 * outwards, outwards)
        assert np.abs(depth - 0.03).min() < 0.010, joint


def test_it_is_as_tall_as_its_body_and_stands_on_the_floor(worker: tuple[str, SkinnedMesh]) -> None:
    name, skinned = worker
    heights = skinned.mesh.vertices_m[:, 2]
    assert abs(heights.min()) < 0.004
    assert -0.003 < heights.max() - crown(body(name))[2] < 0.014  # hair


def test_a_head_is_between_a_seventh_and_an_eighth_of_the_stature() -> None:
    """From chin to crown, of a shaven worker."""
    shaven = (name for name in map("{:04d}".format, range(300)) if clothes(name).hair == "bald")
    mesh = worker_mesh("0000", next(name for name in shaven if not clothes(name).beard)).mesh
    nose, top = rest_coco(body("0000"))[0], crown(body("0000"))
    down, _ = hits(mesh, nose + [-0.035, 0.001, 0.0], -UP)
    assert 7.0 < body("0000").height_m / (top[2] - nose[2] + down[0]) < 8.3


def test_shoulders_are_two_and_a_half_to_four_heads_wide(worker: tuple[str, SkinnedMesh]) -> None:
    name, skinned = worker
    vertices, joints = skinned.mesh.vertices_m, rest_joints(body(name))
    shoulder, brow = joints[BONES.index("left_upper_arm")][2], crown(body(name))[2] - 0.07
    widths = [np.ptp(vertices[np.abs(vertices[:, 2] - height) < 0.02, 1]) for height in (shoulder, brow)]
    assert 2.5 < widths[0] / widths[1] < 4.0


def test_a_hat_of_the_usual_size_goes_over_every_head() -> None:
    """What is above the brim lies within 0.118 x 0.098 m, the narrowest opening of a hat's shell."""
    for name, garments in (*WORKERS, ("0008", "0008")):
        over = worker_mesh(name, garments).mesh.vertices_m - crown(body(name))
        over = over[over[:, 2] > -0.065]
        assert np.hypot(over[:, 0] / 0.118, over[:, 1] / 0.098).max() < 1.0


def test_who_looks_at_a_worker_sees_the_outside_of_faces(worker: tuple[str, SkinnedMesh]) -> None:
    name, skinned = worker
    rng, seen = np.random.default_rng(5), []
    for _ in range(80):
        angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.05, 0.97) * body(name).height_m
        direction = np.array([np.cos(angle), np.sin(angle), 0.0])
        _, from_outside = hits(skinned.mesh, np.array([0, rng.uniform(-0.1, 0.1), height]) - 3 * direction, direction)
        seen += from_outside[:1].tolist()
    assert len(seen) > 60
    assert all(seen)


def test_weights_sum_to_one_and_are_local(worker: tuple[str, SkinnedMesh]) -> None:
    """No vertex follows a bone whose segment is more than 0.3 m away, and limbs do not follow the other side's."""
    name, skinned = worker
    joints, vertices = rest_joints(body(name)), skinned.mesh.vertices_m
    np.testing.assert_allclose(skinned.weights.sum(axis=1), 1.0, atol=1e-6)
    assert skinned.weights.min() >= 0.0
    for index, bone in enumerate(BONES):
        share = (skinned.weights * (skinned.bones == index)).sum(axis=1)
        children = [joints[i] for i, parent in enumerate(PARENT) if parent == index]
        end = np.mean(children, axis=0) if children else joints[index]
        line = end - joints[index]
        part = np.clip((vertices - joints[index]) @ line / max(line @ line, 1e-9), 0, 1)
        away = np.linalg.norm(vertices - joints[index] - part[:, None] * line, axis=1)
        assert away[share > 0.05].max() < 0.33, bone
        if bone.startswith(("left", "right")):
            side = 1.0 if bone.startswith("left") else -1.0
            assert (side * vertices[share > 0.5, 1]).min() > -0.02, bone


def test_the_rest_pose_is_the_mesh_itself(worker: tuple[str, SkinnedMesh]) -> None:
    _, skinned = worker
    mesh = posed(skinned, REST)
    np.testing.assert_allclose(mesh.vertices_m, skinned.mesh.vertices_m, atol=1e-6)
    assert mesh.faces is skinned.mesh.faces
    assert mesh.materials is skinned.mesh.materials
    assert mesh.corner_uv_m is skinned.mesh.corner_uv_m


def test_a_rigid_motion_of_all_bones_moves_the_mesh_rigidly(worker: tuple[str, SkinnedMesh]) -> None:
    _, skinned = worker
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec([0.3, -0.9, 2.5]).as_matrix()
    motion[:3, 3] = (3.0, -2.0, 1.5)
    expected = skinned.mesh.moved(motion).vertices_m
    np.testing.assert_allclose(posed(skinned, np.tile(motion, (len(BONES), 1, 1))).vertices_m, expected, atol=1e-5)


def test_a_hand_follows_the_bone_of_the_hand() -> None:
    skinned = worker_mesh("0000", "0000")
    bones = turned("0000", {"left_upper_arm": (0, -70, 0), "left_forearm": (0, -50, 0), "left_hand": (20, 0, 0)})
    index = BONES.index("left_hand")
    own = (skinned.weights * (skinned.bones == index)).sum(axis=1) > 0.999
    expected = skinned.mesh.moved(bones[index]).vertices_m[own]
    assert own.sum() > 50
    np.testing.assert_allclose(posed(skinned, bones).vertices_m[own], expected, atol=1e-5)


@pytest.mark.parametrize(("bone", "degrees"), [("left_forearm", -120.0), ("right_shin", 110.0)])
def test_bent_joints_keep_their_thickness(bone: str, degrees: float) -> None:
    """Across the bend, sideways, the limb stays as wide as it was, and as far from the joint at the outside."""
    skinned, index = worker_mesh("0000", "0000"), BONES.index(bone)
    rest, parent = rest_joints(body("0000"))[index], BONES.index(bone) - 1
    mixed = [(skinned.weights * (skinned.bones == i)).sum(axis=1) for i in (parent, index)]
    ring = (mixed[0] > 0.3) & (mixed[1] > 0.3)
    axis = np.array([0.0, 1.0, 0.0])
    after = posed(skinned, turned("0000", {bone: (0.0, degrees, 0.0)})).vertices_m[ring] - rest
    before = skinned.mesh.vertices_m[ring] - rest
    assert ring.sum() > 15
    assert np.ptp(after @ axis) > 0.8 * np.ptp(before @ axis)
    far = [np.linalg.norm(points - np.outer(points @ axis, axis), axis=1) for points in (before, after)]
    assert np.quantile(far[1] / far[0], 0.05) > 0.8


def test_posing_wants_one_matrix_per_bone() -> None:
    with pytest.raises(ValueError, match=r"expected \(17, 4, 4\), one matrix per bone, got \(3, 4, 4\)"):
        posed(worker_mesh("0000", "0000"), REST[:3])


def test_forty_kinds_of_clothes_can_be_worn() -> None:
    """All forty fit the shared rules of a mesh; two of them are sewn here."""
    worn = [clothes(f"{k:04d}") for k in range(41)]
    assert len({repr(one) for one in worn}) == 41
    assert 18 <= sum(one.hi_vis != "none" for one in worn) <= 35
    assert {one.hair for one in worn} == {"bald", "short", "full", "tied", "long"}
    assert {one.top for one in worn} == {"jacket", "shirt", "t_shirt"}
    assert 8 <= sum(one.gloves is None for one in worn) <= 33
    for k in (4, 38):
        mesh = worker_mesh("0000", f"{k:04d}").mesh
        assert 6000 < len(mesh.faces) < 20000
        assert np.isfinite(mesh.vertices_m).all()
        assert mesh.faces.max() < len(mesh.vertices_m)
        assert mesh.face_material.max() < len(mesh.materials)


@pytest.mark.parametrize("names", [range(300), range(8000, 8075)])
def test_sealed_clothes_use_sealed_textures_and_open_ones_open_textures(names: range) -> None:
    for name in names:
        worn = clothes(f"{name:04d}")
        for material in (worn.top_material, worn.trousers_material):
            assert material.texture is not None
            assert is_sealed(material.texture.split("/")[1]) == is_sealed(f"{name:04d}")


def test_skin_spans_the_human_range_and_hi_vis_is_on_two_of_three() -> None:
    worn = [clothes(f"{k:04d}") for k in range(300)]
    tones = [sum(one.skin) for one in worn]
    assert max(tones) > 1.25
    assert min(tones) < 0.2
    assert 0.58 < np.mean([one.hi_vis != "none" for one in worn]) < 0.72


def test_the_same_names_give_the_same_bytes_and_others_give_others() -> None:
    first = worker_mesh("0007", "0005")
    worker_mesh.cache_clear()
    again, other = worker_mesh("0007", "0005"), worker_mesh("0007", "0006")
    assert first.mesh.vertices_m.tobytes() == again.mesh.vertices_m.tobytes()
    assert first.weights.tobytes() == again.weights.tobytes()
    assert first.mesh.materials == again.mesh.materials
    assert other.mesh.materials != first.mesh.materials


def test_a_split_follows_the_border_and_leaves_no_gap() -> None:
    vertices, faces = surface(Ellipsoid(np.zeros(3), np.full(3, 0.2)), (0.04, 0.04, 0.04))
    height = vertices[:, 2] - 0.013
    cut, parts = split(vertices, faces, height)
    sides = cut[parts][:, :, 2] - 0.013
    assert ((sides.min(axis=1) > -1e-9) | (sides.max(axis=1) < 1e-9)).all()
    edges = np.sort(np.concatenate([parts[:, [0, 1]], parts[:, [1, 2]], parts[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_a_trimmed_sheet_ends_at_the_cut_and_its_walls_below_the_surface_under_it() -> None:
    outer, inner = Ellipsoid(np.zeros(3), np.full(3, 0.2)), Ellipsoid(np.zeros(3), np.full(3, 0.18))
    vertices, faces = surface(outer, (0.03, 0.03, 0.03))
    sheet, kept = trim(vertices, faces, HalfSpace(UP, 0.05), inner, 0.004)
    used = sheet[np.unique(kept)]
    assert used[:, 2].max() < 0.051
    ends = used[np.linalg.norm(used, axis=1) < 0.19]
    assert len(ends) > 20
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 0.176, atol=0.001)
    rim = used[(np.linalg.norm(used, axis=1) > 0.19) & (used[:, 2] > 0.045)]
    np.testing.assert_allclose(rim[:, 2], 0.05, atol=0.001)


def test_surfaces_lie_where_the_solid_ends() -> None:
    """Against volumes in closed form: a capsule, and a straight loft of elliptic section with a plane cut."""
    capsule = Capsule(np.zeros(3), np.array([0.0, 0.0, 0.3]), 0.1, 0.1)
    knots = [(-0.2, 0.1, 0.1, 0.06), (0.4, 0.1, 0.1, 0.06)]
    cut = Solid(((Loft((0, 0, 0), UP, FORWARD, knots), 0.0),), cuts=((UP, 0.2), (-UP, 0.1)))
    expected = (np.pi * 0.01 * 0.3 + 4 / 3 * np.pi * 0.001, np.pi * 0.1 * 0.06 * 0.3)
    for solid, volume in zip((capsule, cut), expected, strict=True):
        vertices, faces = surface(solid, (0.02, 0.02, 0.02))
        a, b, c = np.moveaxis(vertices[faces], 1, 0)
        assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=0.04)
