"""Reading another tool's parsed file: every value knows the path of its entry, so that an error can name it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.camera import MODELS, Camera
from rigcal.errors import FormatEntryError
from rigcal.geometry import Floats, Pose

ROTATION_TOLERANCE = 1e-5
"""How far R R^T may be from the identity: six written decimals leave at most 3e-6; a scaled or sheared matrix far
more. The nearest rotation is taken."""
LARGEST_RVEC_RAD = 20.0
"""More than three turns: the vector is in degrees."""
LONGEST_SHOWN_VALUE = 100
"""Characters of a wrong value in an error message: about one line."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One value of a parsed JSON, TOML or YAML file."""

    file: Path
    name: str
    """Where it stands, such as ``cameras[0].K``; empty for the whole file."""
    value: Any

    def error(self, expected: str, got: object = None) -> FormatEntryError:
        """The exception for a value that is not ``expected``."""
        text = str(self.value if got is None else got)
        shown = text if len(text) <= LONGEST_SHOWN_VALUE else text[: LONGEST_SHOWN_VALUE - 3] + "..."
        return FormatEntryError(self.file, self.name, expected=expected, got=shown)

    def __contains__(self, key: str) -> bool:
        return key in self._table()

    def __getitem__(self, key: str) -> Entry:
        child = f"{self.name}.{key}" if self.name else key
        if key not in self._table():
            raise FormatEntryError(self.file, child, expected="this entry", got="nothing")
        return Entry(self.file, child, self.value[key])

    def get(self, key: str, default: Any) -> Entry:
        """An entry that may be absent."""
        return self[key] if key in self else Entry(self.file, key, default)

    def _table(self) -> dict[str, Any]:
        if not isinstance(self.value, dict):
            raise self.error("a table of named entries")
        return self.value

    def tables(self) -> Iterator[tuple[str, Entry]]:
        """The entries that are tables themselves, by key."""
        for key, value in self._table().items():
            if isinstance(value, dict):
                yield key, self[key]

    def elements(self) -> list[Entry]:
        """The elements of a list that is not empty."""
        if not isinstance(self.value, list) or not self.value:
            raise self.error("a list that is not empty")
        return [Entry(self.file, f"{self.name}[{index}]", value) for index, value in enumerate(self.value)]

    def text(self) -> str:
        """A text that is not empty."""
        if not isinstance(self.value, str) or not self.value:
            raise self.error("a text")
        return self.value

    def flag(self) -> bool:
        """A truth value."""
        if not isinstance(self.value, bool):
            raise self.error("true or false")
        return self.value

    def number(self) -> float:
        """A finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or not math.isfinite(self.value):
            raise self.error("a finite number")
        return float(self.value)

    def numbers(self, *counts: int) -> Floats:
        """A list of finite numbers, one of ``counts`` long where counts are given; a single row may be nested."""
        rows = self.value if isinstance(self.value, list) else [self.value]
        if len(rows) == 1 and isinstance(rows[0], list):
            return Entry(self.file, f"{self.name}[0]", rows[0]).numbers(*counts)
        if not isinstance(self.value, list) or (counts and len(rows) not in counts):
            wanted = " or ".join(str(count) for count in counts)
            raise self.error(f"a list of {wanted} numbers" if counts else "a list of numbers")
        return np.array([Entry(self.file, f"{self.name}[{i}]", row).number() for i, row in enumerate(rows)])

    def matrix(self, rows: int, columns: int) -> Floats:
        """A matrix, as a list of rows of finite numbers, or as all its numbers in one list row by row."""
        elements = self.elements()
        if columns > 1 and len(elements) == rows * columns and not isinstance(elements[0].value, list):
            return self.numbers(rows * columns).reshape(rows, columns)
        if len(elements) != rows:
            raise self.error(f"{rows} rows of {columns} numbers", f"{len(elements)} rows")
        return np.stack([element.numbers(columns) for element in elements])

    def size_wh(self) -> tuple[int, int]:
        """Image width and height, whole and positive (some tools write them as 1088.0)."""
        width, height = self.numbers(2).tolist()
        if min(width, height) <= 0 or width % 1 or height % 1:
            raise self.error("width and height in whole pixels")
        return int(width), int(height)

    def rotation(self) -> Floats:
        """(3, 3) rotation from a matrix, or from a rotation vector (Rodrigues) in radians."""
        rows = self.value if isinstance(self.value, list) else []
        if len(rows) > 1 and isinstance(rows[0], list) and len(rows[0]) > 1:
            return self.nearest_rotation(self.matrix(3, 3))
        is_column = len(rows) > 1 and isinstance(rows[0], list)
        rvec_rad = self.matrix(3, 1).ravel() if is_column else self.numbers(3)
        if np.abs(rvec_rad).max() > LARGEST_RVEC_RAD:
            raise self.error(f"a rotation vector in radians, of at most {LARGEST_RVEC_RAD:g}")
        return Pose.from_rvec(rvec_rad, np.zeros(3)).rotation

    def nearest_rotation(self, matrix: Floats) -> Floats:
        """The rotation nearest to a (3, 3) matrix of this entry, refused where the matrix is none."""
        if np.abs(matrix).max() > 2:
            raise self.error("a rotation matrix, of values from -1 to 1")
        error = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
        if error > ROTATION_TOLERANCE or np.linalg.det(matrix) < 0:
            got = f"R R^T off the identity by {error:.2g}, determinant {np.linalg.det(matrix):.4g}"
            raise self.error("a rotation matrix: orthonormal rows and determinant +1", got)
        u, _, vt = np.linalg.svd(matrix)
        return np.asarray(u @ vt)

    def focal_and_centre(self) -> Floats:
        """fx, fy, cx, cy of a camera matrix (3, 3) in pixels; a skew is refused, as no model here has one."""
        K = self.matrix(3, 3)
        if K[0, 1] or K[1, 0] or K[2].tolist() != [0.0, 0.0, 1.0]:
            raise self.error("[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
        return K[[0, 1, 0, 1], [0, 1, 2, 2]]

    def pose_matrix(self) -> Pose:
        """A pose from a homogeneous matrix (4, 4); the nearest rotation is taken."""
        matrix = self.matrix(4, 4)
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise self.error("a last row of 0, 0, 0, 1", matrix[3].tolist())
        return Pose(self.nearest_rotation(matrix[:3, :3]), matrix[:3, 3])

    def quaternion(self) -> Floats:
        """(4,) unit quaternion, in the order that the file has."""
        quaternion = self.numbers(4)
        length = math.hypot(*quaternion)
        if abs(length - 1) > ROTATION_TOLERANCE:
            raise self.error("a quaternion of length 1", f"length {length:.6g}")
        return quaternion

    def camera(self, model: str, size_wh: tuple[int, int], params: Floats) -> Camera:
        """A camera of this entry; focal lengths that are not positive are refused."""
        if min(params[:2]) <= 0:
            raise self.error("focal lengths above 0 px", params[:2].tolist())
        full = np.zeros(len(MODELS[model]))
        full[: len(params)] = params
        return Camera(model, size_wh, full)
