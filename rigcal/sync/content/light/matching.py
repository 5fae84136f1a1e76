"""Which change of the light in one camera is which in another: the coarse offset, by the pattern of intervals.

Every pair of changes of the same kind proposes an offset; the one that pairs most changes wins, unless another one
pairs more than half as many: a lamp that blinks evenly fits at every period. Where changes stay unpaired, or are
flashes that may fall between exposures, so many must fit that chance does not explain them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import poisson

from rigcal.geometry import Floats, Ints, freeze
from rigcal.sync.content.light.changes import LightChange

_CLEARLY = 2.0
"""How many times as many changes the best offset must pair as the second best."""
_CHANCE = 0.01
"""Probability of so many pairs at some offset, of changes that have nothing to do with each other."""
_ASIDE_S = 0.5  # changes this close to the ends of a recording may not be told
_ROUNDING_S = 1e-6
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


@dataclass(frozen=True, slots=True)
class Watched:
    """What one camera saw of the light, and when it was looking."""

    changes: tuple[LightChange, ...]
    start_s: float
    stop_s: float


def match_changes(reference: Watched, camera: Watched, *, within_s: float, search_s: float) -> Matching:
    """Pair the changes of a camera with the reference's.

    Args:
        reference: what the reference saw.
        camera: what the camera saw.
        within_s: how far from the offset the times of one change may be read: half a frame of either camera, and more.
        search_s: greatest offset that is searched.
    """
    ours, theirs = reference.changes, camera.changes
    offsets = np.array([r.t_s - c.t_s for r in ours for c in theirs if r.kind == c.kind])
    offsets = (
        np.sort(offsets[np.abs(offsets) <= search_s]) + within_s - _ROUNDING_S
    )  # each pair as the first of a window
    if not len(offsets):
        return unmatched(_nothing_common(reference, camera, search_s))
    pairings = [_pairs(ours, theirs, offset, within_s) for offset in offsets]
    counts = np.array([len(pairs) for pairs in pairings])
    spread = np.array([np.std([ours[r].t_s - theirs[c].t_s for r, c in pairs]) for pairs in pairings])
    best = int(np.lexsort((np.abs(offsets), spread, -counts))[0])  # of those that pair as many, the tightest
    pairs = pairings[best]
    reason = (
        _ambiguous(offsets, counts, best, within_s)
        or _chance(reference, camera, pairs, float(offsets[best]), within_s, len(offsets))
        or _faint([(ours[r], theirs[c]) for r, c in pairs])
    )
    offset_s = float(np.median([ours[r].t_s - theirs[c].t_s for r, c in pairs]))
    return Matching(pairs, offset_s, reason, offsets, min(len(ours), len(theirs)) - counts)


def _ambiguous(offsets: Floats, counts: Ints, best: int, within_s: float) -> str:
    """Why another offset may be the right one; empty where none fits half as well."""
    elsewhere = np.flatnonzero(np.abs(offsets - offsets[best]) > 2 * within_s)
    if not len(elsewhere) or counts[best] >= _CLEARLY * counts[elsewhere].max():
        return ""
    rival = int(elsewhere[np.argmax(counts[elsewhere])])
    return (
        f"the pattern of switching is ambiguous: {counts[best]} of the changes fit an offset of "
        f"{offsets[best]:+.2f} s, but {counts[rival]} fit {offsets[rival]:+.2f} s as well; "
        f"switch the light again, at uneven intervals"
    )


def _chance(
    reference: Watched,
    camera: Watched,
    pairs: Sequence[tuple[int, int]],
    offset_s: float,
    within_s: float,
    tried: int,
) -> str:
    """Why pairs may be chance; empty where they are not, or where each camera's every switching has its partner."""
    paired, theirs_paired = {r for r, _ in pairs}, {c for _, c in pairs}
    ours, theirs = reference.changes, camera.changes
    missing = [
        *(1 for r, x in enumerate(ours) if r not in paired and _watching(camera, x.t_s - offset_s, within_s)),
        *(
            1
            for c, x in enumerate(theirs)
            if c not in theirs_paired and _watching(reference, x.t_s + offset_s, within_s)
        ),
    ]
    switched = all(ours[r].kind in {"on", "off"} for r in paired)
    if not missing and (switched or len(pairs) == 1):
        return ""
    alike = sum(r.kind == c.kind for r in ours for c in theirs)
    expected = alike * 2 * within_s / (reference.stop_s - reference.start_s)
    if tried * poisson.sf(len(pairs) - 2, expected) < _CHANCE:
        return ""
    return (
        f"only {len(pairs)} of {len(ours)} changes in the reference and {len(theirs)} in this camera fit one offset, "
        f"which may be chance; switch a lamp that both see on and off, six times or more at uneven intervals"
    )


def _watching(camera: Watched, t_s: float, within_s: float) -> bool:
    """Whether a camera had looked well before a time, and still did well after it."""
    return camera.start_s + _ASIDE_S + within_s < t_s < camera.stop_s - _ASIDE_S - within_s


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


def _nothing_common(reference: Watched, camera: Watched, search_s: float) -> str:
    if not camera.changes:
        return (
            "this camera saw no sudden change of the light; switch a lamp that it sees fully on or off, or fire a flash"
        )
    if not reference.changes:
        return "the reference camera saw no sudden change of the light; switch a lamp that both cameras see"
    return (
        f"no change of this camera's light is within {search_s:g} s of one of the reference's; record both at the same "
        f"time, or search further"
    )
