"""COLMAP's model files, text or binary: both hold the same values in the same order.

After https://colmap.github.io/format.html; the binary layout is that of COLMAP 3.12 to 4.2 and was compared with
pycolmap's. Points and observations are passed over.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from rigcal.errors import FormatError
from rigcal.formats._colmap_lens import COEFFICIENTS
from rigcal.formats._source import Source

_CAMERA = "CAMERA"
_MODEL_OF_NUMBER = dict(
    enumerate(("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV"))
)
_Row = TypeVar("_Row")


@dataclass(frozen=True, slots=True)
class CameraRow:
    """A line of ``cameras``."""

    id: int
    """CAMERA_ID."""
    model: str
    """A name of :data:`rigcal.formats._colmap_lens.COEFFICIENTS`, or the file's own word for another."""
    size_wh: tuple[int, int]
    """Image width and height in pixels."""
    params: tuple[float, ...]
    """In COLMAP's order, cx and cy from the corner of the first pixel."""


@dataclass(frozen=True, slots=True)
class ImageRow:
    """A line of ``images``."""

    id: int
    """IMAGE_ID."""
    cam_from_world: tuple[float, ...]
    """qw qx qy qz tx ty tz."""
    camera_id: int
    """Of its :class:`CameraRow`."""
    name: str
    """The image's path, with / between folders."""


@dataclass(frozen=True, slots=True)
class RigRow:
    """A line of ``rigs``."""

    id: int
    """RIG_ID."""
    cam_from_rig: dict[int, tuple[float, ...] | None]
    """By camera id, as :attr:`ImageRow.cam_from_world`; None for the reference and where there is no pose."""


class _Reader(Protocol):
    """Takes one value after another; ValueError, IndexError or struct.error where there is none."""

    def integer(self, size: str) -> int: ...
    def reals(self, count: int) -> tuple[float, ...]: ...
    def sensor(self) -> int: ...


class _Words:
    def __init__(self, line: str) -> None:
        self.words = line.split()

    def integer(self, size: str) -> int:  # noqa: ARG002 (text has no sizes)
        return int(self.words.pop(0))

    def reals(self, count: int) -> tuple[float, ...]:
        return tuple(float(self.words.pop(0)) for _ in range(count))

    def sensor(self) -> int:
        if self.words.pop(0) != _CAMERA:
            raise ValueError("a sensor that is no camera")
        return self.integer("I")


class _Bytes:
    def __init__(self, data: bytes) -> None:
        self.data, self.offset = data, 0

    def integer(self, size: str) -> int:
        (value,) = struct.unpack_from("<" + size, self.data, self.offset)
        self.offset += struct.calcsize("<" + size)
        return int(value)

    def reals(self, count: int) -> tuple[float, ...]:
        values = struct.unpack_from(f"<{count}d", self.data, self.offset)
        self.offset += 8 * count
        return values

    def text(self) -> str:
        end = self.data.index(b"\0", self.offset)
        text = self.data[self.offset : end].decode("utf-8")
        self.offset = end + 1
        return text

    def skip(self, count: int) -> None:
        if self.offset + count > len(self.data):
            raise ValueError("the file ends early")
        self.offset += count

    def sensor(self) -> int:
        if self.integer("i") != 0:
            raise ValueError("a sensor that is no camera")
        return self.integer("I")


def camera_rows(source: Source) -> list[CameraRow]:
    """The cameras of a model.

    Raises:
        FormatError: where the file is damaged.
    """
    return _rows(source, "cameras", _camera_of_words, _camera_of_bytes)


def image_rows(source: Source) -> list[ImageRow]:
    """The images of a model; FormatError where the file is damaged."""
    return _rows(source, "images", _image_of_words, _image_of_bytes, lines_each=2)


def rig_rows(source: Source) -> list[RigRow]:
    """The rigs of a model; none where the model is older than rigs. FormatError where the file is damaged."""
    if not {"rigs.txt", "rigs.bin"} & set(source.files):
        return []
    return _rows(source, "rigs", _rig, _rig)


def _rows(
    source: Source,
    table: str,
    of_words: Callable[[_Words], _Row],
    of_bytes: Callable[[_Bytes], _Row],
    lines_each: int = 1,
) -> list[_Row]:
    name, place = f"{table}.bin", "the file"
    try:
        if name in source.files:
            reader = _Bytes(source.files[name])
            return [of_bytes(reader) for _ in range(reader.integer("Q"))]
        name = f"{table}.txt"
        rows = []
        lines = [(n, line) for n, line in enumerate(source.texts[name].splitlines(), 1) if not line.startswith("#")]
        while lines and not lines[-1][1].strip():
            lines.pop()
        for number, line in lines[::lines_each]:
            place = f"line {number}"
            rows.append(of_words(_Words(line)))
    except (ValueError, IndexError, struct.error) as error:
        raise _damaged(source.file(name), place, table, error) from error
    return rows


def _damaged(file: Path, place: str, table: str, error: Exception) -> FormatError:
    return FormatError(
        "this is not a COLMAP model file, or it is damaged",
        where=f"{file}, {place}",
        expected=f"{table} as COLMAP 3.12 or later writes them",
        got=error,
        do_next="write the model again with colmap model_converter",
    )


def _camera_of_words(words: _Words) -> CameraRow:
    camera_id, model = words.integer("I"), words.words.pop(0)
    size_wh = (words.integer("Q"), words.integer("Q"))
    return CameraRow(camera_id, model, size_wh, words.reals(len(words.words)))


def _camera_of_bytes(data: _Bytes) -> CameraRow:
    camera_id, number = data.integer("I"), data.integer("i")
    if number not in _MODEL_OF_NUMBER:
        raise ValueError(f"camera model number {number}; rigcal has " + ", ".join(COEFFICIENTS))
    model = _MODEL_OF_NUMBER[number]
    size_wh = (data.integer("Q"), data.integer("Q"))
    return CameraRow(camera_id, model, size_wh, data.reals(len(COEFFICIENTS[model])))


def _image_of_words(words: _Words) -> ImageRow:
    image_id, pose, camera_id = words.integer("I"), words.reals(7), words.integer("I")
    return ImageRow(image_id, pose, camera_id, " ".join(words.words))


def _image_of_bytes(data: _Bytes) -> ImageRow:
    row = ImageRow(data.integer("I"), data.reals(7), data.integer("I"), data.text())
    data.skip(24 * data.integer("Q"))  # per observation x, y and the point's id, 8 bytes each
    return row


def _rig(reader: _Reader) -> RigRow:
    rig_id, count = reader.integer("I"), reader.integer("I")
    poses: dict[int, tuple[float, ...] | None] = {}
    for index in range(count):
        camera_id = reader.sensor()
        poses[camera_id] = reader.reals(7) if index and reader.integer("B") else None
    return RigRow(rig_id, poses)
