"""What is deleted when it has been kept for long enough: recordings show people, and go with everything about them.

The age of a file is the time since it was last written, as the folder shows it. A recording of segments loses the old
ones, and evidence that is as old, while it goes on; all its evidence, notes and answers go with the last of it.

Decision: what belongs to a recording is a closed list of names beside it, never everything that begins like it: in the
same folder stand rig files, which begin like it too. What is left and begins like a deleted recording is named, so that
somebody can look at it; links are never followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from recognition.alarms import ALARMS_SUFFIX, ANSWERS_SUFFIX
from recognition.errors import RecordingError
from recognition.events import EVENTS_SUFFIX
from recognition.recording.container import is_being_written
from recognition.recording.naming import is_mcap, recording_stem
from rigcal.errors import OptionError

EVIDENCE_SUFFIX = ".evidence"
"""Folder of a recording's evidence."""
LOG_SUFFIXES = (ALARMS_SUFFIX, ANSWERS_SUFFIX, EVENTS_SUFFIX)
"""Files that go with the last of a recording."""


@dataclass(frozen=True, slots=True)
class Doomed:
    """A file that has been kept for long enough."""

    path: Path
    bytes: int
    age_s: float


@dataclass(frozen=True, slots=True)
class Retention:
    """What is to be deleted of a folder."""

    doomed: tuple[Doomed, ...]
    """In order of their names; the files of a recording before its logs."""
    folders: tuple[Path, ...]
    """Of evidence, to be deleted when they are empty."""
    left: tuple[Path, ...]
    """What begins like a recording of which nothing remains, and stays."""
    kept: int
    """Recordings of which something remains."""


def plan_retention(folder: Path, *, days: float, now_s: float) -> Retention:
    """What is older than so many days.

    Args:
        folder: Holds recordings, finished or not.
        days: How long to keep.
        now_s: The time, in seconds since 1970.

    Returns:
        What is to be deleted; nothing is yet.

    Raises:
        RecordingError: where it is no folder, or one without recordings.
        OptionError: where ``days`` is not above 0.
    """
    if not days > 0:
        raise OptionError("days", expected="a number above 0", got=days)
    recordings = _recordings(folder)
    doomed: list[Doomed] = []
    folders: list[Path] = []
    left: list[Path] = []
    kept = 0
    for stem, files in recordings.items():
        old = [file for file in files if _age_s(file, now_s) > days * 86400 and not is_being_written(file)]
        evidence = folder / f"{stem}{EVIDENCE_SUFFIX}"
        is_whole = len(old) == len(files)
        old_evidence = [file for file in _files_below(evidence) if is_whole or _age_s(file, now_s) > days * 86400]
        doomed += [_doomed(file, now_s) for file in (*old, *old_evidence)]
        if not is_whole:
            kept += 1
            continue
        folders += _folders_below(evidence)
        logs = [log for suffix in LOG_SUFFIXES if (log := folder / f"{stem}{suffix}").is_file()]
        doomed += [_doomed(log, now_s) for log in logs if not log.is_symlink()]
        left += _namesakes(folder, stem, recordings, {one.path for one in doomed})
    return Retention(tuple(doomed), tuple(folders), tuple(left), kept)


def delete(retention: Retention) -> Iterator[tuple[Doomed, str | None]]:
    """Delete what was planned.

    Yields:
        Each file with why it could not be deleted, None where it was.
    """
    for one in retention.doomed:
        try:
            one.path.unlink(missing_ok=True)
        except OSError as error:
            yield one, error.strerror or str(error)
        else:
            yield one, None
    for folder in sorted(retention.folders, key=lambda path: len(path.parts), reverse=True):
        if not any(folder.iterdir()):
            folder.rmdir()


def _recordings(folder: Path) -> dict[str, list[Path]]:
    """The files of every recording, by its name."""
    found: dict[str, list[Path]] = {}
    if folder.is_dir():
        for file in sorted(folder.glob("*.mcap*")):
            stem = recording_stem(file)
            if stem is not None and file.is_file() and not file.is_symlink() and is_mcap(file):
                found.setdefault(stem, []).append(file)
    if not found:
        raise RecordingError(
            "nothing is deleted here: the folder holds no recordings" if folder.is_dir() else "there is no such folder",
            where=folder,
            expected="a folder that directly holds recordings, NAME.mcap",
            got="none" if folder.is_dir() else "no folder",
            do_next="give the folder that `recognition run -o` writes to",
        )
    return found


def _age_s(file: Path, now_s: float) -> float:
    return now_s - file.stat().st_mtime


def _doomed(file: Path, now_s: float) -> Doomed:
    return Doomed(file, file.stat().st_size, _age_s(file, now_s))


def _files_below(folder: Path) -> Iterator[Path]:
    for one in _folders_below(folder):
        yield from (file for file in sorted(one.iterdir()) if file.is_file() and not file.is_symlink())


def _folders_below(folder: Path) -> Iterator[Path]:
    """A folder and those in it, without links."""
    if folder.is_dir() and not folder.is_symlink():
        yield folder
        for one in sorted(folder.iterdir()):
            yield from _folders_below(one)


def _namesakes(folder: Path, stem: str, recordings: dict[str, list[Path]], doomed: set[Path]) -> Sequence[Path]:
    """What begins like a recording and belongs to no other."""
    return [
        file
        for file in sorted(folder.iterdir())
        if file.name.startswith(f"{stem}.")
        and file not in doomed
        and file.name != f"{stem}{EVIDENCE_SUFFIX}"
        and not any(len(other) > len(stem) and file.name.startswith(f"{other}.") for other in recordings)
    ]
