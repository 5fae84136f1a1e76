"""Where a camera saw the board: which parts of its image, how far away, and how tilted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from rigcal.geometry import Bools, Floats, freeze
from rigcal.refine import JointResult

GRID = 64  # cells along the longer side of the image when the covered share is counted
EMPTY_SHARE = 0.1
"""Share of one of the nine parts of an image below which the part counts as empty."""
_NAMES = (
    ("top left", "top", "top right"),
    ("left", "middle", "right"),
    ("bottom left", "bottom", "bottom right"),
)


@dataclass(frozen=True, slots=True, eq=False)
class ImageCoverage:
    """Where one camera saw the board, over the views that were used."""

    share: float
    """Share of the image inside the outlines of the boards."""
    parts: Floats
    """(3, 3) the same of each ninth of the image, rows from the top, columns from the left."""
    distances_m: Floats
    """(n,) distance of each board's centre from the camera."""
    tilts_deg: Floats
    """(n,) angle between each board's normal and the line of sight to its centre."""
    tilt_spread_deg: float
    """Root-mean-square angle of the boards' normals from their mean."""
    board_distances_m: tuple[float, float]
    """Distances at which the board's longer side spans a half and a sixth of the image's longer side."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, parts=(3, 3), distances_m=(None,), tilts_deg=(len(self.distances_m),))

    @property
    def views(self) -> int:
        """How many views there are."""
        return len(self.distances_m)

    def empty_parts(self) -> str:
        """The empty parts of the image in words: ``the top edge and the left``; empty where there are none."""
        return named_parts(self.parts < EMPTY_SHARE)


def coverage_of(joint: JointResult, camera: int) -> ImageCoverage:
    """Where one camera of a solved rig saw the board."""
    obs, state, lens = joint.observations, joint.solution.state, joint.cameras[camera]
    mine = obs.camera_idx == camera
    boards = np.unique(obs.board_idx[mine]).tolist()
    mask = _covered(lens.size_wh, [obs.pixels[mine & (obs.board_idx == board)] for board in boards])
    poses = [state.cam_from_rig[camera] @ state.rig_from_board[board] for board in boards]
    centres = np.array([pose.apply(obs.corners_in_board.mean(axis=0)) for pose in poses]).reshape(-1, 3)
    normals = np.array([pose.rotation[:, 2] for pose in poses]).reshape(-1, 3)
    distances = np.linalg.norm(centres, axis=1)
    tilts = np.arccos(np.clip(np.abs((normals * centres).sum(axis=1)) / distances, 0, 1))
    side = float(np.ptp(obs.corners_in_board, axis=0).max())
    fills = float(lens.params[:2].mean()) * side / max(lens.size_wh)
    return ImageCoverage(
        float(mask.mean()),
        np.array([[float(part.mean()) for part in np.array_split(row, 3, axis=1)] for row in np.array_split(mask, 3)]),
        distances,
        np.rad2deg(tilts),
        _spread_deg(normals),
        (fills * 2, fills * 6),
    )


def _covered(size_wh: tuple[int, int], outlines: Sequence[Floats]) -> Floats:
    """(H, W) 1 where a board was, on a grid of :data:`GRID` cells along the longer side."""
    width, height = size_wh
    scale = GRID / max(width, height)
    mask = np.zeros((max(round(height * scale), 3), max(round(width * scale), 3)), dtype=np.uint8)
    for corners in outlines:
        outline = np.rint(cv2.convexHull((corners * scale).astype(np.float32))).astype(np.int32)
        cv2.fillConvexPoly(mask, outline, 1)
    return mask.astype(np.float64)


def _spread_deg(normals: Floats) -> float:
    if not len(normals):
        return 0.0
    mean = normals.mean(axis=0)
    cosines = np.clip(normals @ (mean / max(float(np.linalg.norm(mean)), 1e-12)), -1, 1)
    return float(np.rad2deg(np.sqrt((np.arccos(cosines) ** 2).mean())))


def common_parts(joint: JointResult, camera: int, other: int, distances_m: Floats) -> str:
    """Parts of one camera's image where another camera would see the board too, but no board was shown to both.

    Args:
        joint: The solved rig.
        camera: The camera whose image it is.
        other: The other camera.
        distances_m: (n,) how far from the first camera the board may be.

    Returns:
        In words as :func:`named_parts` gives them; empty where boards were in all such parts.
    """
    obs, state = joint.observations, joint.solution.state
    lens, width_height = joint.cameras[camera], np.array(joint.cameras[camera].size_wh)
    boards = [set(obs.board_idx[obs.camera_idx == c].tolist()) for c in (camera, other)]
    middle = obs.corners_in_board.mean(axis=0)
    rig_from_cam = state.cam_from_rig[camera].inverse()
    wanted = np.zeros((3, 3), dtype=bool)
    for row, column in np.ndindex(3, 3):
        ray = lens.rays((np.array([column, row]) + 0.5) * width_height / 3 - 0.5)
        places = state.cam_from_rig[other].apply(rig_from_cam.apply(ray * distances_m[:, None]))
        pixels = joint.cameras[other].project(places)
        inside = (pixels >= 0).all(axis=1) & (pixels < joint.cameras[other].size_wh).all(axis=1)
        wanted[row, column] = bool((inside & (places[:, 2] > 0)).any())
    for board in boards[0] & boards[1]:
        pixel = lens.project(state.cam_from_rig[camera].apply(state.rig_from_board[board].apply(middle)))
        column, row = np.clip(np.nan_to_num(pixel) * 3 // width_height, 0, 2).astype(int).tolist()
        wanted[row, column] = False
    return named_parts(wanted)


def named_parts(chosen: Bools) -> str:
    """Parts (3, 3) of an image in words, whole rows and columns at the edges as one: ``the top and the left``."""
    if chosen.all():
        return "every part"
    if np.delete(chosen.ravel(), 4).all():
        return "every edge and corner"
    left = chosen.copy()
    names: list[str] = []
    for edge in (0, 2):
        if chosen[edge].all():
            names.append(f"the {_NAMES[edge][1]} edge")
            left[edge] = False
    for edge in (0, 2):
        if chosen[:, edge].all():
            names.append(f"the {_NAMES[1][edge]} edge")
            left[:, edge] = False
    names += [f"the {_NAMES[row][column]}" for row, column in np.argwhere(left).tolist()]
    return ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1] if names else ""
