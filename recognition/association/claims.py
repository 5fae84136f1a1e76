"""Which detections known tracks claim: predicted, projected into every view, and matched there.

The cost of a pair is that of Student's t distribution with four degrees of freedom, the mean over the joints that both
have, so that a wrist that is wrong by half a metre costs no more than a few joints that are off by a hand. It is
counted in standard deviations of what the detector may err and the prediction may be off; a prediction that is less
certain pays for it. A pair is refused where the mean is that of joints that are all ``max_sigmas`` away. The matching
is that of the least total cost in each view (the Hungarian method).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, log1p

import numpy as np
from scipy.optimize import linear_sum_assignment

from recognition.observed import Detected
from recognition.optics import NEAREST_M, POINTS_AT_ONCE, Optics
from rigcal.geometry import Bools, Floats, Ints

DEGREES = 4.0
"""Of freedom of the errors' distribution: detectors err by whole limbs now and then."""
WORST_RATIO = 400.0
"""How much larger than the detector's a prediction's variance may be before it claims only what nobody else does."""


@dataclass(frozen=True, slots=True, eq=False)
class Claims:
    """What T tracks claim in V views."""

    rows: Ints
    """(T, V) of the detections, -1 where none."""
    sigmas: Floats
    """(T, V) how far each is: as if all joints were so many standard deviations away; 0 where none is claimed."""

    def beyond(self, sigmas: float) -> Bools:
        """(T, V) which claims are of detections that are farther away than this."""
        return np.asarray(self.sigmas > sigmas)


def claim(
    optics: Optics,
    detected: Detected,
    place_m: Floats,
    variance: Floats,
    known: Bools,
    label: Ints,
    *,
    across: Floats | None = None,
    min_shared: int,
    max_sigmas: float,
) -> Claims:
    """The detection that each track claims in each view.

    Args:
        optics: Of the rig.
        detected: N detections.
        place_m: (T, J, 3) predicted points of T tracks.
        variance: (T, J) of each coordinate of them, m^2.
        known: (T, J) which points the tracks have.
        label: (T,) number of each track's class.
        across: (V, T) by what the variances are multiplied in each view, since a place may be less certain along a
            camera's rays than across them; not above 0: the view is not asked. None: by 1.
        min_shared: How many points a track and a detection must share.
        max_sigmas: Largest distance.
    """
    found = Claims(np.full((len(place_m), optics.views), -1), np.zeros((len(place_m), optics.views)))
    if not (len(place_m) and detected.count):
        return found
    in_cam = optics.in_cameras(place_m.reshape(-1, 3)).reshape(3, -1, *known.shape)
    at_once = max(1, POINTS_AT_ONCE // known.size)
    parts = [
        _benefits(
            in_cam, detected, slice(first, min(first + at_once, detected.count)), variance, known, label, across,
            min_shared, max_sigmas,
        )
        for first in range(0, detected.count, at_once)
    ]  # fmt: skip
    benefit, cost = parts[0] if len(parts) == 1 else (np.concatenate(each) for each in zip(*parts, strict=True))
    pairs = [
        (linear_sum_assignment(benefit[first:end], maximize=True), first)
        for first, end in zip(detected.ends, detected.ends[1:], strict=False)
        if end > first
    ]
    rows = np.concatenate([row + first for (row, _), first in pairs])
    tracks = np.concatenate([track for (_, track), _ in pairs])
    taken = benefit[rows, tracks] > 0
    rows, tracks = rows[taken], tracks[taken]
    found.rows[tracks, detected.view[rows]] = rows
    found.sigmas[tracks, detected.view[rows]] = np.sqrt(DEGREES * np.expm1(cost[rows, tracks]))
    return found


def _benefits(
    in_cam: Floats,
    detected: Detected,
    rows: slice,
    variance: Floats,
    known: Bools,
    label: Ints,
    across: Floats | None,
    min_shared: int,
    max_sigmas: float,
) -> tuple[Floats, Floats]:
    """(R, T) how much likelier the pair is than none, 0 where it is refused; and its cost (R, T).

    ``in_cam`` (3, V, T, J) has the tracks' points in all cameras; ``rows`` are those of R detections.
    """
    view = detected.view[rows]
    in_cam = in_cam.take(view, axis=1)
    depth = np.maximum(in_cam[2], NEAREST_M)
    dx = in_cam[0] - detected.factors[1, rows, None] * depth  # metres at the depth of the track
    dy = in_cam[1] - detected.factors[2, rows, None] * depth
    own = detected.angle_var[rows, None] * (depth * depth) + detected.spread_var[rows, None]
    whole = own + (variance if across is None else variance * across[view, :, None])
    both = (detected.seen[rows, None] & known & (in_cam[2] > NEAREST_M)).astype(np.float64)
    each = np.ones(known.shape[1])
    count = both @ each
    share = 1.0 / np.maximum(count, 1.0)
    costs = np.log1p((dx * dx + dy * dy) / (DEGREES * whole))
    mean = (costs * both) @ each * share
    doubt = np.log(((whole * both) @ each + 1e-12) / ((own * both) @ each + 1e-12))
    limit = log1p(max_sigmas**2 / DEGREES)
    gain = log(WORST_RATIO) + (limit - mean) * (DEGREES / 2 + 1) - doubt
    able = (count >= min_shared) & (mean < limit) & (detected.label[rows, None] == label)
    if across is not None:
        able &= across[view] > 0
    return np.where(able, np.maximum(gain, 1e-6), 0.0), mean
