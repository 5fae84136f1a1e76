"""Where heads are in an image, and blurring them.

Everybody whom a network saw counts, tracked or not, with joints of any score: a disc too many hides a wall, one too
few shows a face. Nobody can hide whom no network saw; where a camera was not looked at for longer than
:data:`LOOKED_S`, the whole view is blurred.

Sizes are in units of a torso, from the middle of the shoulders to that of the hips, about 0.5 m of a grown person.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from operator import itemgetter
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from recognition.observations import ViewDetections
from recognition.recording.messages import known_points
from rigcal.geometry import Bools, Floats

HEAD, SHOULDERS, HIPS = slice(0, 5), slice(5, 7), slice(11, 13)
"""Joints of a skeleton."""
SURE = 0.3
"""Score from which on a joint of the head is believed to be where it is said to be."""
AT_JOINT, AT_SHOULDERS, AT_TOP = 0.5, 1.0, 0.7
"""Radii in torsos: of the disc at each joint of the head; around the shoulders where the head is not known, which
reaches beyond the crown whichever way somebody bends; and around the topmost joint where the shoulders are not
either, there in lengths of what is known of the body where that is longer."""
PER_GAP = 4.5
"""Torsos per median gap between joints of the head: 0.11 m on a grown head seen from the front."""
OF_BODY = 0.6
"""The longest torso by the head as a part of a body of which shoulders and hips are known; crouching, 0.8 m across."""
LEAST = 0.02
"""Least radius as a part of the image's height."""
HOLD_S = 0.3
"""Heads seen up to this long before or after a frame are blurred in it too: a network misses somebody now and then."""
LOOKED_S = 1.0
"""Without detections of a camera for this long, nothing is known of its heads."""
TORSOS_PER_S = 4.0
"""Growth of the discs with the time to the nearest detections: 2 m/s, a fast walk."""
CELLS = 5
"""A head is averaged to about so many cells across, fewer than any face can be told by."""
ROWS = 24
"""A whole view that is blurred has so many rows of cells."""
_FAR = 16_000.0
"""Pixels that OpenCV still draws."""
Disc: TypeAlias = tuple[float, float, float, float]
_HEADWEAR = frozenset({"hat", "helmet", "hard_hat", "hardhat", "head", "face"})


def head_discs(view: ViewDetections, size_wh: tuple[int, int]) -> Floats:
    """(D, 4) discs that hold the heads of everybody seen: x, y, radius and torso in pixels."""
    found = [disc for joints, score in zip(view.people_px, view.people_score, strict=True)
             for disc in person_discs(joints, score, size_wh)]  # fmt: skip
    for name, (left, top, right, bottom) in zip(view.object_class, view.object_xyxy.tolist(), strict=True):
        if name.lower() in _HEADWEAR:
            side = max(right - left, bottom - top)
            found.append(((left + right) / 2, top + 0.75 * side, 1.25 * side, 2.0 * side))
    return np.array(found, dtype=np.float64).reshape(-1, 4)


def person_discs(
    joints: Floats, score: Floats, size_wh: tuple[int, int]
) -> Iterator[tuple[float, float, float, float]]:
    """Discs that hold one person's head: x, y, radius, torso; of joints (17, 2) with scores (17,)."""
    known = known_points(joints)
    if not known.any():
        return
    torso, least = _torso_px(joints, known, size_wh), LEAST * size_wh[1]
    for x, y in joints[HEAD][known[HEAD]].tolist():
        yield x, y, max(AT_JOINT * torso, least), torso
    if (known[HEAD] & (score[HEAD] >= SURE)).any():
        return
    if known[SHOULDERS].any():
        x, y = joints[SHOULDERS][known[SHOULDERS]].mean(axis=0).tolist()
        yield x, y, max(AT_SHOULDERS * torso, least), torso
        return
    others = joints[known]
    x, y = others[np.argmin(others[:, 1])].tolist()
    reach = torso if known[HEAD].any() else max(torso, float(np.ptp(others, axis=0).max()))
    yield x, y, max(AT_TOP * reach, least), torso


