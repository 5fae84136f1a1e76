"""Films of a moving board by cameras whose clocks and shutters are known: exposure time, rows read one by one.

Each row of a picture is seen at its own time: the homography from the row's rays to the printed board is interpolated
between a few times of the readout. A picture is the mean over times within its exposure, which blurs what moves.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.board import Board
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig, RigCamera
from rigcal.stamps import TIMESTAMPS
from rigcal.sync.content.synthetic import CameraClock, Motion, stamps_of
from rigcal.synthetic import BoardTexture, GreyImage, draw_board, room_background

_KNOTS = 9  # times of a readout between which homographies are interpolated
_PLATE = 170  # grey of a board's back


@dataclass(frozen=True, slots=True)
class Shutter:
    """How pictures are taken."""

    exposure_s: float = 0.004
    sub_exposures: int = 4
    """Times within the exposure whose mean a picture is."""
    blur_px: float = 0.7
    """Sigma of the lens blur."""
    noise_dn: float = 2.0
    """Sigma of the sensor noise in grey levels."""


class Film:
    """Renders one camera's pictures of a moving board; the rays are computed once."""

    def __init__(self, member: RigCamera, board: Board, motion: Motion, shutter: Shutter, *, seed: int) -> None:
        self._member, self._motion, self._shutter = member, motion, shutter
        self._texture = draw_board(board)
        self._room = room_background(member.camera.size_wh, seed=seed).astype(np.float32)
        self._rng = np.random.default_rng(seed)
        width, height = member.camera.size_wh
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        self._rays = member.camera.undistort(grid).astype(np.float32)

    def picture(self, middle_s: float, readout_s: float) -> GreyImage:
        """(H, W) picture whose middle row is exposed about a rig time."""
        count, exposure_s = self._shutter.sub_exposures, self._shutter.exposure_s
        times = middle_s + ((np.arange(count) + 0.5) / count - 0.5) * exposure_s
        total = self._instant(float(times[0]), readout_s)
        for time in times[1:]:
            total += self._instant(float(time), readout_s)
        blurred = cv2.GaussianBlur(total / count, (0, 0), self._shutter.blur_px)
        noise = self._rng.standard_normal(blurred.shape, dtype=np.float32)
        noisy = np.rint(blurred + self._shutter.noise_dn * noise)
        return np.asarray(np.clip(noisy, 0, 255), dtype=np.uint8)

    def _instant(self, middle_s: float, readout_s: float) -> NDArray[np.float32]:
        """(H, W) grey levels without exposure time."""
        height = self._rays.shape[0]
        share = np.linspace(-0.5, 0.5, _KNOTS if readout_s else 1)
        poses = [self._member.cam_from_rig @ self._motion(middle_s + float(s) * readout_s) for s in share]
        box = self._box(poses)
        if box is None:
            return self._room.copy()
        left, top, right, bottom = box
        texture_from_ray = np.stack([_texture_from_ray(self._texture, pose) for pose in poses])
        row = np.arange(top, bottom) / (height - 1) - 0.5
        H = np.stack([np.interp(row, share, texture_from_ray[:, i, j]) for i in range(3) for j in range(3)])
        colour, inside = self._read(H.astype(np.float32)[:, :, None], self._rays[top:bottom, left:right], poses[0])
        image = self._room.copy()
        image[top:bottom, left:right] += inside * (colour - image[top:bottom, left:right])
        return image

    def _read(
        self, H: NDArray[np.float32], rays: NDArray[np.float32], pose: Pose
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Grey of the board where rays meet it, and whether they do; ``H`` (9, rows, 1) by rows of the matrix."""
        x, y = rays[..., 0], rays[..., 1]
        w = H[6] * x + H[7] * y + H[8]
        w = np.where(np.abs(w) < 1e-9, np.float32(1e-9), w)
        u, v = (H[0] * x + H[1] * y + H[2]) / w, (H[3] * x + H[4] * y + H[5]) / w
        shows_back = pose.rotation[:, 2] @ pose.translation_m < 0
        print_ = np.full_like(self._texture.image, _PLATE) if shows_back else self._texture.image
        ink = print_.astype(np.float32) * (200 / 255) + 25  # paper and ink under room light
        colour = cv2.remap(ink, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        inside = cv2.remap(np.ones_like(ink), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        return np.asarray(colour, dtype=np.float32), np.asarray(inside, dtype=np.float32)

    def _box(self, poses: list[Pose]) -> tuple[int, int, int, int] | None:
        """Left, top, right, bottom of what the board covers in one exposure; None where it is out of view."""
        height, width = self._texture.image.shape
        edge = np.linspace(0, 1, 9)
        sides = [np.stack([edge, np.full(9, s)], -1) for s in (0, 1)]
        border = np.concatenate([*sides, *(side[:, ::-1] for side in sides)])
        xy = border * [width, height] / self._texture.pixels_per_m + self._texture.origin_m
        points = np.concatenate([pose.apply(np.c_[xy, np.zeros(len(xy))]) for pose in (poses[0], poses[-1])])
        pixels = self._member.camera.project(points)
        if np.isnan(pixels).any():
            return None
        low, high = np.floor(pixels.min(axis=0)).astype(int) - 2, np.ceil(pixels.max(axis=0)).astype(int) + 3
        (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, self._member.camera.size_wh)
        return (int(left), int(top), int(right), int(bottom)) if left < right and top < bottom else None


def _texture_from_ray(texture: BoardTexture, cam_from_board: Pose) -> Floats:
    """(3, 3) from normalised image coordinates to pixels of the print."""
    plane = np.column_stack([cam_from_board.rotation[:, :2], cam_from_board.translation_m])
    x, y = texture.origin_m
    to_texture = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1 / texture.pixels_per_m]]) * texture.pixels_per_m
    return np.asarray(to_texture @ np.linalg.inv(plane))


def write_capture(
    folder: Path,
    rig: Rig,
    board: Board,
    motion: Motion,
    clocks: Mapping[str, CameraClock],
    *,
    seconds: float,
    fps: float = 30.0,
    shutter: Shutter = Shutter(),
    form: Literal["video", "images"] = "video",
    epoch_s: float = 0.0,
    seed: int = 0,
) -> None:
    """Film a board: one video or folder of images per camera that ``clocks`` names, and ``timestamps.csv``.

    Args:
        folder: Where to; made where it is not there.
        rig: The true rig, of any image size with even sides.
        board: The board.
        motion: Where the board is, by rig time from 0 on.
        clocks: The cameras that film, and their clocks.
        seconds: How long.
        fps: Frames per second of every camera, by its own clock.
        shutter: How pictures are taken.
        form: Videos (H.264), or a folder of PNG images per camera.
        epoch_s: Added to the stamps in the file.
        seed: Of the noise and the room.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, str]] = []
    for number, (camera_id, clock) in enumerate(clocks.items()):
        stamps = stamps_of(clock, seconds=seconds, fps=fps)
        film = Film(rig.camera(camera_id), board, motion, shutter, seed=seed + number)
        pictures = (film.picture(float(t), clock.readout_s) for t in clock.rig_s(stamps))
        if form == "video":
            _write_video(folder / f"{camera_id}.mp4", pictures, fps)
        else:
            _write_images(folder / camera_id, pictures)
        rows += [(camera_id, f"{epoch_s + stamp:.9f}") for stamp in stamps]
    with (folder / TIMESTAMPS).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("cam_id", "frame_time"), *rows])


def _write_video(path: Path, pictures: Iterator[GreyImage], fps: float) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
        stream.pix_fmt, stream.options = "yuv420p", {"preset": "veryfast", "crf": "17", "g": "30"}
        for index, picture in enumerate(pictures):
            height, width = picture.shape
            if not index:
                stream.width, stream.height = width, height
            planes = np.concatenate([picture, np.full((height // 2, width), 128, np.uint8)])
            frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _write_images(folder: Path, pictures: Iterator[GreyImage]) -> None:
    folder.mkdir(exist_ok=True)
    for index, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{index:06d}.png"), picture)
