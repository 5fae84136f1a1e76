"""Files of other tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigcal.errors._base import RigcalError


class FormatError(RigcalError):
    """A file of another tool that cannot be read or written."""


class FormatEntryError(FormatError):
    """An entry of another tool's file that is missing or malformed."""

    def __init__(self, path: Path | str, entry: str, *, expected: str, got: object) -> None:
        super().__init__(
            f"cannot use the entry {entry or '(top level)'}",
            where=path,
            expected=expected,
            got=got,
            do_next="mend that entry, or write the file again with the tool that made it",
        )


class UnknownFormatError(FormatError):
    """A format that rigcal does not know, cannot recognise, or cannot use in this direction."""

    def __init__(self, problem: str, *, where: object, formats: Sequence[str], got: str, option: str) -> None:
        super().__init__(
            problem,
            where=where,
            expected="one of " + ", ".join(formats),
            got=got,
            do_next=f"name one of these formats with {option}",
        )


class ForeignNameError(FormatError):
    """The target format cannot hold a camera's name."""

    def __init__(self, camera_id: str, *, to: str, expected: str) -> None:
        super().__init__(
            f"{to} cannot hold the name of camera {camera_id}",
            where=f"camera {camera_id}",
            expected=expected,
            got=repr(camera_id),
            do_next="rename that camera's folder in the capture and calibrate again, or export to anipose or "
            "foxglove, which hold any name",
        )


class LossyExportError(FormatError):
    """The target format has no place for a coefficient that is not zero."""

    def __init__(self, *, camera_id: str, model: str, to: str, coefficients: Sequence[str], do_next: str) -> None:
        super().__init__(
            f"{to} cannot hold every coefficient of camera {camera_id}",
            where=f"camera {camera_id}, model {model}",
            expected=f"a lens model that {to} can store without loss",
            got=", ".join(coefficients),
            do_next=do_next,
        )