def _torso_px(joints: Floats, known: Bools, size_wh: tuple[int, int]) -> float:
    """The longest that any part of the body lets the torso be; a part of the image where one joint is all."""
    has_torso = bool(known[SHOULDERS].any() and known[HIPS].any())
    extent = float(np.hypot(*np.ptp(joints[known], axis=0)))
    guesses = [(0.2 if has_torso else 0.3) * extent]  # with arms and legs spread a body is five torsos across
    if has_torso:
        middles = [joints[part][known[part]].mean(axis=0) for part in (SHOULDERS, HIPS)]
        guesses.append(float(np.linalg.norm(middles[0] - middles[1])))
    if known[SHOULDERS].all():
        guesses.append(1.3 * float(np.linalg.norm(joints[5] - joints[6])))
    if known[HEAD].sum() > 1:
        of_head = PER_GAP * float(np.median(pdist(joints[HEAD][known[HEAD]])))  # one ear elsewhere makes no giant
        guesses.append(min(of_head, OF_BODY * extent) if has_torso else of_head)
    return max(*guesses, 2 * LEAST * size_wh[1])


class Heads:
    """Where one camera's heads are at any time.

    Args:
        looks: When the camera was looked at (rig time in nanoseconds), and what was seen.
        size_wh: Of its images.
    """

    def __init__(self, looks: Iterable[tuple[int, ViewDetections]], size_wh: tuple[int, int]) -> None:
        found = sorted(((t_ns, head_discs(seen, size_wh)) for t_ns, seen in looks), key=itemgetter(0))
        self._times = [t_ns for t_ns, _ in found]
        self._discs = [discs for _, discs in found]

    def at(self, t_ns: int) -> Floats | None:
        """(D, 3) discs to blur in a frame of this time: x, y, radius in pixels.

        Heads seen within :data:`HOLD_S`. Where the very frame was not looked at, also those last and next seen, larger
        by how far somebody may have gone. None where that was longer ago than :data:`LOOKED_S`: nothing is known.
        """
        times, hold_ns = self._times, round(HOLD_S * 1e9)
        held = self._discs[bisect_left(times, t_ns - hold_ns) : bisect_right(times, t_ns + hold_ns)]
        discs = [each[:, :3] for each in held]
        at = bisect_left(times, t_ns)
        if at < len(times) and times[at] == t_ns:
            return np.concatenate(discs)
        around = [n for n in (at - 1, at) if 0 <= n < len(times) and abs(times[n] - t_ns) <= LOOKED_S * 1e9]
        if not around:
            return None
        for n in around:
            x, y, radius, torso = self._discs[n].T
            discs.append(np.stack([x, y, radius + torso * TORSOS_PER_S * abs(times[n] - t_ns) * 1e-9], axis=1))
        return np.concatenate(discs)


def blur(image_bgr: NDArray[np.uint8], discs: Floats) -> None:
    """Blur discs (D, 3) of an image (H, W, 3) in place: averages over cells, smoothed, of which nothing comes back.

    Cells are powers of two, so that the image is averaged a few times and not once for each of hundreds of discs.
    """
    height, width = image_bgr.shape[:2]
    known = discs[np.isfinite(discs).all(axis=1)]
    sizes = np.ceil(np.log2(np.maximum(2.0 * known[:, 2] / CELLS, 2.0))).astype(int)
    original = image_bgr.copy()
    for size in np.unique(sizes).tolist():
        mask = np.zeros((height, width), dtype=np.uint8)
        for x, y, radius in np.clip(known[sizes == size], -_FAR, _FAR).tolist():
            cv2.circle(mask, (round(x), round(y)), int(radius) + 1, 255, -1)
        cv2.copyTo(_averaged(original, 2**size), mask, image_bgr)


def blur_all(image_bgr: NDArray[np.uint8]) -> None:
    """Blur a whole image (H, W, 3) in place, so that nobody can be told."""
    image_bgr[:] = _averaged(image_bgr, max(2, image_bgr.shape[0] // ROWS))


def _averaged(image_bgr: NDArray[np.uint8], cell: int) -> NDArray[np.uint8]:
    """The image made of its averages over cells."""
    height, width = image_bgr.shape[:2]
    coarse_wh = max(1, width // cell), max(1, height // cell)
    coarse = cv2.resize(image_bgr, coarse_wh, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
