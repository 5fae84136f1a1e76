"""One view with what is known of it drawn over its image; coordinates are pixels of the view as it is shown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from recognition.events import NO_MARKS, Marks, name_of
from recognition.observations import LIMBS, ViewDetections
from recognition.recording.messages import color_message, known_points, track_rgb
from rigcal.geometry import Floats
from rigcal.rig import RigCamera

Image = NDArray[np.uint8]
Color = tuple[int, int, int]
"""Blue, green, red."""
WHITE, GREY, BLACK = (255, 255, 255), (160, 160, 160), (0, 0, 0)
GROUND, AMBER, RED = (70, 70, 70), (0, 100, 185), (40, 40, 210)
"""Of bands: white words stand out from each."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
LEAST_LUMA = 150.0
"""Of letters; the blue of an identity has 80."""
LINE_PX, ASIDE = 17, 6
"""Height of a line of labels, and how many lines away from its place a label may be."""
OUTSIDE = 1.3
"""A lens model holds about as far as the image: points seen at more than this many times the angle of the image's
corner are not drawn, since its polynomial may turn back and put them inside."""


def track_color(kind: str, track_id: int, marks: Marks = NO_MARKS) -> Color:
    """The colour of an identity, or of violations for who is marked, the same as in the recording."""
    color = color_message(*track_rgb(kind, track_id, marks))
    return round(255 * color.b), round(255 * color.g), round(255 * color.r)


@dataclass(frozen=True, slots=True)
class Shown:
    """A camera as it is shown: smaller than it sees by ``scale``."""

    camera: RigCamera
    scale: float

    def pixels(self, pixels: ArrayLike) -> Floats:
        """(..., 2) where the camera's pixels (..., 2) are shown."""
        return np.asarray((np.asarray(pixels, dtype=np.float64) + 0.5) * self.scale - 0.5)

    def points(self, points_in_rig: Floats) -> Floats:
        """(..., 2) where points (..., 3) are shown; NaN for those that are not known, or far outside of the image."""
        in_cam = self.camera.cam_from_rig.apply(points_in_rig)
        lens = self.camera.camera
        pixels = lens.project(in_cam)
        width, height = lens.size_wh
        corners = lens.undistort(np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]))
        with np.errstate(invalid="ignore", divide="ignore"):
            angle = np.arctan2(np.linalg.norm(in_cam[..., :2], axis=-1), in_cam[..., 2])
        widest = OUTSIDE * float(np.arctan(np.linalg.norm(corners, axis=1)).max())
        return self.pixels(np.where((angle <= widest)[..., None], pixels, np.nan))


def text(image: Image, words: str, at: tuple[float, float], color: Color = WHITE, *, size: float = 0.45) -> None:
    """Words on a dark ground, their left lower corner at a point; kept inside of the image."""
    left, top, right, bottom = _ground(image, words, at, size)
    ground = image[top:bottom, left:right]
    ground //= 3
    below = cv2.getTextSize(words, FONT, size, 1)[1]
    cv2.putText(image, words, (left + 2, bottom - below), FONT, size, _readable(color), 1, cv2.LINE_AA)


@dataclass(frozen=True, slots=True)
class Label:
    """Words beside what they name."""

    words: str
    at: tuple[float, float]
    """Where their left lower corner should be."""
    color: Color
    size: float = 0.45


def write(image: Image, labels: Iterable[Label]) -> None:
    """Write labels so that none covers another: each at the free place nearest to its own, the first ones first.

    Where a crowd leaves none free within :data:`ASIDE` lines, a label is left out: what it names has its colour.
    """
    taken: list[tuple[int, int, int, int]] = []
    for label in labels:
        for lines in sorted(range(-ASIDE, ASIDE + 1), key=abs):
            at = label.at[0], label.at[1] + lines * LINE_PX
            place = _ground(image, label.words, at, label.size)
            if not any(_overlap(place, other) for other in taken):
                taken.append(place)
                text(image, label.words, at, label.color, size=label.size)
                break


