"""Files of one JSON object per line that are only ever appended to, by any process, and never rewritten."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

if sys.platform != "win32":
    import fcntl


@dataclass(frozen=True, slots=True)
class Lines:
    """What a file holds."""

    documents: tuple[dict[str, Any], ...]
    damaged: int
    """Lines that hold no JSON object."""


def append_line(path: Path, document: dict[str, Any]) -> None:
    """Add a line, whole and on the disk when this returns; a torn line that somebody left is closed before it.

    Raises:
        OSError: where the disk refuses.
    """
    data = json.dumps(document, ensure_ascii=False, allow_nan=False).encode() + b"\n"
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        if sys.platform != "win32":
            with contextlib.suppress(OSError):  # a file system without locks
                fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_size:
            os.lseek(handle, -1, os.SEEK_END)
            if os.read(handle, 1) != b"\n":
                data = b"\n" + data
        while data:
            data = data[os.write(handle, data) :]
        os.fsync(handle)
    finally:
        os.close(handle)


def read_lines(path: Path) -> Lines:
    """Everything that was appended; nothing where there is no file.

    Raises:
        OSError: where it cannot be read.
    """
    try:
        rows = path.read_bytes().split(b"\n")
    except FileNotFoundError:
        return Lines((), 0)
    whole = [_parsed(row) for row in rows[:-1] if row]  # somebody may be writing what follows the last line end
    documents = tuple(document for document in whole if isinstance(document, dict))
    return Lines(documents, len(whole) - len(documents))


def _parsed(row: bytes) -> Any:
    try:
        return json.loads(row)
    except ValueError:
        return None
