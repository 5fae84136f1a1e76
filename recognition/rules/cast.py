"""Who and what is there at an instant, as rules see it: bodies with their points, heights, and those who were lost.

A point is a ball ``(x, y, z, radius)``: the place is known where the radius is 0, else it is somewhere within. A joint
that nobody sees is within the length of the bones to the nearest that is seen; a worker who was lost a second ago is
within two metres of where that was. So much of a condition can be decided although something is missing, and the rest
is unknown.

Decision: an object whose middle is known and whose keypoints are not has the usual size of its kind: a ladder stands
upright, a deck is a disc of 0.5 m whose top is twice as high as its middle, a window is a ball of 0.5 to 0.9 m. Its
conditions are then mostly true or false by an estimate, not unknown. On 12 validation sequences of SICSG,
site.rules.toml and bounds instead of estimates (0 to 2 m from the middle of a window, a deck of 0 to 1.5 m at any
height) leave `window` unknown for 21 % of the objects and instants, `platform` for 5, estimates (a window of 0.6 m) 8
and 0; F1 is 0.83 and 0.93, with estimates 0.95 and 0.95, and neither raises a false alarm more. A window of just 0.6 m
has its second carrier miss it where the middle is a little off: so it was for 28 instants of one more sequence, path
traced, which 0.5 to 0.9 m leave unknown, and of the others none is lost. The lengths are chosen by hand, a
window's with these sequences in view.

Decision: the bottom of a window is between where its keypoints and where its boxes have it, which are two measures: on
the same sequences the one is 0.28 m and the other 0.20 m off for one window in ten. A window that stands on the floor
by one of them is not known to be carried.

Decision: an object that the scene does not tell is not there for ``exists`` and ``count``, since the tracker tells an
object for half a second after it was seen; a worker stays for :data:`LOST_S`. Hidden people are the common reason of
false alarms: who holds the ladder stands behind it. That a hat is on no head is therefore only as sure as the cameras
are that would see it there: see ``visible(w.crown)``, and :data:`recognition.tracking.things.WEARING_VIEWS`. What they
do not see for :data:`OWN_S` does not count as a worker's own any more, though the tracker tells it.
"""

from __future__ import annotations

from math import dist, hypot, inf, isnan, nan, sqrt
from typing import TypeAlias

from recognition.observations import JOINTS, ObjectTrack, WorkerTrack
from recognition.rules.extents import Body
from recognition.rules.vocabulary import CROWN, Shape

Ball: TypeAlias = tuple[float, float, float, float]
"""x, y, z and radius in metres."""
Key: TypeAlias = tuple[str, int]
"""``worker`` or a class, and the track."""
WORKER = "worker"

JOINT_NUMBER = {name: number for number, name in enumerate(JOINTS)}
_NOWHERE: Ball = (0.0, 0.0, 0.0, inf)
_HEAD_PAIRS = ((3, 4), (1, 2))
_SHOULDERS, _HIPS, _ANKLES = (5, 6), (11, 12), (15, 16)
_TRUNK = (*_SHOULDERS, *_HIPS)
_HEAD = (0, 1, 2, 3, 4)
CROWN_M = 0.09
"""From the middle of the ears to that of a hard hat, away from the torso: 0.087 m in the median of the hats that are
worn in 8 validation sequences of SICSG, 0.075 to 0.100 m for 98 % of them."""
OWN_S = 0.12
"""What no camera has seen for longer is not ``of`` anybody. On 21 validation sequences of SICSG, 5 instants a second,
F1 of no_hat is 0.95 with this, 0.93 with 0.25 s, and one safe instant is called a violation with both: a hat that is
missed once in a while is held by ``for_s``."""
_MEMBERS = {"head": _HEAD, CROWN: _HEAD, "neck": _SHOULDERS, "torso": _TRUNK, "feet": _ANKLES}
"""Joints of each derived point."""
_BONES = (
    ((0, 1), 0.06), ((0, 2), 0.06), ((1, 2), 0.08), ((1, 3), 0.14), ((2, 4), 0.14), ((3, 4), 0.20),
    ((3, 5), 0.35), ((4, 6), 0.35), ((5, 6), 0.45), ((5, 7), 0.40), ((6, 8), 0.40), ((7, 9), 0.35), ((8, 10), 0.35),
    ((5, 11), 0.65), ((6, 12), 0.65), ((11, 12), 0.35), ((11, 13), 0.55), ((12, 14), 0.55), ((13, 15), 0.50),
    ((14, 16), 0.50),
)  # fmt: skip
"""Joints that hang together, and how far apart they can be, in metres, of a tall adult."""


