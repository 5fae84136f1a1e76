"""Where a recording's own files are: those beside ``NAME.mcap``, its segments or what it is growing as.

``NAME.alarms.jsonl`` has what was raised and ended, ``NAME.answers.jsonl`` what operators said of it. A recording of
segments, ``NAME.000.mcap`` and so on, has one of each.
"""

from __future__ import annotations

from pathlib import Path

from recognition.errors import RecordingError
from recognition.recording.naming import recording_stem

ALARMS_SUFFIX, ANSWERS_SUFFIX = ".alarms.jsonl", ".answers.jsonl"


def beside(recording: Path, suffix: str) -> Path:
    """The file ``NAME`` + ``suffix`` of the recording that ``NAME.mcap`` names."""
    return recording.with_name((recording_stem(recording) or recording.stem) + suffix)


def recording_named(path: Path) -> Path:
    """``FOLDER/NAME.mcap`` of the recording that a file, its name or a folder stands for, whole or still growing.

    Raises:
        RecordingError: where there is none, or a folder holds several.
    """
    folder = path if path.is_dir() else path.parent
    stems = {stem for file in folder.glob("*.mcap*") if (stem := recording_stem(file)) is not None}
    wanted = recording_stem(path)
    found = sorted(stems if path.is_dir() else stems & {wanted})
    if len(found) != 1:
        raise RecordingError(
            "the folder holds several recordings" if found else "there is no such recording",
            where=path,
            expected="a recording, NAME.mcap, or a folder with one",
            got=", ".join(f"{stem}.mcap" for stem in found) or None,
            do_next=f"give one of them, {folder / found[0]}.mcap" if found else "check the path",
        )
    return folder / f"{found[0]}.mcap"
