"""What waits to be delivered, on disk: a file of lines that is only appended to, and now and then written anew.

A line is a checksum and a JSON object: ``{"put": 7, "id": ..., "body": ...}`` for a message that came to wait,
``{"done": [7]}`` for those that wait no more. A process that is killed leaves a whole file or a last line that is torn,
which a reader drops; a line that is damaged elsewhere is dropped too, and counted.
"""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recognition.alarms.messages import Message


@dataclass(frozen=True, slots=True)
class Put:
    """A message came to wait, under a number that orders it among the others."""

    number: int
    message: Message


@dataclass(frozen=True, slots=True)
class Done:
    """These wait no more."""

    numbers: tuple[int, ...]


Record = Put | Done


@dataclass(frozen=True, slots=True)
class Replay:
    """What a file says."""

    waiting: tuple[Put, ...]
    """In order."""
    damaged: int
    """Lines that could not be read, without a torn last one."""


def replay(path: Path) -> Replay:
    """What waited when the file was last written; nothing where there is none.

    Raises:
        OSError: where it cannot be read.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except FileNotFoundError:
        return Replay((), 0)
    waiting: dict[int, Put] = {}
    damaged = 0
    for line in lines[:-1]:  # what follows the last line end is torn, or nothing
        record = _read(line)
        if isinstance(record, Put):
            waiting[record.number] = record
        elif record is not None:
            for number in record.numbers:
                waiting.pop(number, None)
        else:
            damaged += 1
    return Replay(tuple(sorted(waiting.values(), key=lambda put: put.number)), damaged)


class Journal:
    """The file of one queue; for one thread. Every method raises OSError where the disk refuses."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._handle: int | None = None
        self.records = 0
        """In the file; 0 where nothing was written since it was opened."""

    def append(self, records: Sequence[Record]) -> None:
        """Add records; they are on the disk when this returns. Where it fails the file may end in a torn line, and
        must be written anew."""
        if self._handle is None:
            raise ValueError("write the journal anew first")
        _write_all(self._handle, b"".join(map(_line, records)))
        self.records += len(records)

    def rewrite(self, records: Iterable[Record]) -> None:
        """Replace the file by these records; where it fails the old file stays as it was."""
        kept = list(records)
        fresh = self._path.with_name(self._path.name + ".new")
        handle = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o600)
        try:
            _write_all(handle, b"".join(map(_line, kept)))
            fresh.replace(self._path)
            _sync_folder(self._path.parent)
        except OSError:
            os.close(handle)
            with contextlib.suppress(OSError):  # it is written over the next time
                fresh.unlink()
            raise
        self.close()
        self._handle, self.records = handle, len(kept)

    def close(self) -> None:
        """Let go of the file."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def _write_all(handle: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(handle, view) :]
    os.fsync(handle)


def _line(record: Record) -> bytes:
    document: dict[str, Any]
    if isinstance(record, Put):
        document = {"put": record.number, "id": record.message.message_id, "body": record.message.body}
    else:
        document = {"done": list(record.numbers)}
    text = json.dumps(document, ensure_ascii=False).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _read(line: bytes) -> Record | None:
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        return None
    document = json.loads(text)
    if "put" in document:
        return Put(document["put"], Message(document["id"], document["body"]))
    return Done(tuple(document["done"]))


def _sync_folder(folder: Path) -> None:
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
