"""Names of recordings: one file ``NAME.mcap``, or segments ``NAME.000.mcap``, ``NAME.001.mcap``, ...

A file grows as ``....mcap.part`` and loses that suffix when it is whole. A folder, the name ``NAME.mcap`` of segments
or one file names a recording to read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from recognition.errors import RecordingError
from recognition.recording.container import MAGIC, PART_SUFFIX, is_being_written, recover_command

SUFFIX = ".mcap"
_SEGMENT = re.compile(r"(?P<stem>.+)\.(?P<index>[0-9]{3,})\.mcap", re.DOTALL)


def segment_path(path: Path, index: int) -> Path:
    """The file of segment ``index``, from 0, of the recording ``path``."""
    return path.with_name(f"{path.stem}.{index:03d}{path.suffix}")


def segments_of(path: Path) -> tuple[Path, ...]:
    """The finished segments of the recording ``path``, in order."""
    stem = path.name.removesuffix(SUFFIX)
    found = {
        int(match["index"]): other
        for other in path.parent.glob(f"*{SUFFIX}")
        if (match := _SEGMENT.fullmatch(other.name)) and match["stem"] == stem
    }
    return tuple(found[index] for index in sorted(found))


def recording_files(path: Path) -> tuple[Path, ...]:
    """The files of a recording, in order: a file, the segments of ``NAME.mcap``, or the one recording of a folder.

    Raises:
        RecordingError: where there is none, none that is finished, or a folder holds several.
    """
    if path.is_dir():
        return _files_in(path)
    files = (path,) if path.exists() else segments_of(path)
    if not files and (parts := _parts_of(path)):
        raise RecordingError(
            "the recording is not finished",
            where=path,
            expected="a finished recording",
            got=parts[0].name,
            do_next=_advice(parts[0]),
        )
    return files or (path,)  # opening it says that it is absent


def unfinished_notes(path: Path) -> Iterator[str]:
    """What is not finished of the recording that a name or a folder stands for; nothing where one file was named."""
    if path.is_file():
        return
    first = recording_files(path)[0]
    for part in _parts_of(first.with_name(recording_name(first))):
        yield f"{part.name} is not finished and was left out: {_advice(part)}"


def _parts_of(path: Path) -> tuple[Path, ...]:
    """The unfinished files of the recording ``path``."""
    parts = sorted(path.parent.glob(f"*{SUFFIX}{PART_SUFFIX}"))
    return tuple(part for part in parts if recording_name(part.with_suffix("")) == path.name)


def _advice(part: Path) -> str:
    return "a run is still recording it" if is_being_written(part) else f"run `{recover_command(part)}`"


def _files_in(folder: Path) -> tuple[Path, ...]:
    names = {recording_name(file) for file in folder.glob(f"*{SUFFIX}")}
    if len(names) != 1:
        raise RecordingError(
            "the folder holds no recording" if not names else "the folder holds several recordings",
            where=folder,
            expected=f"one recording, NAME{SUFFIX} or its segments NAME.000{SUFFIX}, NAME.001{SUFFIX}, ...",
            got=", ".join(sorted(names)) or f"no file that ends in {SUFFIX}",
            do_next=f"give one of them, {folder / min(names)}" if names else "check the path",
        )
    whole = folder / names.pop()
    return (whole,) if whole.exists() else segments_of(whole)


def recording_name(file: Path) -> str:
    """The name ``NAME.mcap`` of the recording that a file is by its name: its own, or that of its segments."""
    return _recording_name(file.name)


def _recording_name(name: str) -> str:
    match = _SEGMENT.fullmatch(name)
    return f"{match['stem']}{SUFFIX}" if match else name


def recording_stem(file: Path) -> str | None:
    """``NAME`` of the recording that a file is of by its name, finished or not; None where the name is another kind's.

    What belongs to a recording begins with it: ``NAME.events.json``, ``NAME.evidence`` and so on.
    """
    name = file.name.removesuffix(PART_SUFFIX)
    stem = _recording_name(name).removesuffix(SUFFIX)
    return stem if stem and name.endswith(SUFFIX) else None


def require_free_names(path: Path) -> None:
    """Refuse to record segments beside those of an earlier run of the same name, finished or not.

    Raises:
        RecordingError: where there are any.
    """
    for part in _parts_of(path):
        raise in_the_way(part)
    if earlier := segments_of(path):
        raise RecordingError(
            "segments of an earlier run are in the way",
            where=earlier[0],
            expected=f"no segments of {path.name}",
            got=f"{len(earlier)} of them, to {earlier[-1].name}",
            do_next="give another name with -o, or move them away: nothing is overwritten",
        )


def in_the_way(part: Path) -> RecordingError:
    """The error of a recording that is not finished and has the name that another wants."""
    if is_being_written(part):
        return RecordingError(
            "another run is recording here",
            where=part,
            expected="no such file",
            got=f"{part.stat().st_size} bytes, and a process that writes it",
            do_next="give another name with -o, or end that run first",
        )
    size = part.stat().st_size
    advice = f"run `{recover_command(part)}` and then delete it, or delete it if it is not needed"
    return RecordingError(
        "an unfinished recording is in the way",
        where=part,
        expected="no such file",
        got=f"{size} bytes of a run that did not end",
        do_next=advice if size else "delete it: there is nothing in it",
    )


def unfinished_notices(folder: Path) -> Iterator[str]:
    """What to do about each recording in a folder that was not finished, and that nobody writes any more."""
    for part in sorted(folder.glob(f"*{PART_SUFFIX}")):
        if is_mcap(part) and not is_being_written(part):
            yield (
                f"{part.name} is a recording of a run that did not end, {part.stat().st_size / 1e6:.1f} MB: "
                f"run `{recover_command(part)}` and then delete it"
            )


def is_mcap(path: Path) -> bool:
    """Whether a file begins as a recording does."""
    try:
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False