def _reaches() -> tuple[tuple[tuple[float, int], ...], ...]:
    """Of each joint the others with how far it can be from each, the nearest first: the shortest way along bones."""
    count = len(JOINTS)
    far = [[0.0 if a == b else inf for b in range(count)] for a in range(count)]
    for (a, b), length_m in _BONES:
        far[a][b] = far[b][a] = length_m
    for middle in range(count):
        for a in range(count):
            for b in range(count):
                far[a][b] = min(far[a][b], far[a][middle] + far[middle][b])
    return tuple(tuple(sorted((far[a][b], b) for b in range(count) if b != a)) for a in range(count))


_REACHES = _reaches()
_SEGMENTS = (((13, 15), (14, 16), 0.246), ((11, 13), (12, 14), 0.245))
"""Shank and thigh of both sides, and their share of the body height (Drillis and Contini)."""
_TRUNK_SHARE, _NECK_SHARE, _LEAST_SHARE = 0.288, 0.107, 0.39
"""From the middle of the hips to that of the shoulders, and from there to the middle of the ears; and how much of the
height the segments in sight must make up: those two do, whose sum is 1.025 of what all make up in the median of 1658
workers and instants of 12 validation sequences of SICSG, 0.96 to 1.10 for nine of ten."""


class Person:
    """A worker at an instant."""

    __slots__ = ("_joints", "_points", "_views", "height_m", "key", "spread_m", "track")

    def __init__(self, track: WorkerTrack, joints_m: list[list[float]], spread_m: float = 0.0) -> None:
        self.key: Key = (WORKER, track.track_id)
        self.track = track
        self.height_m = nan
        """Of the body: the median of what its segments add up to; NaN before that was seen."""
        self.spread_m = spread_m
        """How far it can be from where it was last seen; 0 for one who is in the scene."""
        self._joints = joints_m
        self._points: dict[str, Ball] = {}
        self._views: list[int] | None = None

    @property
    def is_lost(self) -> bool:
        """Whether it is not in the scene any more."""
        return self.spread_m > 0.0

    def lost(self, spread_m: float) -> Person:
        """The same worker, unseen for a while."""
        gone = Person(self.track, self._joints, spread_m)
        gone.height_m = self.height_m
        return gone

    def views(self, point: str) -> int:
        """How many cameras see a point now: the most of its joints; 0 of one who is lost."""
        if self.is_lost:
            return 0
        if self._views is None:
            self._views = self.track.views.tolist()
        members = _MEMBERS.get(point)
        if members is None:
            return self._views[JOINT_NUMBER[point]]
        return max(self._views[joint] for joint in members)

    def point(self, name: str) -> Ball:
        """Where a point is."""
        found = self._points.get(name)
        if found is None:
            x, y, z, radius = self._derived(name)
            found = self._points[name] = (x, y, z, radius + self.spread_m)
        return found

    def _derived(self, name: str) -> Ball:
        if name == "head":
            return self._head()
        if name == CROWN:
            return self._crown()
        members = _MEMBERS.get(name)
        if members is None:
            return self._joint(JOINT_NUMBER[name])
        balls = [self._joint(joint) for joint in members]
        count = len(balls)
        return (
            sum(ball[0] for ball in balls) / count,
            sum(ball[1] for ball in balls) / count,
            sum(ball[2] for ball in balls) / count,
            sum(ball[3] for ball in balls) / count,
        )

    def _head(self) -> Ball:
        joints = self._joints
        for left, right in _HEAD_PAIRS:
            (ax, ay, az), (bx, by, bz) = joints[left], joints[right]
            if not isnan(ax + bx):
                return (ax + bx) / 2, (ay + by) / 2, (az + bz) / 2, 0.0
        for joint in _HEAD:
            x, y, z = joints[joint]
            if not isnan(x):
                return x, y, z, 0.0
        return self._around(_HEAD[0])

    def _crown(self) -> Ball:
        """Over the head, away from the torso, else from the neck; where neither is known, anywhere around the head."""
        x, y, z, radius = self._head()
        for below in ("torso", "neck"):
            bx, by, bz, unsure = self.point(below)
            height = dist((x, y, z), (bx, by, bz))
            if radius == unsure == 0.0 < height:
                share = CROWN_M / height
                return x + share * (x - bx), y + share * (y - by), z + share * (z - bz), 0.0
        return x, y, z, radius + CROWN_M

    def _joint(self, joint: int) -> Ball:
        x, y, z = self._joints[joint]
        return (x, y, z, 0.0) if not isnan(x) else self._around(joint)

    def _around(self, joint: int) -> Ball:
        """Around the known joint that holds a joint best."""
        for reach_m, held_by in _REACHES[joint]:
            x, y, z = self._joints[held_by]
            if not isnan(x):
                return x, y, z, reach_m
        return _NOWHERE

    def measured_height_m(self) -> float:
        """The height that the segments in sight make up; NaN where too few are."""
        joints, total, share = self._joints, 0.0, 0.0
        for left, right, part in _SEGMENTS:
            a = dist(joints[left[0]], joints[left[1]])
            b = dist(joints[right[0]], joints[right[1]])
            length = (a + b) / 2 if not isnan(a + b) else a if not isnan(a) else b
            if not isnan(length):
                total, share = total + length, share + part
        shoulders = _middle(joints[5], joints[6])
        trunk = dist(shoulders, _middle(joints[11], joints[12]))
        if not isnan(trunk):
            total, share = total + trunk, share + _TRUNK_SHARE
        neck = dist(shoulders, _middle(joints[3], joints[4]))
        if not isnan(neck):
            total, share = total + neck, share + _NECK_SHARE
        return total / share if share >= _LEAST_SHARE else nan


