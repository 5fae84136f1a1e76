"""The mesh of a dressed worker, and the same mesh in any pose.

Vertices follow their bones by dual quaternions (Kavan et al., Geometric skinning with approximate dual quaternion
blending, 2008): the linear blend of matrices makes bent elbows and knees thin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from tools.sicsg.mesh import Mesh, box_uv, join
from tools.sicsg.skeleton import BONES, PARENT
from tools.sicsg.skeleton import body as body_of
from tools.sicsg.workers.body_shape import Figure, figure
from tools.sicsg.workers.clothes import clothes as clothes_of
from tools.sicsg.workers.cutting import paint, trim
from tools.sicsg.workers.fields import surface
from tools.sicsg.workers.garments import dressed
from tools.sicsg.workers.pieces import Piece
from tools.sicsg.workers.weights import INFLUENCES, skin_weights, strongest

Floats = NDArray[np.float64]
_TUCK_M = 0.003
"""How far walls of hems and edges reach below what lies under them."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinnedMesh:
    """A worker in the rest pose, with the bones that move each vertex."""

    mesh: Mesh
    weights: NDArray[np.float32]
    """(V, 4) summing to 1."""
    bones: NDArray[np.int32]
    """(V, 4) index into ``skeleton.BONES``, the strongest first."""


@lru_cache(maxsize=64)
def worker_mesh(body: str, clothes: str) -> SkinnedMesh:
    """The worker of these asset names in the rest pose of ``skeleton.rest_joints``."""
    shape = figure(body_of(body))
    pieces = dressed(shape, clothes_of(clothes), clothes)
    parts = [_part(piece, pieces, shape) for piece in pieces.values()]
    mesh = join([part.mesh for part in parts])
    weights, bones = (np.concatenate([getattr(part, name) for part in parts]) for name in ("weights", "bones"))
    for array in (mesh.vertices_m, mesh.faces, mesh.face_material, mesh.smooth, mesh.corner_uv_m, weights, bones):
        array.setflags(write=False)
    return SkinnedMesh(mesh, weights, bones)


def _part(piece: Piece, pieces: dict[str, Piece], shape: Figure) -> SkinnedMesh:
    """One piece as triangles with weights, without what other pieces hide."""
    vertices, faces = surface(piece.solid, piece.cell_m)
    for carved, under in piece.trims:
        vertices, faces = trim(vertices, faces, carved, under, _TUCK_M)
    for cover in piece.covers:
        faces = faces[~pieces[cover].hidden(vertices)[faces].all(axis=1)]
    vertices, faces, materials, chosen = paint(vertices, faces, piece.material, piece.bands)
    used, places = np.unique(faces, return_inverse=True)
    kept_m, corners = vertices[used].astype(np.float32), places.reshape(-1, 3).astype(np.int32)
    mesh = Mesh(kept_m, corners, chosen, materials, np.ones(len(corners), bool), box_uv(kept_m, corners))
    if piece.bone is None:
        weights = skin_weights(shape, vertices[used], piece.still)
    else:
        weights = np.tile(np.eye(len(BONES))[BONES.index(piece.bone)], (len(used), 1))
    return SkinnedMesh(mesh, *strongest(weights))


def posed(skinned: SkinnedMesh, bones: ArrayLike) -> Mesh:
    """The mesh under these ``world_from_rest`` matrices (B, 4, 4) of ``skeleton.bone_matrices``.

    All but the vertices are the same arrays as those of ``skinned.mesh``.

    Raises:
        ValueError: when there is not one matrix per bone.
    """
    matrices = np.asarray(bones, dtype=np.float64)
    if matrices.shape != (len(BONES), 4, 4):
        raise ValueError(f"bones: expected {(len(BONES), 4, 4)}, one matrix per bone, got {matrices.shape}")
    duals = _dual_quaternions(matrices).astype(np.float32)
    blended = np.zeros((len(skinned.weights), 8), dtype=np.float32)
    for place in range(INFLUENCES):
        blended += skinned.weights[:, place, None] * duals[skinned.bones[:, place]]
    blended /= np.linalg.norm(blended[:, :4], axis=1, keepdims=True)
    w, x, y, z, dw, dx, dy, dz = blended.T
    px, py, pz = skinned.mesh.vertices_m.T
    tx, ty, tz = y * pz - z * py + w * px, z * px - x * pz + w * py, x * py - y * px + w * pz
    shift_x = w * dx - dw * x + y * dz - z * dy
    shift_y = w * dy - dw * y + z * dx - x * dz
    shift_z = w * dz - dw * z + x * dy - y * dx
    moved = np.stack(
        [
            px + 2 * (y * tz - z * ty + shift_x),
            py + 2 * (z * tx - x * tz + shift_y),
            pz + 2 * (x * ty - y * tx + shift_z),
        ],
        axis=1,
    )
    return replace(skinned.mesh, vertices_m=moved)


def _dual_quaternions(matrices: Floats) -> Floats:
    """(B, 8) real part w x y z and dual part of rigid (B, 4, 4); each turns the short way from its parent."""
    real = Rotation.from_matrix(matrices[:, :3, :3]).as_quat(scalar_first=True)
    for bone, parent in enumerate(PARENT):
        if parent >= 0 and real[bone] @ real[parent] < 0:
            real[bone] *= -1
    vector, shift = real[:, 1:], matrices[:, :3, 3]
    dual_w = -0.5 * (shift * vector).sum(axis=1, keepdims=True)
    dual_v = 0.5 * (real[:, :1] * shift + np.cross(shift, vector))
    return np.concatenate([real, dual_w, dual_v], axis=1)
