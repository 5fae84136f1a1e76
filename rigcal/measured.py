"""Lengths that a person measured by hand and wrote down: with a unit, and as precise as they were written."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rigcal.board import parse_length
from rigcal.errors import MeasuredLengthError

_NUMBER = re.compile(r"\s*(\d*(?:\.(\d+))?(?:[eE]([-+]?\d+))?)")


@dataclass(frozen=True, slots=True)
class MeasuredLength:
    """A length as a person wrote it down."""

    text: str
    """As it was given: ``2.41m``."""
    length_m: float
    sigma_m: float
    """Half a unit of the last digit that was written."""


@dataclass(frozen=True, slots=True)
class MeasuredDistance:
    """A tape between two cameras, from the middle of one lens to the middle of the other."""

    cameras: tuple[str, str]
    length: MeasuredLength

    @property
    def spec(self) -> str:
        """As it is written on the command line: ``cam0,cam1:2.41m``."""
        return f"{','.join(self.cameras)}:{self.length.text}"


def parse_measured_length(text: str, option: str) -> MeasuredLength:
    """A length with its unit, such as ``59.6mm``; ``option`` is named where it cannot be read.

    Raises:
        MeasuredLengthError: for anything else.
    """
    length_m = parse_length(text, lambda problem: MeasuredLengthError(option, text, problem=problem))
    number, decimals, exponent = _NUMBER.match(text).groups()  # type: ignore[union-attr]  # parse_length read it
    step = 0.5 * 10.0 ** (int(exponent or 0) - len(decimals or ""))
    return MeasuredLength(text.strip(), length_m, step * length_m / float(number))


def require_cameras(distances: Sequence[MeasuredDistance], camera_ids: Sequence[str]) -> None:
    """Refuse distances to cameras that a capture does not have.

    Raises:
        MeasuredLengthError: naming them, and the cameras that there are.
    """
    for distance in distances:
        if unknown := [camera for camera in distance.cameras if camera not in camera_ids]:
            problem = f"there is no camera {' or '.join(unknown)}; the cameras are {', '.join(camera_ids)}"
            raise MeasuredLengthError("--distance", distance.spec, problem=problem)


def parse_distance(text: str) -> MeasuredDistance:
    """A distance between two cameras as the command line has it: ``cam0,cam1:2.41m``.

    Raises:
        MeasuredLengthError: where it is not of that form.
    """
    names, colon, length = text.rpartition(":")
    cameras = [name.strip() for name in names.split(",")]
    if not colon or len(cameras) != 2 or not all(cameras):
        raise MeasuredLengthError("--distance", text, problem=f"{text!r} is not CAMERA,CAMERA:LENGTH")
    return measured_distance((cameras[0], cameras[1]), length, "--distance")


def measured_distance(cameras: tuple[str, str], length: str, option: str) -> MeasuredDistance:
    """A distance between two cameras.

    Raises:
        MeasuredLengthError: for twice the same camera, or a length that cannot be read.
    """
    if cameras[0] == cameras[1]:
        raise MeasuredLengthError(option, f"{','.join(cameras)}:{length}", problem=f"both ends are camera {cameras[0]}")
    return MeasuredDistance(cameras, parse_measured_length(length, option))
