"""Calibration boards: how they are written down, and where their corners lie.

The board frame has its origin at the first corner, x along the columns, y along the rows, z = 0 on the board
(right-handed, so z points away from a viewer who sees x to the right and y downwards). Lengths are metres.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import cv2
import numpy as np

from rigcal.errors import BoardSpecError
from rigcal.geometry import Floats

_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_SIZE_HELP = "a length with its unit: 25mm, 2.5cm or 0.025m"
_APRILTAG = {
    "tag16h5": "DICT_APRILTAG_16H5",
    "tag25h9": "DICT_APRILTAG_25H9",
    "tag36h10": "DICT_APRILTAG_36H10",
    "tag36h11": "DICT_APRILTAG_36H11",
}


@dataclass(frozen=True, slots=True)
class Checkerboard:
    """A checkerboard, counted in inner corners. Corner ``row * columns + column``."""

    columns: int
    """Inner corners along x."""
    rows: int
    """Inner corners along y."""
    square_size_m: float
    """Side of one square."""
    kind: ClassVar[str] = "checkerboard"

    @property
    def corners_in_board(self) -> Floats:
        """(N, 3) corners in metres."""
        return _grid(self.columns, self.rows, self.square_size_m)

    @property
    def spec(self) -> str:
        """The ``--board`` string of this board."""
        return f"checkerboard:{self.columns}x{self.rows}:{_length(self.square_size_m)}"

    @property
    def is_symmetric(self) -> bool:
        """Whether the board looks the same turned by 180 degrees, so that its corner order is ambiguous."""
        return (self.columns + self.rows) % 2 == 0


@dataclass(frozen=True, slots=True)
class Charuco:
    """A ChArUco board, counted in squares. Corner ids as in OpenCV: ``row * (columns - 1) + column``."""

    columns: int
    """Squares along x."""
    rows: int
    """Squares along y."""
    square_size_m: float
    """Side of one square."""
    marker_ratio: float = 0.75
    """Side of a marker over the side of a square."""
    dictionary: str = "DICT_4X4_1000"
    """OpenCV's name of the marker dictionary."""
    inverted: bool = False
    """Black and white exchanged when printed."""
    legacy: bool = False
    """Marker layout of OpenCV before 4.6 (differs for an even number of rows)."""
    kind: ClassVar[str] = "charuco"

    @property
    def corners_in_board(self) -> Floats:
        """(N, 3) inner chessboard corners in metres."""
        return _grid(self.columns - 1, self.rows - 1, self.square_size_m)

    @property
    def spec(self) -> str:
        """The ``--board`` string of this board."""
        parts = [
            f"charuco:{self.columns}x{self.rows}:{_length(self.square_size_m)}",
            f"marker={self.marker_ratio!r}",
            f"dict={self.dictionary}",
        ]
        return ":".join(parts + ["inverted"] * self.inverted + ["legacy"] * self.legacy)


@dataclass(frozen=True, slots=True)
class AprilGrid:
    """A Kalibr AprilGrid. Corner ``4 * tag + k``: tags row by row, k in the tag detector's corner order.

    With the tags upright, each row runs from right to left: so do the grids that Kalibr prints.
    """

    columns: int
    """Tags along x."""
    rows: int
    """Tags along y."""
    tag_size_m: float
    """Side of one tag, its black border included."""
    spacing: float = 0.3
    """Gap between tags over the side of a tag."""
    family: str = "tag36h11"
    """AprilTag family."""
    border_bits: int = 2
    """Width of a tag's black border in bits (Kalibr prints 2)."""
    kind: ClassVar[str] = "aprilgrid"

    @property
    def square_size_m(self) -> float:
        """Side of one tag."""
        return self.tag_size_m

    @property
    def corners_in_board(self) -> Floats:
        """(N, 3) tag corners in metres: per tag (0,0), (size,0), (size,size), (0,size)."""
        pitch = self.tag_size_m * (1 + self.spacing)
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        origin = np.stack([(self.columns - 1 - column) * pitch, row * pitch, np.zeros(len(row))], axis=-1)
        square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * self.tag_size_m
        return np.asarray((origin[:, None] + square[None]).reshape(-1, 3))

    @property
    def spec(self) -> str:
        """The ``--board`` string of this board."""
        text = (
            f"aprilgrid:{self.columns}x{self.rows}:{_length(self.tag_size_m)}"
            f":spacing={self.spacing!r}:family={self.family}"
        )
        return text + (f":border={self.border_bits}" if self.border_bits != 2 else "")

    @property
    def dictionary(self) -> str:
        """OpenCV's name of the tag dictionary."""
        return _APRILTAG[self.family]


Board: TypeAlias = Checkerboard | Charuco | AprilGrid


def parse_board(spec: str) -> Board:
    """Read a ``--board`` string.

    Raises:
        BoardSpecError: for an unknown kind, unit or option, or a count or size outside its range.
    """
    head, *rest = spec.strip().split(":")
    if head not in _KINDS:
        raise BoardSpecError(spec, problem=f"unknown kind {head!r}", expected="one of " + ", ".join(_KINDS))
    if len(rest) < 2:
        raise BoardSpecError(spec, problem="too short", expected="KIND:COLUMNSxROWS:SIZE")
    columns, rows = _counts(spec, rest[0])
    size_m = parse_length(rest[1], lambda problem: BoardSpecError(spec, problem=problem, expected=_SIZE_HELP))
    options = {name: value for name, _, value in (item.partition("=") for item in rest[2:])}
    board = _KINDS[head](spec, columns, rows, size_m, options)
    if options:
        raise BoardSpecError(
            spec, problem=f"unknown option {next(iter(options))!r}", expected=f"the options of {head} boards"
        )
    return board


