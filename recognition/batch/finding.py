"""Which recordings a batch is of: files, segments, folders and patterns become recordings with names of their own."""

from __future__ import annotations

import glob
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from recognition.errors import BatchError, RecordingError
from recognition.recording import read_segment
from recognition.recording.container import PART_SUFFIX
from recognition.recording.naming import SUFFIX, recording_name, segments_of


@dataclass(frozen=True, slots=True)
class Found:
    """A recording of a batch."""

    path: Path
    """A file, or the name ``NAME.mcap`` of its segments; it may be unfinished or damaged."""
    name: str
    """What its results are named: ``NAME``, or ``FOLDER/NAME`` where a batch has several of that name."""


def find_recordings(inputs: Sequence[str]) -> tuple[Found, ...]:
    """The recordings that somebody means, each once.

    A segment stands for the whole recording. A folder stands for every recording below it, those that are unfinished
    included. A name with ``*``, ``?`` or ``[`` that is no file is a pattern; ``**`` goes through folders.

    Args:
        inputs: Names, as they are given.

    Returns:
        In the order of ``inputs``, those of one folder or pattern by their paths.

    Raises:
        BatchError: where a name stands for nothing.
    """
    paths: dict[Path, Path] = {}
    for given in inputs:
        found = [_recording_of(file) for file in _files(given)]
        if not found:
            raise BatchError(
                "there is no recording here",
                where=given,
                expected=f"recordings, NAME{SUFFIX}, a folder that holds some, or a pattern that some match",
                got="a folder without any" if Path(given).is_dir() else "nothing of this name",
                do_next="check the path",
            )
        for path in found:
            paths.setdefault(path.resolve(), path)
    return tuple(Found(path, name) for path, name in zip(paths.values(), _names(list(paths.values())), strict=True))


def _files(given: str) -> Iterator[Path]:
    path = Path(given)
    if path.is_dir():
        yield from sorted(file for suffix in (SUFFIX, SUFFIX + PART_SUFFIX) for file in path.rglob(f"*{suffix}"))
    elif path.exists():
        yield path
    elif segments := segments_of(path):
        yield segments[0]
    else:
        for match in sorted(glob.glob(given, recursive=True)):  # noqa: PTH207  # of an absolute pattern too
            yield from _files(match)


def _recording_of(file: Path) -> Path:
    """The recording that a file belongs to: the file itself, unless it is a segment.

    A name with a date, ``hall.20261122.mcap``, looks like that of a segment: what finished files say of themselves
    decides.
    """
    finished = file.with_name(file.name.removesuffix(PART_SUFFIX))
    whole = finished.with_name(recording_name(finished))
    segments = segments_of(whole)
    return finished if segments and not any(map(_is_segment, segments)) else whole


def _is_segment(file: Path) -> bool:
    try:
        return read_segment(file) is not None
    except RecordingError:
        return False  # the replay will say what is wrong with it


def _names(paths: Sequence[Path]) -> list[str]:
    """The shortest ends of paths, without suffix, that differ from all the others."""
    parts = [(*path.parent.resolve().parts, path.name.removesuffix(SUFFIX)) for path in paths]
    lengths = [1] * len(parts)
    while True:
        ends = [own[-length:] for own, length in zip(parts, lengths, strict=True)]
        counts = Counter(ends)
        if max(counts.values(), default=1) == 1:
            return ["/".join(end) for end in ends]
        lengths = [length + (counts[end] > 1) for length, end in zip(lengths, ends, strict=True)]
