"""Captures on disk: a folder of images per camera, one video per camera, or flat images named camera then number.

Opening a capture lists it and reads only headers; images are decoded when they are asked for, one at a time. Pixels are
as stored: rotation notes in image or video headers are not applied, since a lens belongs to the sensor's own rows.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import av
import av.error
import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.errors import BrokenFileError, CaptureError, EmptyCaptureError, ImageSizeError

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"})
VIDEO_SUFFIXES = frozenset({".mp4", ".mkv", ".avi", ".mov"})
_FLAT_NAME = re.compile(r"(?P<camera>.+?)[_-]?(?P<frame>\d{8}T\d{6}(?:\.\d+)?Z|\d+)$")


@dataclass(frozen=True, slots=True)
class CaptureCamera:
    """One camera's images or video."""

    id: str
    kind: Literal["images", "video"]
    paths: tuple[Path, ...]
    """Its images in natural order, or its one video."""
    frames: tuple[str, ...]
    """A name per frame: an image's stem, or a video's frame number with six digits."""
    size_wh: tuple[int, int]
    """Width and height in pixels: of the video, or of the first image."""
    fps: float | None = None
    """Declared frame rate of a video; None for images."""
    times_s: tuple[float, ...] = ()
    """Presentation time of each frame of a video in seconds; empty for images."""


@dataclass(frozen=True, slots=True)
class Capture:
    """The cameras of a capture folder, in rig order; the first is the reference."""

    path: Path
    cameras: tuple[CaptureCamera, ...]

    def digest(self, sha256: Mapping[Path, str] | None = None) -> str:
        """SHA-256 over every file's content, in order, hexadecimal; reads those that ``sha256`` does not know."""
        known = sha256 or {}
        total = hashlib.sha256()
        for camera in self.cameras:
            for path in camera.paths:
                total.update(f"{camera.id}/{path.name}\n".encode())
                total.update((known.get(path) or file_sha256(path)).encode())
        return total.hexdigest()


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's content, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def natural_key(name: str) -> tuple[Any, ...]:
    """Sorts ``cam2`` before ``cam10``."""
    return tuple((1, int(part), "") if part.isdigit() else (0, 0, part.lower()) for part in re.split(r"(\d+)", name))


def open_capture(path: Path, *, camera_order: Sequence[str] | None = None) -> Capture:
    """List a capture folder.

    Args:
        path: The folder.
        camera_order: Identifiers in rig order, as a site file has them; natural order when None.

    Raises:
        EmptyCaptureError: where there are no cameras.
        CaptureError: where the folder mixes forms, or ``camera_order`` names other cameras.
        BrokenFileError: where a video or a camera's first image cannot be read.
    """
    if not path.is_dir():
        raise EmptyCaptureError(path, got="no such folder" if not path.exists() else "a file")
    cameras = _folders(path) or _videos(path) or _flat_images(path)
    if not cameras:
        raise EmptyCaptureError(path, got=_listing(path))
    cameras = sorted(cameras, key=lambda camera: natural_key(camera.id))
    return Capture(path, tuple(_ordered(path, cameras, camera_order) if camera_order else cameras))