class Thing:
    """An object at an instant."""

    __slots__ = ("body", "key", "middle", "shape", "size_m", "track", "unseen_s")

    def __init__(self, track: ObjectTrack, shape: Shape, middle: list[float]) -> None:
        self.key: Key = (track.object_class, track.track_id)
        self.track = track
        self.shape = shape
        x, y, z = middle
        self.middle: Ball = _NOWHERE if isnan(x) else (x, y, z, 0.0)
        self.body: Body | None = None
        """What its keypoints tell; None where they tell too little."""
        self.size_m = track.size_m
        """Width and height of its boxes, the last that were seen; NaN where none was."""
        self.unseen_s = 0.0
        """For how long no camera has seen it."""

    def point(self, name: str) -> Ball:
        """``centre`` or ``bottom``."""
        if name == "centre":
            return self.middle
        x, y, z, radius = self.middle
        by_box_m = z - self.size_m[1] / 2
        if self.body is not None and self.shape == "pane":
            x, y, z = self.body.bottom
            return (x, y, z, 0.0) if isnan(by_box_m) else (x, y, (z + by_box_m) / 2, abs(z - by_box_m) / 2)
        return (x, y, z, radius + _SMALL_M) if isnan(by_box_m) else (x, y, by_box_m, radius)

    def views(self, _point: str) -> int:
        """How many cameras see it now."""
        return self.track.views

    def extent_m(self, ball: Ball) -> tuple[float, float]:
        """How far a point is from its extent: at least, and at most."""
        x, y, z, radius = ball
        if self.body is not None and self.body.board is not None:
            away = self.body.board.distance_m(x, y, z)
            return (away - radius if away > radius else 0.0), away + radius
        cx, cy, cz, unsure = self.middle
        away, radius = sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2), radius + unsure
        if self.shape == "plain":
            half = max(self.size_m) / 2
            away, radius = (max(0.0, away - half), radius) if not isnan(half) else (away, radius + _SMALL_M)
            return max(0.0, away - radius), away + radius
        half, spread = _HALF_M[self.shape]
        away -= half
        return max(0.0, away - spread - radius), max(0.0, away + spread) + radius


_HALF_M: dict[Shape, tuple[float, float]] = {"ladder": (0.6, 0.0), "deck": (0.6, 0.0), "pane": (0.7, 0.2)}
"""Where its keypoints are not known, an object is a ball of the first radius around its middle, more or less the
second. Large windows have half sides of 0.63 to 0.93 m in the validation scenes."""
_SMALL_M = 0.5
"""What has no keypoints and no known box reaches no farther than this."""


def _middle(a: list[float], b: list[float]) -> tuple[float, float, float]:
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2


def level_m(a: Ball, b: Ball) -> float:
    """Distance of two balls' middles on the plan."""
    return hypot(a[0] - b[0], a[1] - b[1])
