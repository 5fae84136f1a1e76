"""What to do next, in words that name the camera, the place of the board and how many positions.

Gates that more views of one camera would mend give one and the same advice, since one walk with the board mends them
all; so do the gates that shared views of two cameras would mend.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rigcal.coverage import ImageCoverage
from rigcal.halves import SplitHalf
from rigcal.scale import ScaleCheck

VIEW_GATES = frozenset({"held_out_ratio", "focal_sigma_percent", "views", "tilt_spread_deg", "image_coverage"})
"""Gates that more views of the camera mend."""
CONTRADICTION_GATES = frozenset({"refined_rmse_px", "pairwise_rmse_px", "dropped_share"})
"""Gates that fail where views of several cameras contradict each other; more of the same views mend nothing."""
PAIR_GATES = frozenset({"position_sigma_m", "chain_overlap_views"})
"""Gates that more views shared with another camera mend."""
WORSE_TOGETHER = 1.2
"""RMSE with the other cameras over that alone, above which more views are no help: 1.1 and less on good captures,
1.2-1.4 where a camera was turned by 0.1 degrees or moved by 20 mm half way."""
FEWEST, MOST = 4, 20
"""Positions that are asked for at the least and at the most: a round with the board, and what one still walks."""
TILT_DEG = 30.0
"""Tilt of the views that are asked for, when their number is worked out: the middle of 20-45 degrees."""


@dataclass(frozen=True, slots=True)
class Sister:
    """A camera beside those that are declared alike."""

    ids: tuple[str, ...]
    """The sisters."""
    percent: float
    """Difference of the focal length from theirs, signed."""
    sigmas: float
    """The same over its own sigma."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraFigures:
    """Figures of one camera that the gates judge, and what the advice needs to know."""

    camera_id: str
    intrinsic_rmse_px: float | None
    refined_rmse_px: float
    held_out_px: float | None
    focal_sigma_percent: float | None
    dropped_share: float
    """Share of its board views that were dropped."""
    coverage: ImageCoverage
    parent_id: str | None = None
    """The camera before it on its chain; None for the reference."""
    pairwise_rmse_px: float | None = None
    position_sigma_m: float | None = None
    chain_overlap_views: int | None = None
    weakest: tuple[str, str] | None = None
    """The link of its chain that adds most to its uncertainty: the farther camera and the nearer."""
    common_parts: str = ""
    """Parts of the image of the link's farther camera where both would see the board, but none was shown."""
    lens_agreement: float | None = None
    sister: Sister | None = None


@dataclass(frozen=True, slots=True)
class RigFigures:
    """Figures of the whole rig that the gates judge, and what the advice needs to know."""

    camera_ids: tuple[str, ...]
    scene_sigma_m: float | None
    scene_views: int
    """Board positions that two cameras or more saw."""
    split_half: SplitHalf | None
    solver_agreement: float
    scale: ScaleCheck | None = None
    spread_s: float = 0.0
    """Greatest time between frames of one instant; 0 where no times are known."""
    thinnest: tuple[str, str] | None = None
    """The link of the chains with the fewest shared views."""
    contradicting: tuple[str, ...] = ()
    """Cameras that failed a gate of :data:`CONTRADICTION_GATES`."""


def for_camera(
    name: str, camera: CameraFigures, rig: RigFigures, failed: frozenset[str], limits: Mapping[str, float]
) -> str:
    """The next action for a gate of one camera that failed; ``failed`` are all gates that failed for it."""
    if name in CONTRADICTION_GATES or (_contradicts(camera, failed) and name in PAIR_GATES | {"held_out_ratio"}):
        return _contradiction(camera.camera_id, rig)
    if name in VIEW_GATES:
        return _more_views(camera, failed & VIEW_GATES, limits)
    if name in PAIR_GATES:
        return _more_shared_views(camera, failed & PAIR_GATES, limits)
    one = camera.camera_id
    if name == "lens_agreement":
        return (
            f"calibrate the lens of {one} again: the one given with --intrinsics does not fit this capture "
            "(another zoom or focus, or another camera's lens)"
        )
    if name == "sister_percent":
        return _odd_sister(camera)
    return (
        f"check that the board is flat and stiff and that {one} is in focus; then show it the board again, sharp, "
        "still and well lit"
    )


def _contradicts(camera: CameraFigures, failed: frozenset[str]) -> bool:
    """Whether a camera's views contradict those of others: they fit alone, and worse together.

    A camera with a given lens is not judged by that, since its RMSE alone is of another capture.
    """
    alone = camera.intrinsic_rmse_px if camera.lens_agreement is None else None
    return bool(failed & CONTRADICTION_GATES) or (alone is not None and camera.refined_rmse_px > WORSE_TOGETHER * alone)


def for_rig(name: str, rig: RigFigures, limits: Mapping[str, float]) -> str:
    """The next action for a gate of the whole rig that failed."""
    if rig.scale is not None and name == "scale_percent":
        return rig.scale.advice
    if rig.contradicting:
        return _contradiction(", ".join(rig.contradicting), rig)
    if name == "split_half":
        return _halves_differ(rig)
    if name == "scene_sigma_m":
        if rig.scene_sigma_m is None:
            return "show the board where two cameras or more look at the same place, in 6 or more positions"
        count = _positions(rig.scene_views, _times(rig.scene_sigma_m, limits[name]))
        return (
            f"show the board to two cameras or more at once, in the middle of the scene, in {count} or more positions"
        )
    return (
        f"show the board to {_thinnest(rig)} together in {FEWEST} or more positions: a second solver finds another rig "
        "from these views, so they do not determine it"
    )


