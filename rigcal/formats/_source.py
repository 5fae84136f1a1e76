"""Files at the edge: what a user gives to be imported, and writing a file or a folder whole or not at all."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rigcal.captures import natural_key
from rigcal.errors import FormatError, OutputError
from rigcal.rigfile import write_atomically

CALIBRATION_SUFFIXES = frozenset({".bin", ".cameramodel", ".json", ".toml", ".txt", ".xml", ".yaml", ".yml"})
"""What is read of a folder: a capture's images and videos beside the calibration are passed over."""
SHOWN_NAMES = 6
"""File names in an error message: about one line."""


@dataclass(frozen=True)
class Source:
    """A file, or the calibration files of a folder."""

    path: Path
    """The file or folder."""
    files: Mapping[str, bytes]
    """Contents by name, in natural order; the one file where ``path`` is a file."""

    @cached_property
    def texts(self) -> Mapping[str, str]:
        """The files that are UTF-8 text."""
        decoded = {name: _decoded(data) for name, data in self.files.items()}
        return {name: text for name, text in decoded.items() if text is not None}

    @property
    def is_folder(self) -> bool:
        """Whether ``path`` is a folder."""
        return self.path.is_dir()

    def file(self, name: str) -> Path:
        """The path of one of the files."""
        return self.path / name if self.is_folder else self.path

    @property
    def shown_names(self) -> str:
        """The first files by name, for a message."""
        names = list(self.files)
        return ", ".join(names[:SHOWN_NAMES]) + (f" and {len(names) - SHOWN_NAMES} more" if names[SHOWN_NAMES:] else "")

    @property
    def sha256(self) -> str:
        """Hexadecimal SHA-256: of the file; of a folder, of its files' names and hashes."""
        if not self.is_folder:
            return hashlib.sha256(next(iter(self.files.values()))).hexdigest()
        lines = [f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in self.files.items()]
        return hashlib.sha256("".join(lines).encode("utf-8")).hexdigest()


def read_source(path: Path) -> Source:
    """Read a file, or every calibration file that stands directly in a folder.

    Raises:
        FormatError: where there is no such file, it cannot be read or is no text, or the folder holds no calibration
            file.
    """
    try:
        if not path.is_dir():
            return _with_text(Source(path, {path.name: path.read_bytes()}))
        entries = sorted(path.iterdir(), key=lambda entry: natural_key(entry.name))
        found = [entry for entry in entries if entry.suffix.lower() in CALIBRATION_SUFFIXES and entry.is_file()]
        source = Source(path, {entry.name: entry.read_bytes() for entry in found})
    except OSError as error:
        problem = "no such file" if isinstance(error, FileNotFoundError) else "cannot read this file"
        do_next = "check the path"
        raise FormatError(
            problem, where=path, expected="a calibration file or folder", got=error.strerror, do_next=do_next
        ) from error
    if not source.files:
        raise FormatError(
            "no calibration file in this folder",
            where=path,
            expected="files ending in " + " ".join(sorted(CALIBRATION_SUFFIXES)),
            got=f"{len(entries)} other entries" if entries else "an empty folder",
            do_next="give the file that the other tool wrote, or the folder that directly holds its files",
        )
    return _with_text(source)


def _with_text(source: Source) -> Source:
    """Refuse a file that is no text: a camera in it would be left out unseen."""
    for name, data in source.files.items():
        if name not in source.texts and not (source.is_folder and name.endswith(".bin")):
            raise FormatError(
                "this is not a text file",
                where=source.file(name),
                expected="the calibration of another tool, UTF-8 text",
                got=f"{len(data)} bytes that are not",
                do_next="move it out of the folder, or write it again as UTF-8"
                if source.is_folder
                else "give the file that the other tool wrote; for a COLMAP model, the folder that holds it",
            )
    return source


def _decoded(data: bytes) -> str | None:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    return None if "\0" in text else text


def write_folder(folder: Path, texts: Mapping[str, str]) -> None:
    """Write the files of a folder; on an error the folder stays as it was.

    A folder that holds exactly files of these names is replaced; one that holds anything else is refused, as a file
    of an earlier rig beside the new ones would be read as part of it.

    Raises:
        FormatError: where the folder holds other files, or is a file.
        OutputError: where it cannot be written.
    """
    _refuse_other_content(folder, texts)
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.tmp")
    try:
        temporary.mkdir()
        for name, text in texts.items():
            write_atomically(temporary / name, text)
        if folder.is_dir():
            shutil.rmtree(folder)
        temporary.replace(folder)
    except OSError as error:
        raise OutputError(folder, got=error.strerror or str(error)) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _refuse_other_content(folder: Path, texts: Mapping[str, str]) -> None:
    if not folder.exists():
        return
    others = sorted({entry.name for entry in folder.iterdir()} - set(texts)) if folder.is_dir() else ["a file"]
    if others:
        raise FormatError(
            "this format writes a folder of its own",
            where=folder,
            expected="a new folder, or one with " + ", ".join(texts) + " only",
            got=", ".join(others[:SHOWN_NAMES])
            + (f" and {len(others) - SHOWN_NAMES} more" if others[SHOWN_NAMES:] else ""),
            do_next="give another path with -o, or move those files away",
        )