def _ground(image: Image, words: str, at: tuple[float, float], size: float) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the ground of words, inside of the image."""
    (width, height), below = cv2.getTextSize(words, FONT, size, 1)
    x = int(max(2, min(at[0], image.shape[1] - width - 2)))
    y = int(max(height + 2, min(at[1], image.shape[0] - below)))
    return x - 2, y - height - 2, x + width + 2, y + below


def _overlap(one: tuple[int, int, int, int], other: tuple[int, int, int, int]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _readable(color: Color) -> Color:
    """The colour mixed with white until it stands out from the dark ground; luma as in ITU-R BT.601."""
    blue, green, red = color
    luma = 0.114 * blue + 0.587 * green + 0.299 * red
    white = float(np.clip((LEAST_LUMA - luma) / (255 - luma + 1e-9), 0.0, 1.0))
    return round(blue + white * (255 - blue)), round(green + white * (255 - green)), round(red + white * (255 - red))


def skeleton(image: Image, joints: Floats, color: Color, *, thickness: int = 2) -> None:
    """The limbs and joints (17, 2) that are known."""
    known = known_points(joints)
    for one, other in LIMBS:
        if known[one] and known[other]:
            cv2.line(image, _whole(joints[one]), _whole(joints[other]), color, thickness, cv2.LINE_AA)
    for joint in joints[known]:
        cv2.circle(image, _whole(joint), thickness, color, -1, cv2.LINE_AA)


def worker(image: Image, joints: Floats, track_id: int, marks: Marks = NO_MARKS) -> Iterator[Label]:
    """A worker's joints (17, 2); the name and what it violates, unless the worker is outside of the image."""
    known = joints[known_points(joints)]
    if not len(known) or not _inside(image, known):
        return
    color = track_color("worker", track_id, marks)
    skeleton(image, joints, color, thickness=3 if ("worker", track_id) in marks else 2)
    x, y = known[np.argmin(known[:, 1])].tolist()
    yield Label(name_of("worker", track_id, marks), (x - 20, y - 10), color)


def boxes(
    image: Image, shown: Shown, seen: ViewDetections, tracks: Sequence[int | None], marks: Marks = NO_MARKS
) -> Iterator[Label]:
    """Objects' boxes, those without a track in grey; their classes and identities."""
    for name, xyxy, track_id in zip(seen.object_class, seen.object_xyxy, tracks, strict=True):
        corners = shown.pixels(xyxy.reshape(2, 2))
        color = GREY if track_id is None else track_color(name, track_id, marks)
        thickness = 2 if (name, track_id) in marks else 1
        cv2.rectangle(image, _whole(corners[0]), _whole(corners[1]), color, thickness, cv2.LINE_AA)
        words = name if track_id is None else name_of(name, track_id, marks)
        yield Label(words, (float(corners[0, 0]), float(corners[0, 1]) - 3), color, 0.4)


def carried(image: Image, point: Floats, name: str, track_id: int, marks: Marks = NO_MARKS) -> Iterator[Label]:
    """An object whose place (2,) is known, though this camera did not see it; its name."""
    color = track_color(name, track_id, marks)
    if np.isfinite(point).all() and _inside(image, point[None]):
        cv2.drawMarker(image, _whole(point), color, cv2.MARKER_DIAMOND, 10, 1, cv2.LINE_AA)
        yield Label(name_of(name, track_id, marks), (float(point[0]) + 8, float(point[1])), color, 0.4)


def band(image: Image, words: str, color: Color) -> None:
    """White words on a coloured band over the whole width of an image."""
    image[:] = color
    size = 0.5
    (width, height), _ = cv2.getTextSize(words, FONT, size, 1)
    size *= min(1.0, (image.shape[1] - 12) / max(width, 1))
    cv2.putText(image, words, (6, (image.shape[0] + height) // 2), FONT, size, WHITE, 1, cv2.LINE_AA)


def _inside(image: Image, points: Floats) -> bool:
    height, width = image.shape[:2]
    return bool(((points >= 0).all(axis=1) & (points[:, 0] < width) & (points[:, 1] < height)).any())


def _whole(point: Floats) -> tuple[int, int]:
    x, y = np.clip(np.rint(point), -30_000, 30_000).astype(int).tolist()
    return x, y
