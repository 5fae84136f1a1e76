"""Board detections kept between runs: one small file per source file and board, named by what it was made from.

A key is the SHA-256 of the source file's bytes, the board and the detector's version, so that nothing ever needs to be
invalidated. A damaged entry counts as absent, and a cache that cannot be written to costs time and nothing else.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_dir

FOLDER_VARIABLE = "RIGCAL_CACHE"
"""Environment variable that names another folder than the user's cache folder."""


def default_cache() -> DetectionCache:
    """The cache in the folder that ``RIGCAL_CACHE`` names, else in the user's cache folder."""
    return DetectionCache(Path(os.environ.get(FOLDER_VARIABLE) or user_cache_dir("rigcal")))


def cache_key(content_sha256: str, *, board: str, version: str) -> str:
    """The name of an entry: what was searched, for which board (``spec``), by which version of the detector."""
    return hashlib.sha256(f"{version}\n{board}\n{content_sha256}".encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class DetectionCache:
    """Arrays by key, in a folder."""

    folder: Path

    def load(self, key: str) -> dict[str, NDArray[Any]] | None:
        """The arrays stored under ``key``, or None where there are none or the entry is damaged."""
        try:
            with self._path(key).open("rb") as file, np.load(file, allow_pickle=False) as stored:
                return {name: stored[name] for name in stored.files}
        except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
            return None

    def store(self, key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep arrays under ``key``: written beside and renamed, so that a reader never sees half a file."""
        path = self._path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        except OSError:
            return
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez(file, **dict(arrays))  # type: ignore[arg-type]
            Path(name).replace(path)
        except OSError:
            Path(name).unlink(missing_ok=True)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.npz"
