"""The folder of what waits to be sent: a file per target, for one run at a time."""

from __future__ import annotations

import os
import sys
from collections.abc import Collection
from pathlib import Path

from recognition.alarms.waiting import Waiting
from recognition.errors import AlarmsError

if sys.platform != "win32":
    import fcntl

_SUFFIX = ".jsonl"


class QueueFolder:
    """A queue folder, held for this process from its making until :meth:`release`, or until the process is gone."""

    def __init__(self, folder: Path) -> None:
        """Make it where it is not there.

        Raises:
            AlarmsError: where it cannot be written, or another run uses it.
        """
        self.path = folder
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._handle = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise self._unwritable(error) from error
        if sys.platform != "win32":
            try:
                fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                self.release()
                raise AlarmsError(
                    "another run uses this queue of alarms",
                    where=folder,
                    expected="a queue of this run alone",
                    do_next="end that run, or give this one an alarms file that names another queue",
                ) from error

    def open(self, target: str, *, most: int) -> Waiting:
        """What waits for a target.

        Raises:
            AlarmsError: where its file cannot be read or written; the folder is released then.
        """
        try:
            return Waiting(self.path / f"{target}{_SUFFIX}", most=most)
        except OSError as error:
            self.release()
            raise self._unwritable(error) from error

    def strangers(self, targets: Collection[str]) -> tuple[Path, ...]:
        """Files of targets that are not among these."""
        return tuple(file for file in sorted(self.path.glob(f"*{_SUFFIX}")) if file.stem not in targets)

    def release(self) -> None:
        """Let another run have it."""
        os.close(self._handle)

    def _unwritable(self, error: OSError) -> AlarmsError:
        return AlarmsError(
            "cannot write the queue of alarms",
            where=self.path,
            expected="a folder that can be written, on a disk with room",
            got=error.strerror or str(error),
            do_next="mend that, or name another folder as queue in the alarms file",
        )
