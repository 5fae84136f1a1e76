"""The probe log ``CAPTURE/clock_probes.csv``: every answered probe of a recording, appended while it runs.

A row is one exchange, in integer nanoseconds, so that nothing is lost on the way; the host's monotonic clock is empty
where the host did not tell it. Rows go to the disk at each append. A writer that is killed leaves half a row at the
end at worst: reading leaves it out and counts it, the next append cuts it off.
"""

from __future__ import annotations

import codecs
import csv
import io
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rigcal.errors import ProbeLogError, writing
from rigcal.sync.exchanges import UNKNOWN, Exchanges

PROBE_LOG = "clock_probes.csv"
COLUMNS = ("cam_id", "t1_ns", "t2_ns", "t3_ns", "t4_ns", "rig_monotonic_ns", "host_monotonic_ns")
_FIELDS = ("sent_ns", "received_ns", "replied_ns", "returned_ns", "rig_monotonic_ns", "host_monotonic_ns")
"""Fields of :class:`Exchanges` in the order of the columns."""
_HEADER = f"{','.join(COLUMNS)}\n".encode()
_GREATEST = 2**63 - 1
_BLOCK_BYTES = 4096


@dataclass(frozen=True, slots=True)
class ProbeLog(Mapping[str, Exchanges]):
    """A probe log as it was read: the exchanges of each camera, in the order in which they were written."""

    exchanges: Mapping[str, Exchanges]
    """By camera, in the order of their first rows."""
    torn: int
    """Rows that a killed writer left unfinished, and that were left out: 0 or 1."""

    def __getitem__(self, camera_id: str) -> Exchanges:
        return self.exchanges[camera_id]

    def __iter__(self) -> Iterator[str]:
        return iter(self.exchanges)

    def __len__(self) -> int:
        return len(self.exchanges)


def probe_log_beside(recorded: Path) -> Path:
    """Where a probe log is looked for: in the capture folder, or beside a recording as ``NAME.clock_probes.csv``."""
    return recorded / PROBE_LOG if recorded.is_dir() else recorded.with_name(f"{recorded.stem}.{PROBE_LOG}")


def append_exchanges(path: Path, exchanges: Mapping[str, Exchanges]) -> int:
    """Write exchanges at the end of a log, which is made where there is none.

    Args:
        path: The log.
        exchanges: New exchanges by camera.

    Returns:
        How many unfinished rows of a killed writer were cut off: 0 or 1.

    Raises:
        OutputError: where the file cannot be written.
        ProbeLogError: where the file is something else than a probe log.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(_rows(exchanges))
    with writing(path), path.open("a+b") as file:
        torn = _cut_torn_row(path, file)
        if file.seek(0, os.SEEK_END) == 0:
            file.write(_HEADER)
        file.write(text.getvalue().encode())
        file.flush()
        os.fsync(file.fileno())
    return torn


def read_exchanges(path: Path) -> ProbeLog:
    """Read a log, as far as it is written.

    Raises:
        ProbeLogError: where the file is absent or no probe log, or a row is malformed.
    """
    try:
        content = path.read_bytes().removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n")
    except OSError as error:
        raise ProbeLogError(
            path,
            problem="the probe log cannot be read",
            expected=f"a file that rigcal sync probe wrote, {PROBE_LOG} in the capture",
            got=error.strerror or str(error),
            do_next="check the path, or leave the log out: the report is made without it",
        ) from error
    end = content.rfind(b"\n") + 1
    if not (content.startswith(_HEADER) or _HEADER.startswith(content)):
        raise _not_a_log(path, content.partition(b"\n")[0])
    rows = content[len(_HEADER) : end].decode(errors="replace").splitlines()
    return ProbeLog(_exchanges(path, rows), torn=int(end < len(content)))


def _rows(exchanges: Mapping[str, Exchanges]) -> Iterator[tuple[str | int, ...]]:
    for camera_id, seen in exchanges.items():
        columns = np.stack([getattr(seen, name) for name in _FIELDS], axis=1)
        for row in columns.tolist():
            yield (camera_id, *row[:-1], "" if row[-1] == UNKNOWN else row[-1])


def _exchanges(path: Path, lines: Iterable[str]) -> dict[str, Exchanges]:
    rows: dict[str, list[tuple[int, ...]]] = {}
    for number, row in enumerate(csv.reader(lines), start=2):
        rows.setdefault(_camera_of(path, number, row), []).append(_times_ns(path, number, row))
    return {camera: Exchanges(*np.array(times, dtype=np.int64).T) for camera, times in rows.items()}


def _camera_of(path: Path, line: int, row: list[str]) -> str:
    if len(row) != len(COLUMNS) or not row[0]:
        raise ProbeLogError(
            path,
            problem=f"line {line} is no row of a probe log",
            expected=f"{len(COLUMNS)} values: {', '.join(COLUMNS)}",
            got=",".join(row) or "an empty line",
            do_next=f"remove line {line}, or take the log as rigcal sync probe wrote it",
        )
    return row[0]


def _times_ns(path: Path, line: int, row: list[str]) -> tuple[int, ...]:
    times = row[1:] if row[-1] else [*row[1:-1], str(UNKNOWN)]
    try:
        values = tuple(int(text) for text in times)
    except ValueError:
        values = ()
    if not values or not all(-_GREATEST <= value <= _GREATEST for value in values):
        raise ProbeLogError(
            path,
            problem=f"line {line} holds something else than times",
            expected="whole nanoseconds, below 2^63; host_monotonic_ns may be empty",
            got=",".join(row),
            do_next=f"remove line {line}, or take the log as rigcal sync probe wrote it (a spreadsheet rounds it)",
        )
    return values


def _cut_torn_row(path: Path, file: BinaryIO) -> int:
    """Cut off what follows the end of the log's last line; 1 where there was something."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    first = file.readline(len(_HEADER) + 1).replace(b"\r\n", b"\n")
    is_log = first == _HEADER
    if not is_log and not _HEADER.startswith(first):
        raise _not_a_log(path, first)
    end = _last_line_end(file, size) if is_log else 0
    if end < size:
        file.truncate(end)
    return int(end < size)


def _last_line_end(file: BinaryIO, size: int) -> int:
    """Where the last line that has an end ends; the file's first line has one."""
    end, found = size, -1
    while found < 0:
        start = max(end - _BLOCK_BYTES, 0)
        file.seek(start)
        found = file.read(end - start).rfind(b"\n")
        end = start
    return end + found + 1


def _not_a_log(path: Path, first: bytes) -> ProbeLogError:
    return ProbeLogError(
        path,
        problem="this is no probe log",
        expected=f"first line {','.join(COLUMNS)}",
        got=first.decode(errors="replace").strip()[:100] or "an empty first line",
        do_next="give the file that rigcal sync probe wrote; another file is never overwritten",
    )
