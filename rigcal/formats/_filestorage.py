"""OpenCV's FileStorage: its YAML, XML and JSON, read by OpenCV itself and written in its YAML 1.0."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rigcal.errors import FormatError
from rigcal.formats._entries import Entry
from rigcal.formats._yaml import list_text, quoted
from rigcal.geometry import Floats

HEADER = "%YAML:1.0\n---\n"
_MATRIX_KEYS = frozenset({"rows", "cols", "dt", "data"})
_STARTS = ("%YAML", "<?xml", "{")


def storage_values(text: str) -> dict[str, Any] | None:
    """The content of a storage as tables, lists, texts and numbers, or None where the text is none.

    A matrix becomes a list of rows, a vector (one row or one column) a list of numbers.
    """
    if not text.lstrip().startswith(_STARTS):
        return None
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        return {key: _value(root.getNode(key)) for key in root.keys()} if root.isMap() else None  # noqa: SIM118
    except (cv2.error, SystemError):  # OpenCV's constructor reports a parse error as a SystemError
        return None


def parsed_storage(file: Path, text: str) -> Entry:
    """A whole storage as one entry.

    Raises:
        FormatError: where OpenCV cannot read the text.
    """
    values = storage_values(text)
    if values is None:
        raise FormatError(
            "OpenCV cannot read this file",
            where=file,
            expected="a FileStorage: YAML that begins with %YAML:1.0, or OpenCV's XML or JSON",
            got=text[:40].splitlines()[0] if text else "an empty file",
            do_next="write the file again with cv2.FileStorage, or with the tool that made it",
        )
    return Entry(file, "", values)


def _value(node: cv2.FileNode) -> Any:
    if node.isMap():
        table = {key: _value(node.getNode(key)) for key in node.keys()}  # noqa: SIM118
        return _array(table) if _MATRIX_KEYS.issubset(table) else table
    if node.isSeq():
        return [_value(node.at(index)) for index in range(node.size())]
    if node.isString():
        return node.string()
    if node.isInt():
        return int(node.real())
    return node.real() if node.isReal() else None


def _array(table: dict[str, Any]) -> Any:
    """The rows of a well-formed matrix; anything else stays as it is, for the reader to name."""
    rows, columns, data = table["rows"], table["cols"], table["data"]
    if not (isinstance(rows, int) and isinstance(columns, int) and isinstance(data, list)):
        return table
    if min(rows, columns) < 1 or rows * columns != len(data):
        return table
    if 1 in (rows, columns):
        return data
    return [data[row * columns : (row + 1) * columns] for row in range(rows)]


def matrix_text(key: str, matrix: Floats | Sequence[float]) -> str:
    """One matrix; a vector is written as a row."""
    rows = np.atleast_2d(np.asarray(matrix, dtype=np.float64))
    lines = (
        f"{key}: !!opencv-matrix",
        f"   rows: {rows.shape[0]}",
        f"   cols: {rows.shape[1]}",
        "   dt: d",
        f"   data: {list_text(rows.ravel().tolist())}",
    )
    return "\n".join(lines) + "\n"


def names_text(key: str, names: Sequence[str]) -> str:
    """A list of texts in quotes, so that 01 stays a text and keeps its zero."""
    return f"{key}:\n" + "".join(f"   - {quoted(name)}\n" for name in names)
