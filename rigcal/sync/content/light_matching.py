"""Which change of the light in one camera is which in another: the coarse offset, by the pattern of intervals.

Every pair of changes of the same kind proposes an offset; the one that pairs most changes wins, unless another one
pairs more than half as many: a lamp that blinks evenly fits at every period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats, freeze
from rigcal.sync.content.light_changes import LightChange

_CLEARLY = 2.0
"""How many times as many changes the best offset must pair as the second best."""
_LONE_GREY, _LONE_SHARE = 8.0, 0.2
"""A single change has no pattern to be known by: it must be strong, and seen over a good part of both images."""


@dataclass(frozen=True, slots=True, eq=False)
class Matching:
    """The changes of one camera beside those of the reference."""

    pairs: tuple[tuple[int, int], ...]
    """(reference's change, camera's change), both ascending."""
    offset_s: float
    """What to add to the camera's stamps, to within about a frame of both cameras."""
    reason: str
    """Why the pattern does not decide; empty where it does."""
    searched_s: Floats
    """(K,) offsets that were tried, ascending; empty where no change of one camera is near one of the other."""
    unpaired: Floats
    """(K,) for each, changes of the camera with fewer that stay without a partner."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, searched_s=(None,), unpaired=(len(self.searched_s),))


def unmatched(reason: str) -> Matching:
    """A camera of which no change is one of the reference's, and why."""
    return Matching((), 0.0, reason, np.zeros(0), np.zeros(0))


def match_changes(
    reference: Sequence[LightChange], camera: Sequence[LightChange], *, within_s: float, search_s: float
) -> Matching:
    """Pair the changes of a camera with the reference's.

    Args:
        reference: the reference camera's changes, in order of time.
        camera: the camera's.
        within_s: how far apart the times of one change may be read: a frame period of either camera, and their drift.
        search_s: greatest offset that is searched.
    """
    offsets = np.array([r.t_s - c.t_s for r in reference for c in camera if r.kind == c.kind])
    offsets = np.sort(offsets[np.abs(offsets) <= search_s])
    if not len(offsets):
        return unmatched(_nothing_common(reference, camera, search_s))
    pairings = [_pairs(reference, camera, offset, within_s) for offset in offsets]
    counts = np.array([len(pairs) for pairs in pairings])
    spread = np.array([_spread(reference, camera, pairs) for pairs in pairings])
    best = int(np.lexsort((np.abs(offsets), spread, -counts))[0])
    elsewhere = np.flatnonzero(np.abs(offsets - offsets[best]) > 2 * within_s)
    rival = int(elsewhere[np.argmax(counts[elsewhere])]) if len(elsewhere) else best
    if len(elsewhere) and counts[best] < _CLEARLY * counts[rival]:
        reason = (
            f"the pattern of switching is ambiguous: {counts[best]} of the changes fit an offset of "
            f"{offsets[best]:+.2f} s, but {counts[rival]} fit {offsets[rival]:+.2f} s as well; switch the light again, "
            f"at uneven intervals"
        )
    else:
        reason = _faint([(reference[r], camera[c]) for r, c in pairings[best]])
    offset_s = float(np.median([reference[r].t_s - camera[c].t_s for r, c in pairings[best]]))
    return Matching(pairings[best], offset_s, reason, offsets, min(len(reference), len(camera)) - counts)


def _faint(pairs: Sequence[tuple[LightChange, LightChange]]) -> str:
    """Why a single pair may be chance; empty where it is strong, or where there are several."""
    if len(pairs) > 1 or all(change.grey >= _LONE_GREY and change.share >= _LONE_SHARE for change in pairs[0]):
        return ""
    grey, share = min(change.grey for change in pairs[0]), min(change.share for change in pairs[0])
    return (
        f"only one change of the light was seen, and faintly ({grey:.0f} grey levels over {share:.0%} of the image); "
        f"switch a lamp that lights the room, or switch it several times at uneven intervals"
    )


def _pairs(
    reference: Sequence[LightChange], camera: Sequence[LightChange], offset_s: float, within_s: float
) -> tuple[tuple[int, int], ...]:
    """Changes that fall together at an offset, each at most once, the earliest that fits first."""
    pairs, r = [], 0
    for c, change in enumerate(camera):
        while r < len(reference) and reference[r].t_s - change.t_s - offset_s < -within_s:
            r += 1
        if r < len(reference) and reference[r].t_s - change.t_s - offset_s <= within_s:
            if reference[r].kind == change.kind:
                pairs.append((r, c))
            r += 1
    return tuple(pairs)


def _spread(reference: Sequence[LightChange], camera: Sequence[LightChange], pairs: Sequence[tuple[int, int]]) -> float:
    """Standard deviation of the offsets of pairs, in seconds: of offsets that pair as many, the tightest is right."""
    return float(np.std([reference[r].t_s - camera[c].t_s for r, c in pairs]))


def _nothing_common(reference: Sequence[LightChange], camera: Sequence[LightChange], search_s: float) -> str:
    if not camera:
        return (
            "this camera saw no sudden change of the light; switch a lamp that it sees fully on or off, or fire a flash"
        )
    if not reference:
        return "the reference camera saw no sudden change of the light; switch a lamp that both cameras see"
    return (
        f"no change of this camera's light is within {search_s:g} s of one of the reference's; record both at the same "
        f"time, or search further"
    )
