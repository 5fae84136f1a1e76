"""One view with what is known of it drawn over its image; coordinates are pixels of the view as it is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from recognition.observations import LIMBS, ViewDetections
from recognition.recording.messages import identity_color, known_points
from rigcal.geometry import Floats
from rigcal.rig import RigCamera

Image = NDArray[np.uint8]
Color = tuple[int, int, int]
"""Blue, green, red."""
WHITE, GREY, BLACK = (255, 255, 255), (160, 160, 160), (0, 0, 0)
AMBER, RED = (0, 150, 230), (40, 40, 210)
FONT = cv2.FONT_HERSHEY_SIMPLEX
OUTSIDE = 1.3
"""A lens model holds about as far as the image: points seen at more than this many times the angle of the image's
corner are not drawn, since its polynomial may turn back and put them inside."""


def track_color(track_id: int) -> Color:
    """The colour of an identity, the same as in the recording."""
    color = identity_color(track_id)
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
    (width, height), below = cv2.getTextSize(words, FONT, size, 1)
    x = int(np.clip(at[0], 2, max(2, image.shape[1] - width - 2)))
    y = int(np.clip(at[1], height + 2, max(height + 2, image.shape[0] - below)))
    ground = image[y - height - 2 : y + below, x - 2 : x + width + 2]
    ground //= 3
    cv2.putText(image, words, (x, y), FONT, size, color, 1, cv2.LINE_AA)


def skeleton(image: Image, joints: Floats, color: Color, *, thickness: int = 2) -> None:
    """The limbs and joints (17, 2) that are known."""
    known = known_points(joints)
    for one, other in LIMBS:
        if known[one] and known[other]:
            cv2.line(image, _whole(joints[one]), _whole(joints[other]), color, thickness, cv2.LINE_AA)
    for joint in joints[known]:
        cv2.circle(image, _whole(joint), thickness, color, -1, cv2.LINE_AA)


def worker(image: Image, joints: Floats, track_id: int) -> None:
    """A worker's joints (17, 2) and name."""
    known = joints[known_points(joints)]
    if not len(known) or not _inside(image, known):
        return
    skeleton(image, joints, track_color(track_id))
    x, y = known[np.argmin(known[:, 1])].tolist()
    text(image, f"worker {track_id}", (x - 20, y - 10), track_color(track_id))


def boxes(image: Image, shown: Shown, seen: ViewDetections, tracks: Sequence[int | None]) -> None:
    """Objects' boxes with class and identity; those without a track in grey."""
    for name, xyxy, track_id in zip(seen.object_class, seen.object_xyxy, tracks, strict=True):
        corners = shown.pixels(xyxy.reshape(2, 2))
        color = GREY if track_id is None else track_color(track_id)
        cv2.rectangle(image, _whole(corners[0]), _whole(corners[1]), color, 1, cv2.LINE_AA)
        text(image, name if track_id is None else f"{name} {track_id}", (corners[0, 0], corners[0, 1] - 3), color)


def carried(image: Image, point: Floats, name: str, track_id: int) -> None:
    """An object whose place (2,) is known, though this camera did not see it."""
    if np.isfinite(point).all() and _inside(image, point[None]):
        cv2.drawMarker(image, _whole(point), track_color(track_id), cv2.MARKER_DIAMOND, 10, 1, cv2.LINE_AA)
        text(image, f"{name} {track_id}", (float(point[0]) + 8, float(point[1])), track_color(track_id), size=0.4)


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
