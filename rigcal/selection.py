"""Which views of a long video take part: those that differ, held still, and enough of them.

Successive frames of a video show almost the same board and add time, not information. Where a camera has more views
than :attr:`SelectionOptions.most_views`, views are chosen one after the other, each the most unlike those chosen before
(farthest-point sampling; Gonzalez, Clustering to minimize the maximum intercluster distance, 1985), in what a board's
outline tells of its pose: where it is, how large, and how it is tilted. Views shared with other cameras come first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.detections import BoardDetections, BoardView, SiteDetections
from rigcal.errors import OptionError
from rigcal.geometry import Bools, Floats


@dataclass(frozen=True, slots=True)
class SelectionOptions:
    """How many views take part.

    Raises:
        OptionError: for a count below 20.
    """

    most_views: int = 120
    """Views of one camera; beyond about a hundred different ones the sigmas fall slowly and the time grows."""
    shared_share: float = 0.7
    """Share of them for views that another camera has too, where there are as many."""
    still_px: float = 1.5
    """Motion per frame below which a board counts as held still."""

    def __post_init__(self) -> None:
        if self.most_views < 20:
            raise OptionError("most_views", expected="20 or more", got=self.most_views)


def select_views(detections: SiteDetections, options: SelectionOptions) -> SiteDetections:
    """The same detections with at most ``most_views`` chosen per camera, and what their instants need besides.

    A view that was chosen for one camera keeps the views of the other cameras at its instant, since it is shared for
    their sake; so a camera may keep more. Captures below the limit come back as they are.
    """
    if all(len(camera.views) <= options.most_views for camera in detections.cameras):
        return detections
    frame_idx = detections.instants.frame_idx
    instant_of = [{int(f): i for i, f in enumerate(frame_idx[:, c]) if f >= 0} for c in range(len(detections.cameras))]
    seen = np.zeros(len(frame_idx), dtype=np.int64)
    for c, camera in enumerate(detections.cameras):
        seen[[instant_of[c][view.frame_idx] for view in camera.views]] += 1
    wanted: set[int] = set()
    for c, camera in enumerate(detections.cameras):
        instants = np.array([instant_of[c][view.frame_idx] for view in camera.views], dtype=np.int64)
        chosen = _choose(camera, seen[instants] > 1, options)
        wanted.update(instants[chosen].tolist())
    return replace(
        detections,
        cameras=tuple(
            replace(camera, views=tuple(v for v in camera.views if instant_of[c][v.frame_idx] in wanted))
            for c, camera in enumerate(detections.cameras)
        ),
    )


def _choose(camera: BoardDetections, shared: Bools, options: SelectionOptions) -> list[int]:
    """Indices of the views of one camera that are wanted."""
    count = len(camera.views)
    if count <= options.most_views:
        return list(range(count))
    features = np.array([_outline(view, camera.size_wh) for view in camera.views])
    still = _motion_px(camera.views) <= options.still_px
    quota = min(int(options.shared_share * options.most_views), int(shared.sum()))
    chosen: list[int] = []
    for among, target in ((shared, quota), (np.ones(count, dtype=bool), options.most_views)):
        for pool in (among & still, among):  # still ones as far as they go, then any
            chosen = _farthest(features, np.flatnonzero(pool), chosen, target)
    return chosen


def _farthest(features: Floats, pool: Sequence[int] | np.ndarray, chosen: list[int], target: int) -> list[int]:
    """Add views of the pool, each the farthest from all chosen, until there are ``target``."""
    left = np.setdiff1d(np.asarray(pool, dtype=np.int64), chosen)
    chosen = list(chosen)
    if not chosen and len(left) and target > 0:
        middle = features[left].mean(axis=0)
        chosen.append(int(left[np.linalg.norm(features[left] - middle, axis=1).argmin()]))
        left = left[left != chosen[-1]]
    if not chosen:
        return chosen
    distance = np.linalg.norm(features[left][:, None] - features[chosen][None], axis=-1).min(axis=1, initial=np.inf)
    while len(left) and len(chosen) < target:
        best = int(distance.argmax())
        chosen.append(int(left[best]))
        distance = np.minimum(distance, np.linalg.norm(features[left] - features[left[best]], axis=1))
        left, distance = np.delete(left, best), np.delete(distance, best)
    return chosen


def _outline(view: BoardView, size_wh: tuple[int, int]) -> Floats:
    """(6,) centre, log size and shape of a view's corners, in units in which one is a large difference.

    The second moments of the corners change with distance, turn and tilt; the third, with the perspective of a tilt.
    """
    longer = max(size_wh)
    points = view.corners_px / longer
    centre = points.mean(axis=0)
    offset = points - centre
    spread = np.sqrt((offset**2).sum(axis=1).mean())
    normed = offset / max(spread, 1e-9)
    xx, yy, xy = (normed[:, 0] ** 2).mean(), (normed[:, 1] ** 2).mean(), (normed[:, 0] * normed[:, 1]).mean()
    return np.array([*(2 * centre), np.log(spread), xx - yy, 2 * xy, 3 * float((normed**3).mean())])


def _motion_px(views: Sequence[BoardView]) -> Floats:
    """(n,) how far each view's corners moved per frame, from its nearest neighbours in time; infinite where unknown."""
    motion = np.full(len(views), np.inf)
    for index in range(len(views) - 1):
        one, two = views[index], views[index + 1]
        common, first, second = np.intersect1d(one.corner_ids, two.corner_ids, return_indices=True)
        if len(common):
            moved = float(np.linalg.norm(one.corners_px[first] - two.corners_px[second], axis=1).mean())
            step = moved / (two.frame_idx - one.frame_idx)
            motion[index : index + 2] = np.minimum(motion[index : index + 2], step)
    return motion
