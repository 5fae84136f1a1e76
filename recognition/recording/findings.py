"""What a check says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found; an ``error`` makes a recording unfit, a ``warning`` is worth knowing."""

    severity: Literal["error", "warning"]
    text: str


def error(text: str) -> Finding:
    """A finding that makes the recording unfit."""
    return Finding("error", text)


def warning(text: str) -> Finding:
    """A finding that is worth knowing."""
    return Finding("warning", text)