def parse_length(text: str, error: Callable[[str], Exception]) -> float:
    """Metres of a length such as ``25mm``; ``error(problem)`` builds the exception for anything else."""
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*([A-Za-z\"']*)\s*", text)
    if match is None:
        raise error(f"{text!r} is not a length")
    number, unit = match.groups()
    if not unit:
        raise error(f"the size {text!r} has no unit")
    if unit not in _UNITS:
        raise error(f"unknown unit {unit!r} in {text!r}")
    if float(number) <= 0:
        raise error(f"the size {text!r} is not positive")
    return float(f"{float(number) * _UNITS[unit]:.12g}")


def _counts(spec: str, text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if match is None or min(int(v) for v in match.groups()) < 2:
        raise BoardSpecError(
            spec, problem=f"{text!r} is not COLUMNSxROWS", expected="two counts of at least 2, as in 9x6"
        )
    return int(match[1]), int(match[2])


def _ratio(spec: str, options: dict[str, str], name: str, default: float) -> float:
    text = options.pop(name, str(default))
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value < 1:
        raise BoardSpecError(spec, problem=f"{name}={text}", expected=f"{name} as a ratio between 0 and 1")
    return value


def _flag(spec: str, options: dict[str, str], name: str) -> bool:
    value = options.pop(name, None)
    if value:
        raise BoardSpecError(spec, problem=f"{name}={value}", expected=f"{name} without a value")
    return value is not None


def _checkerboard(spec: str, columns: int, rows: int, size_m: float, _options: dict[str, str]) -> Board:
    if min(columns, rows) < 3:
        raise BoardSpecError(spec, problem="too few inner corners", expected="at least 3x3 inner corners (4x4 squares)")
    return Checkerboard(columns, rows, size_m)


def _charuco(spec: str, columns: int, rows: int, size_m: float, options: dict[str, str]) -> Board:
    if min(columns, rows) < 3:
        raise BoardSpecError(spec, problem="too few squares", expected="at least 3x3 squares")
    ratio = _ratio(spec, options, "marker", 0.75)
    dictionary = options.pop("dict", "DICT_4X4_1000")
    if not dictionary.startswith("DICT_") or not hasattr(cv2.aruco, dictionary):
        raise BoardSpecError(
            spec,
            problem=f"unknown dictionary {dictionary!r}",
            expected="a dictionary of OpenCV, such as DICT_4X4_1000 or DICT_5X5_100",
        )
    _check_markers(spec, dictionary, columns * rows // 2)
    inverted, legacy = _flag(spec, options, "inverted"), _flag(spec, options, "legacy")
    return Charuco(columns, rows, size_m, ratio, dictionary, inverted, legacy)


def _aprilgrid(spec: str, columns: int, rows: int, size_m: float, options: dict[str, str]) -> Board:
    spacing = _ratio(spec, options, "spacing", 0.3)
    family = options.pop("family", "tag36h11")
    if family not in _APRILTAG:
        raise BoardSpecError(spec, problem=f"unknown family {family!r}", expected="one of " + ", ".join(_APRILTAG))
    _check_markers(spec, _APRILTAG[family], columns * rows)
    border = options.pop("border", "2")
    if border not in ("1", "2"):
        raise BoardSpecError(spec, problem=f"border={border}", expected="border=1 or border=2 (Kalibr)")
    return AprilGrid(columns, rows, size_m, spacing, family, int(border))


def _check_markers(spec: str, dictionary: str, needed: int) -> None:
    """Refuse a board with more markers than its dictionary has."""
    known = len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary)).bytesList)
    if needed > known:
        raise BoardSpecError(
            spec,
            problem=f"it needs {needed} markers, {dictionary} has {known}",
            expected="the dictionary that the board was printed with, or fewer columns and rows",
        )


_KINDS: Mapping[str, Callable[[str, int, int, float, dict[str, str]], Board]] = {
    "checkerboard": _checkerboard,
    "charuco": _charuco,
    "aprilgrid": _aprilgrid,
}


def board_to_dict(board: Board) -> dict[str, Any]:
    """The rig file's ``board`` entry."""
    entry: dict[str, Any] = {"kind": board.kind, "columns": board.columns, "rows": board.rows}
    match board:
        case Checkerboard():
            entry["square_size_m"] = board.square_size_m
        case Charuco():
            entry |= {
                "square_size_m": board.square_size_m,
                "marker_ratio": board.marker_ratio,
                "dictionary": board.dictionary,
                "inverted": board.inverted,
                "legacy": board.legacy,
            }
        case AprilGrid():
            entry |= {
                "tag_size_m": board.tag_size_m,
                "spacing": board.spacing,
                "family": board.family,
                "border_bits": board.border_bits,
            }
    return entry


def board_from_dict(entry: Mapping[str, Any]) -> Board:
    """The board of a rig file's ``board`` entry, which :func:`board_to_dict` made."""
    values = {name: value for name, value in entry.items() if name != "kind"}
    kinds: dict[str, Callable[..., Board]] = {
        "checkerboard": Checkerboard,
        "charuco": Charuco,
        "aprilgrid": AprilGrid,
    }
    return kinds[entry["kind"]](**values)


def _grid(columns: int, rows: int, step_m: float) -> Floats:
    row, column = np.divmod(np.arange(rows * columns), columns)
    return np.asarray(np.stack([column, row, np.zeros(len(row))], axis=-1) * step_m)


def _length(metres: float) -> str:
    return f"{float(f'{metres * 1e3:.9g}'):g}mm" if metres < 1 else f"{metres:g}m"