def _contradiction(who: str, rig: RigFigures) -> str:
    if rig.split_half is not None and rig.split_half.movement is not None:
        return _halves_differ(rig)
    late = "" if rig.spread_s < 0.001 else f" (frames of one instant lie up to {rig.spread_s * 1e3:.0f} ms apart)"
    return (
        f"views of {who} contradict those of other cameras: fasten every camera, hold the board still at each position"
        f"{late} and capture again; if it stays, see that its images are of the same time and not mirrored"
    )


def _thinnest(rig: RigFigures) -> str:
    return " and ".join(rig.thinnest) if rig.thinnest else "two cameras"


def _more_views(camera: CameraFigures, failed: frozenset[str], limits: Mapping[str, float]) -> str:
    seen = camera.coverage
    near, far = seen.board_distances_m
    parts = seen.empty_parts()
    where = f"at {parts} of its image" if parts else "all over its image"
    so_far = f"; so far {_span(seen.distances_m.min(), seen.distances_m.max())}" if seen.views else ""
    count = max(_views_wanted(name, camera, limits) for name in failed)
    return (
        f"show {camera.camera_id} the board {where}, near and far ({_span(near, far)}{so_far}), tilted by 20-45 "
        f"degrees to all sides, in {count} or more positions"
    )


def _views_wanted(name: str, camera: CameraFigures, limits: Mapping[str, float]) -> int:
    """Positions that bring one gate back to its limit, as far as that can be told beforehand."""
    seen, limit = camera.coverage, limits[name]
    match name:
        case "views":
            return _clipped(limit - seen.views)
        case "focal_sigma_percent":
            return _positions(seen.views, _times(camera.focal_sigma_percent, limit))
        case "tilt_spread_deg" if limit < TILT_DEG:
            return _clipped(seen.views * (limit**2 - seen.tilt_spread_deg**2) / (TILT_DEG**2 - limit**2))
    return 6


def _more_shared_views(camera: CameraFigures, failed: frozenset[str], limits: Mapping[str, float]) -> str:
    far, near = camera.weakest or (camera.camera_id, camera.parent_id or "its neighbour")
    views = camera.chain_overlap_views or 0
    counts = [FEWEST]
    if "chain_overlap_views" in failed:
        far, near = camera.camera_id, camera.parent_id or near
        counts.append(_clipped(limits["chain_overlap_views"] - views))
    if "position_sigma_m" in failed:
        counts.append(_positions(views, _times(camera.position_sigma_m, limits["position_sigma_m"])))
    where = f" at {camera.common_parts} of {far}'s image" if camera.common_parts else ""
    return (
        f"show the board to {far} and {near} together{where}, as near as both see it whole, tilted by 20-45 degrees, "
        f"in {max(counts)} or more positions"
    )


def _odd_sister(camera: CameraFigures) -> str:
    sister, one = camera.sister, camera.camera_id
    if sister is None:
        return f"check the zoom of {one}"
    whose = f"{sister.ids[0]}'s" if len(sister.ids) == 1 else f"its sisters' ({', '.join(sister.ids)})"
    return (
        f"check the zoom and focus of {one} and show it more views: its focal length is {abs(sister.percent):.1f} % "
        f"{'longer' if sister.percent > 0 else 'shorter'} than {whose}, {abs(sister.sigmas):.0f} sigma"
    )


def _halves_differ(rig: RigFigures) -> str:
    split = rig.split_half
    if split is None:
        return (
            "the halves of the capture cannot be solved apart: show each camera the board in 6 or more positions, and "
            f"each pair on the chain in 2 or more of them together; begin with {_thinnest(rig)}"
        )
    if (moved := split.movement) is not None:
        return (
            f"fasten {rig.camera_ids[moved.camera]} and capture again: between the earlier and the later views it "
            f"moved by {moved.deg:.2g} degrees and {moved.m * 1e3:.2g} mm"
        )
    pair = " and ".join(rig.camera_ids[c] for c in split.farthest)
    return (
        "capture again with every camera fastened and a flat, stiff board held still at each position: two halves of "
        f"these views disagree, most about the distance between {pair}"
    )


def _times(value: float | None, limit: float) -> float:
    """How many times as many views it takes to bring a sigma to its limit; infinite where there is no sigma."""
    return math.inf if value is None else (value / limit) ** 2


def _positions(views: int, times: float) -> int:
    """Positions to add to ``views`` to have ``times`` as many."""
    return _clipped(max(views, 1) * (times - 1))


def _clipped(count: float) -> int:
    return MOST if count > MOST else max(math.ceil(count), FEWEST)


def _span(near_m: float, far_m: float) -> str:
    digits = 1 if near_m >= 1 else 2
    low, high = f"{near_m:.{digits}f}", f"{far_m:.{digits}f}"
    return f"{low} m" if low == high else f"{low} to {high} m"
