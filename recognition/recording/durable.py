"""An MCAP file that grows as ``NAME.mcap.part`` and is on the disk within an interval of every message.

Decision: a thread flushes and syncs twice per interval, so that what was handed over is on disk within the interval
even when the runtime waits for a camera and calls nothing. The alternative, to look at the clock in each call, loses
everything since the last call when a camera stalls and the power fails. A call flushes as well where the thread is
late, because a busy disk holds it up in a sync: then a killed process has lost no more, for what was flushed is the
system's. The cost is one lock, held while messages are appended and never while the disk syncs.
"""

from __future__ import annotations

import contextlib
import errno
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from mcap.writer import Writer

from recognition.errors import NoRoomError, RecordingError
from recognition.recording.container import claim, open_writer, part_path, publish, recover_command, sync_folder
from recognition.recording.naming import in_the_way

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class DurableFile:
    """The writer of ``path``, by way of ``path.part``; safe to use from several threads.

    Raises:
        RecordingError: where the file cannot be created or an earlier ``.part`` is in the way. Every method raises
            it when the disk refuses, and ever after, for then the tail of the file is torn. NoRoomError where it
            refuses because it is full.
    """

    def __init__(self, path: Path, *, fsync_interval_s: float) -> None:
        if not fsync_interval_s > 0:
            raise ValueError(f"fsync_interval_s must be positive, got {fsync_interval_s}")
        self.path, self.part = path, part_path(path)
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._dirty = self._finished = False
        self._period_s, self._flushed_s = fsync_interval_s / 2, time.monotonic()
        self._failure: OSError | None = None
        self._stream = _create(self.part)
        claim(self._stream)
        self._writer = open_writer(self._stream)
        self._syncer = threading.Thread(target=self._keep_synced, name="recording-sync", daemon=True)
        self._syncer.start()

    @property
    def bytes(self) -> int:
        """How large the file is; of its last chunk nothing is counted."""
        return 0 if self._stream.closed else self._stream.tell()

    @contextlib.contextmanager
    def writing(self) -> Iterator[Writer]:
        """The writer, for this block alone; what the block adds stays together in the file."""
        with self._lock, self._disk():
            if self._finished:
                raise RecordingError(
                    "the recording is closed", where=self.path, do_next="write before the recorder's block ends"
                )
            self._dirty = True
            yield self._writer
            if time.monotonic() - self._flushed_s >= self._period_s:
                self._flush()

    def sync(self) -> None:
        """Put everything, and the file's name, on the disk now."""
        with self.writing():
            self._flush()
            os.fsync(self._stream.fileno())
            sync_folder(self.part.parent)

    def finish(self) -> None:
        """Write the index and close the file, which stays ``.part``; a second call does nothing."""
        self._stop.set()
        self._syncer.join()
        if self._finished:
            return
        self._finished = True
        try:
            with self._disk():
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._stream.flush()
                os.fsync(self._stream.fileno())
        finally:
            with contextlib.suppress(OSError):  # after a failure there is nothing more to save
                self._stream.close()

    def publish(self) -> None:
        """Give the finished file its name."""
        with self._disk():
            publish(self.part, self.path)

    @contextlib.contextmanager
    def _disk(self) -> Iterator[None]:
        if self._failure is not None:
            raise _disk_error(self.part, self._failure) from self._failure
        try:
            yield
        except OSError as error:
            self._failure = error
            raise _disk_error(self.part, error) from error

    def _flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._flushed_s = time.monotonic()

    def _keep_synced(self) -> None:
        while not self._stop.wait(self._period_s):
            try:
                with self._lock:
                    if not self._dirty or self._failure is not None:
                        continue
                    self._flush()
                    self._dirty = False
                os.fsync(self._stream.fileno())
            except OSError as error:
                self._failure = error


def _create(part: Path) -> IO[bytes]:
    try:
        return part.open("xb")
    except FileExistsError as error:
        raise in_the_way(part) from error
    except OSError as error:
        raise _disk_error(part, error) from error


def _disk_error(part: Path, error: OSError) -> RecordingError:
    kind = NoRoomError if error.errno in _NO_ROOM else RecordingError
    return kind(
        "cannot write the recording",
        where=part,
        expected="a folder that exists, can be written and has room",
        got=error.strerror or str(error),
        do_next=f"mend that and record again; what was written can be saved by `{recover_command(part)}`",
    )