def read_frames(
    camera: CaptureCamera, *, wanted: Set[int] | None = None, colour: bool = False
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Frames of a camera in order: (index, image (H, W) grey or (H, W, 3) BGR), 8 bits a channel.

    Args:
        camera: the camera.
        wanted: indices of the frames to give, all when None; a video is decoded up to the last of them, but only they
            are turned into images.
        colour: BGR instead of grey.

    Raises:
        BrokenFileError: where an image cannot be decoded, or a video ends before its last frame.
        ImageSizeError: where an image has another size than the first.
    """
    frames = range(len(camera.frames)) if wanted is None else sorted(wanted)
    if camera.kind == "video":
        yield from _video_frames(camera, frames, colour)
        return
    for index in frames:
        yield index, read_image(camera, camera.paths[index], colour=colour)


def read_frames_at(
    camera: CaptureCamera, frame_idx: Sequence[int], *, colour: bool = False
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """A few frames of a camera, ascending; of a video, only what lies between each and the key frame before it.

    Raises:
        BrokenFileError: where one of them cannot be decoded.
        ImageSizeError: where an image has another size than the first.
    """
    wanted = sorted(set(frame_idx))
    if camera.kind == "video":
        found = _sought_frames(camera, wanted, colour)
        yield from found or _video_frames(camera, wanted, colour)
        return
    for index in wanted:
        yield index, read_image(camera, camera.paths[index], colour=colour)


def read_image(camera: CaptureCamera, path: Path, *, colour: bool = False) -> NDArray[np.uint8]:
    """One image of a camera, (H, W) grey or (H, W, 3) BGR; 16 bits are reduced to 8.

    Raises:
        BrokenFileError: where it cannot be decoded.
        ImageSizeError: where it has another size than the camera's first image.
    """
    image = _decoded(path, path.read_bytes(), colour)
    height, width = image.shape[:2]
    if (width, height) != camera.size_wh:
        raise ImageSizeError(
            camera.id, where=path, expected_wh=camera.size_wh, got_wh=(width, height), source=camera.paths[0].name
        )
    return image


def decode_image(content: bytes, suffix: str, *, colour: bool = False) -> NDArray[np.uint8]:
    """The image in a file's content, (H, W) grey or (H, W, 3) BGR; 16 bits are reduced to 8.

    Args:
        content: of the file.
        suffix: of its name, lower case: ``.jpg``, ``.png``, ...
        colour: BGR instead of grey.

    Raises:
        ValueError: where it is no whole image; says what it is.
    """
    flags = (cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE) | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags) if content else None
    if image is None or not _is_whole(suffix, content):
        raise ValueError("an empty file" if not content else "a truncated image" if image is not None else "no image")
    if image.dtype == np.uint16:
        image = cv2.convertScaleAbs(image, alpha=1 / 257)
    return np.asarray(image, dtype=np.uint8)


def _decoded(path: Path, content: bytes, colour: bool) -> NDArray[np.uint8]:
    try:
        return decode_image(content, path.suffix.lower(), colour=colour)
    except ValueError as error:
        raise BrokenFileError(path, expected="an image", got=str(error)) from error


def _is_whole(suffix: str, content: bytes) -> bool:
    """Whether a JPEG or PNG has its end marker: OpenCV decodes the rest as grey without a word."""
    if suffix in (".jpg", ".jpeg"):
        return b"\xff\xd9" in content[-4096:]
    if suffix == ".png":
        return b"IEND" in content[-64:]
    return True


def _video_frames(
    camera: CaptureCamera, wanted: Sequence[int], colour: bool
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Frames of a video, decoded in order up to the last wanted one."""
    path, form, total = camera.paths[0], "bgr24" if colour else "gray", len(camera.frames)
    kept, given, seen = frozenset(wanted), 0, 0
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            index_of = _index_of_tick(path) if len(kept) < total else {}
            for index, frame in _needed_frames(container, stream, index_of, kept):
                seen = index + 1
                if index in kept:
                    given += 1
                    yield index, np.asarray(frame.to_ndarray(format=form), dtype=np.uint8)
                    if given == len(kept) < total:
                        return
    except av.error.FFmpegError as error:
        raise BrokenFileError(path, expected=f"{total} frames", got=f"{seen} frames, {error}") from error
    if given != len(kept) or seen > total:
        raise BrokenFileError(path, expected=f"{total} frames", got=f"{seen} frames")


def _needed_frames(
    container: av.container.InputContainer, stream: av.VideoStream, index_of: Mapping[int, int], wanted: Set[int]
) -> Iterator[tuple[int, av.VideoFrame]]:
    """Frames and their index, all of them where ``index_of`` is empty; else without those that are not wanted and that
    no other frame refers to: a third of the decoder's time where a video has such frames, and none otherwise."""
    if not index_of:
        yield from enumerate(container.decode(stream))
        return
    for packet in container.demux(stream):
        unwanted = packet.pts is not None and index_of.get(packet.pts) not in wanted
        stream.codec_context.skip_frame = "NONREF" if unwanted else "DEFAULT"
        for frame in packet.decode():
            if frame.pts is not None and frame.pts in index_of:
                yield index_of[frame.pts], frame


def _index_of_tick(path: Path) -> dict[int, int]:
    """Index of the frame by its presentation time in the stream's time base; empty where packets do not say it."""
    with av.open(str(path)) as container:
        ticks = [packet.pts for packet in container.demux(container.streams.video[0]) if packet.size]
    known = sorted(tick for tick in ticks if tick is not None)
    return {tick: index for index, tick in enumerate(known)} if len(set(known)) == len(ticks) else {}


def _sought_frames(
    camera: CaptureCamera, frame_idx: Sequence[int], colour: bool
) -> list[tuple[int, NDArray[np.uint8]]]:
    """These frames of a video by their times; none of them where one is not found at its time."""
    found, form = [], "bgr24" if colour else "gray"
    try:
        with av.open(str(camera.paths[0])) as container:
            stream = container.streams.video[0]
            ticks = _ticks(container, stream)
            for index in frame_idx:
                container.seek(ticks[index], stream=stream)
                frame = next((f for f in container.decode(stream) if f.pts is None or f.pts >= ticks[index]), None)
                if frame is None or frame.pts != ticks[index]:
                    return []
                found.append((index, np.asarray(frame.to_ndarray(format=form), dtype=np.uint8)))
    except av.error.FFmpegError:
        return []
    return found


def _folders(path: Path) -> list[CaptureCamera]:
    found = []
    for folder in path.iterdir():
        images = _images_in(folder) if folder.is_dir() and not folder.name.startswith(".") else []
        if images:
            found.append(_image_camera(folder.name, images))
    return found


def _flat_images(path: Path) -> list[CaptureCamera]:
    by_camera: dict[str, list[Path]] = {}
    for image in _images_in(path):
        match = _FLAT_NAME.match(image.stem)
        if match:
            by_camera.setdefault(match["camera"], []).append(image)
    return [_image_camera(camera_id, images) for camera_id, images in by_camera.items()]


def _images_in(folder: Path) -> list[Path]:
    images = [
        p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith(".") and p.is_file()
    ]
    return sorted(images, key=lambda image: natural_key(image.name))


def _image_camera(camera_id: str, images: Sequence[Path]) -> CaptureCamera:
    height, width = _decoded(images[0], images[0].read_bytes(), False).shape[:2]
    return CaptureCamera(camera_id, "images", tuple(images), tuple(image.stem for image in images), (width, height))


def _videos(path: Path) -> list[CaptureCamera]:
    videos = [p for p in path.iterdir() if p.suffix.lower() in VIDEO_SUFFIXES and not p.name.startswith(".")]
    names = [video.stem for video in videos]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise CaptureError(
            f"camera {repeated[0]} has two videos",
            where=path,
            expected="one video per camera",
            got=", ".join(sorted(video.name for video in videos if video.stem == repeated[0])),
            do_next="keep the one that belongs to this capture",
        )
    return [_video_camera(video) for video in videos]


def _video_camera(path: Path) -> CaptureCamera:
    """Frames are counted from the container's packets; nothing is decoded."""
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise BrokenFileError(path, expected="a video stream", got="none")
            stream = container.streams.video[0]
            ticks = _ticks(container, stream)
            size_wh = (stream.codec_context.width, stream.codec_context.height)
            rate = stream.average_rate or stream.guessed_rate
            base = stream.time_base
    except av.error.FFmpegError as error:
        raise BrokenFileError(path, expected="a video", got=str(error)) from error
    if not ticks or base is None:
        raise BrokenFileError(path, expected="at least one frame", got="0 frames")
    times_s = tuple(float((tick - ticks[0]) * base) for tick in ticks)
    names = tuple(f"{index:06d}" for index in range(len(ticks)))
    return CaptureCamera(path.stem, "video", (path,), names, size_wh, float(rate) if rate else None, times_s)


def _ticks(container: av.container.InputContainer, stream: av.VideoStream) -> list[int]:
    """Presentation time of every frame in the stream's time base, ascending."""
    return sorted(t for p in container.demux(stream) if p.size and (t := _tick(p)) is not None)


def _tick(packet: av.Packet[Any]) -> int | None:
    return packet.pts if packet.pts is not None else packet.dts


def _ordered(path: Path, cameras: Sequence[CaptureCamera], order: Sequence[str]) -> list[CaptureCamera]:
    by_id = {camera.id: camera for camera in cameras}
    if set(order) != set(by_id):
        raise CaptureError(
            "the capture has other cameras than the site file",
            where=path,
            expected=", ".join(order),
            got=", ".join(by_id),
            do_next="name the folders or videos as the site file names the cameras, or mend the site file",
        )
    return [by_id[camera_id] for camera_id in order]


def _listing(path: Path) -> str:
    names = sorted((entry.name + "/" * entry.is_dir() for entry in path.iterdir()), key=natural_key)
    shown = ", ".join(names[:5])
    return f"{shown} and {len(names) - 5} more" if len(names) > 5 else shown or "an empty folder"
