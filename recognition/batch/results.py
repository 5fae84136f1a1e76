"""The folder of a batch's results, which holds no half of anything, whenever its process ends.

While a batch goes on its rows are appended to ``batch.jsonl.part`` as they come; ``batch.jsonl`` and ``batch.csv``
appear when there is a row of every recording, in the order of the recordings. An events file is written under another
name and renamed. A row counts for a later batch where its events file is the one that it tells of, so that a row that
was cut off, or a file that was exchanged, is computed again.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from recognition.batch.finding import Found
from recognition.batch.rows import Row, row_of, table, text_digest
from recognition.errors import BatchError
from recognition.events import EVENTS_SUFFIX
from recognition.recording.container import PART_SUFFIX, claim, is_being_written, publish
from rigcal.errors import writing

ROWS, TABLE = "batch.jsonl", "batch.csv"


class Results:
    """The results of a batch as they come; a context manager, which alone may write to the folder meanwhile.

    Args:
        folder: Is made where it does not exist; may hold what an earlier batch did.

    Raises:
        BatchError: where another batch is writing to the folder.
        OutputError: where it cannot be written to; every method raises it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.journal = folder / (ROWS + PART_SUFFIX)
        with writing(self.journal):
            if is_being_written(self.journal):
                raise _other_batch(self.journal)
            self._earlier = {row.name: row for file in (folder / ROWS, self.journal) for row in _rows(file)}
            _write(self.journal, _lines(list(self._earlier.values())))
            for name in (ROWS, TABLE):
                (folder / name).unlink(missing_ok=True)
            self._stream = self.journal.open("ab")
        claim(self._stream)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()

    def earlier(self, name: str) -> Row | None:
        """The row of an earlier batch, where it counts: the recording was read, and its events are as the row says."""
        row = self._earlier.get(name)
        if row is None or row.status != "ok":
            return None
        if row.events_digest is not None:
            try:
                if text_digest(self._events(name).read_text(encoding="utf-8")) != row.events_digest:
                    return None
            except (OSError, UnicodeDecodeError):
                return None
        return row

    def left_out(self, found: Sequence[Found]) -> tuple[str, ...]:
        """Names of earlier rows that these recordings are not of."""
        return tuple(sorted(self._earlier.keys() - {one.name for one in found}))

    def add(self, row: Row, events: str | None) -> None:
        """Keep what was found; ``events`` is the text of the events file, None where there is none to write.

        The row is on disk when this returns.
        """
        path = self._events(row.name)
        with writing(path):
            if events is not None:
                _write(path, events)
            elif row.events_digest is None:
                path.unlink(missing_ok=True)
            self._stream.write(row.line.encode() + b"\n")
            self._stream.flush()
            os.fsync(self._stream.fileno())

    def finish(self, rows: Sequence[Row]) -> None:
        """Write the table of a batch that is whole, in this order."""
        with writing(self.folder / ROWS):
            _write(self.folder / TABLE, table(rows))
            _write(self.folder / ROWS, _lines(rows))
            self.journal.unlink()

    def _events(self, name: str) -> Path:
        return self.folder / f"{name}{EVENTS_SUFFIX}"


def require_apart(folder: Path, found: Sequence[Found]) -> None:
    """Refuse a folder in which results would take the places of what stands beside the recordings.

    Raises:
        BatchError: where events would be written beside a recording.
    """
    for one in found:
        if (folder / one.name).parent.resolve() == one.path.parent.resolve():
            raise BatchError(
                "results would stand among the recordings, where the events of their runs are",
                where=folder,
                expected="a folder of its own",
                got=f"the folder of {one.path}",
                do_next=f"give another one: -o {folder / 'batch'}",
            )


def _rows(file: Path) -> Iterator[Row]:
    if file.exists():
        for line in file.read_bytes().splitlines():
            if (row := row_of(line)) is not None:
                yield row


def _lines(rows: Sequence[Row]) -> str:
    return "".join(f"{row.line}\n" for row in rows)


def _write(path: Path, text: str) -> None:
    """Write a file that is whole whenever it is there."""
    temporary = path.with_name(f"{path.name}.writing")
    with temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    publish(temporary, path)


def _other_batch(journal: Path) -> BatchError:
    return BatchError(
        "another batch is writing here",
        where=journal.parent,
        expected="a folder that no batch is writing to",
        got=f"a process that writes {journal.name}",
        do_next="give another one with -o, or wait for that batch",
    )
