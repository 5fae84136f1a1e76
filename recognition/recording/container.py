"""What writer, reader, check and recover share about the file itself: its magic, its names, its safe appearance.

A recording is written to ``NAME.mcap.part`` and renamed to ``NAME.mcap`` when it is whole, so a file without
``.part`` was finished.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from recognition.errors import RecordingError
from rigcal import __version__

if sys.platform != "win32":
    import fcntl

MAGIC = b"\x89MCAP0\r\n"
LIBRARY_NAME = "recognition"
LIBRARY = f"{LIBRARY_NAME} {__version__}; {LIBRARY_IDENTIFIER}"
"""Header field of our files: their messages are numbered per topic without holes."""
CHUNK_BYTES = 1024 * 1024
"""1 MiB: 4 MiB chunks took 1.4 times the time (one run of 60 s of 4 cameras), and a damaged one costs more."""
RIG_ATTACHMENT, RULES_ATTACHMENT = "rig.json", "rules.toml"
RIG_METADATA, SEGMENT_METADATA = "rigcal", "segment"
PART_SUFFIX = ".part"


def open_writer(stream: IO[bytes], *, profile: str = "", library: str = LIBRARY) -> Writer:
    """A started MCAP writer with zstd chunks and every checksum on."""
    writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile=profile, library=library)
    return writer


def part_path(path: Path) -> Path:
    """Where ``path`` grows until it is whole."""
    return path.with_name(path.name + PART_SUFFIX)


def recover_command(path: Path) -> str:
    """The command that makes a whole file of ``path``."""
    whole = path.name.removesuffix(PART_SUFFIX)
    target = whole if whole != path.name else f"{path.stem}-recovered{path.suffix}"
    return f"recognition recover {path} -o {path.with_name(target)}"


def publish(temporary: Path, path: Path) -> None:
    """Give a complete file its name, replacing what had it; the name is on disk when this returns."""
    temporary.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Put a folder's entries on disk, where the system lets a folder be opened."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def claim(stream: IO[bytes]) -> None:
    """Mark an open file as being written, for as long as it is open and its process lives; not on Windows."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_being_written(part: Path) -> bool:
    """Whether a process that lives has claimed the file."""
    if sys.platform != "win32":
        with contextlib.suppress(FileNotFoundError, PermissionError), part.open("rb") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            except OSError:  # a file system without locks
                return False
    return False


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """A recording to read from; RecordingError where it cannot be opened."""
    try:
        stream = path.open("rb")
    except OSError as error:
        raise RecordingError(
            "cannot open the recording",
            where=path,
            expected="an MCAP file that can be read",
            got=error.strerror,
            do_next="check the path and its permissions",
        ) from error
    with stream:
        yield stream


@contextmanager
def mapped(path: Path) -> Iterator[mmap.mmap]:
    """The bytes of a recording, read-only, without loading them; RecordingError where there are none."""
    with opened(path) as stream:
        if os.fstat(stream.fileno()).st_size == 0:
            raise not_mcap(path, "an empty file")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield data


def not_mcap(path: Path, got: str) -> RecordingError:
    """The error of a file that is something else."""
    return RecordingError(
        "not an MCAP file",
        where=path,
        expected="a recording that begins with the MCAP magic",
        got=got,
        do_next="give a file that recognition run wrote; if it was one, nothing in it can be read any more",
    )


def damaged(path: Path, got: str) -> RecordingError:
    """The error of a recording that cannot be read to its end."""
    return RecordingError(
        "the recording is unfinished or damaged",
        where=path,
        expected="a finished MCAP file",
        got=got,
        do_next=f"run `{recover_command(path)}`",
    )
