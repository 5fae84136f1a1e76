"""Tables that a person writes: named points with their place in the world, and the pixels at which cameras see them.

Comma-separated text with a header line; columns beyond those named here are ignored::

    name,x_m,y_m,z_m               name,camera,u_px,v_px
    door,0.00,0.00,0.00            door,cam0,412.5,880.0
    pillar,4.20,0.00,0.00          door,cam2,1502.0,790.5
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from rigcal.errors import TableError
from rigcal.geometry import Floats

_POINTS, _PIXELS = ("name", "x_m", "y_m", "z_m"), ("name", "camera", "u_px", "v_px")
_EXAMPLES: Mapping[tuple[str, ...], str] = {_POINTS: "door,0.00,1.50,0.00", _PIXELS: "door,cam0,412.5,880.0"}


def read_points(path: Path) -> dict[str, Floats]:
    """Places (3,) in the world by name.

    Raises:
        TableError: for a table that cannot be read, a number that is none, or a name that repeats.
    """
    points: dict[str, Floats] = {}
    for line, row in _rows(path, _POINTS):
        if row[0] in points:
            raise _twice(path, line, f"point {row[0]}")
        points[row[0]] = _numbers(path, line, row[1:])
    return points


def read_pixels(path: Path, camera_ids: Sequence[str]) -> dict[str, dict[str, Floats]]:
    """Pixels (2,) by point and camera.

    Raises:
        TableError: for a table that cannot be read, a number that is none, a camera that the rig does not have, or a
            point given twice in one camera.
    """
    pixels: dict[str, dict[str, Floats]] = {}
    for line, (name, camera_id, *numbers) in _rows(path, _PIXELS):
        if camera_id not in camera_ids:
            raise TableError(
                path,
                problem=f"line {line} names a camera that the rig does not have",
                expected=f"one of {', '.join(camera_ids)}",
                got=repr(camera_id),
                do_next="write the camera as the rig file has it",
            )
        if camera_id in pixels.setdefault(name, {}):
            raise _twice(path, line, f"point {name} in camera {camera_id}")
        pixels[name][camera_id] = _numbers(path, line, numbers)
    return pixels


def _rows(path: Path, columns: tuple[str, ...]) -> Iterator[tuple[int, list[str]]]:
    """Line number and the text of these columns, for every line that is not empty."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        got = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise TableError(
            path,
            problem="this table cannot be read",
            expected=f"comma-separated text with the columns {', '.join(columns)}",
            got=got,
            do_next="check the path, and save the table as CSV",
        ) from error
    reader = csv.DictReader(text.splitlines())
    missing = [column for column in columns if column not in (reader.fieldnames or ())]
    if missing:
        raise TableError(
            path,
            problem=f"the table has no column {', '.join(missing)}",
            expected=f"a first line {','.join(columns)}",
            got=text.partition("\n")[0].strip() or "an empty file",
            do_next=f"write that first line, commas between, then lines like {_EXAMPLES[columns]}",
        )
    for row in reader:
        cells = [(row[column] or "").strip() for column in columns]
        if any(cells):
            yield reader.line_num, cells


def _numbers(path: Path, line: int, texts: Sequence[str]) -> Floats:
    try:
        values = [float(text) for text in texts]
    except ValueError:
        values = [math.nan]
    if not all(math.isfinite(value) for value in values):
        raise TableError(
            path,
            problem=f"line {line} holds something that is no number",
            expected="numbers with a decimal point, such as 1.25",
            got=", ".join(map(repr, texts)),
            do_next="mend that line",
        )
    return np.array(values)


def _twice(path: Path, line: int, what: str) -> TableError:
    return TableError(
        path,
        problem=f"line {line} gives {what} again",
        expected="one line for each",
        got=what,
        do_next="remove one of the two lines, or rename the point",
    )
