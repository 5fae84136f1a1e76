"""Rig files, and what is measured with a rig afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigcal.errors._base import RigcalError


class RigFileError(RigcalError):
    """A rig file that must not be used."""


class RigFileDigestError(RigFileError):
    """The content does not match the digest: the file was edited by hand or damaged."""

    def __init__(self, path: Path | str, *, expected: str, got: str) -> None:
        super().__init__(
            "the rig file was changed after rigcal wrote it",
            where=path,
            expected=f"digest {expected}",
            got=f"digest {got}",
            do_next="restore the file that rigcal wrote, or calibrate again with rigcal calibrate; rig files are "
            "not edited by hand",
        )


class RigFileVersionError(RigFileError):
    """The file was written by a newer rigcal."""

    def __init__(self, path: Path | str, *, expected: int, got: object) -> None:
        super().__init__(
            f"the rig file has format version {got}, this rigcal reads version {expected}",
            where=path,
            expected=f"version {expected}",
            got=f"version {got}",
            do_next="upgrade rigcal, or calibrate again with this one",
        )


class RigFileSchemaError(RigFileError):
    """The file does not have the rig file's form: a missing, unknown or malformed entry."""

    def __init__(self, path: Path | str, *, entry: str, expected: str, got: object) -> None:
        super().__init__(
            f"not a valid rig file: {entry}",
            where=path,
            expected=expected,
            got=got,
            do_next="use a file written by rigcal calibrate or rigcal import; own entries belong under extensions",
        )


class EvidenceError(RigFileError):
    """The residuals beside a rig file are of other cameras."""

    def __init__(self, *, expected: Sequence[str], got: Sequence[str]) -> None:
        super().__init__(
            "the residuals beside the rig file belong to another rig",
            where="the .residuals.npz of the same name",
            expected=f"residuals of {', '.join(expected)}",
            got=f"residuals of {', '.join(got)}",
            do_next="move that file away, or calibrate again with rigcal calibrate, which writes both",
        )


class RigCaptureError(RigcalError):
    """A capture of other cameras than the rig's."""

    def __init__(self, path: Path | str, *, unknown: Sequence[str], known: Sequence[str]) -> None:
        super().__init__(
            f"the rig has no camera {', '.join(unknown)}",
            where=path,
            expected=f"cameras of the rig: {', '.join(known)}",
            got=f"cameras {', '.join(unknown)}",
            do_next="name each folder or video after its camera as in the rig file, or give the rig file of this site",
        )


class TableError(RigcalError):
    """A table of named points or pixels with a missing, doubled or malformed entry."""

    def __init__(self, path: Path | str, *, problem: str, expected: str, got: object, do_next: str) -> None:
        super().__init__(problem, where=path, expected=expected, got=got, do_next=do_next)


class WorldError(RigcalError):
    """Measurements from which no floor and vertical can be computed."""


class NotFlatError(WorldError):
    """Placements of a board that do not lie on one plane."""

    def __init__(self, worst: str, *, height_mm: float, tilt_deg: float, limit_mm: float, limit_deg: float) -> None:
        super().__init__(
            f"the board does not lie flat: {worst} does not fit one floor with the other placements",
            where=worst,
            expected=f"every placement within {limit_mm:.0f} mm and {limit_deg:.1f} degrees of one plane",
            got=f"{height_mm:+.0f} mm off in height, {tilt_deg:.1f} degrees off in tilt",
            do_next="remove that placement's images, or lay the board flat on the floor there and capture it again",
        )


class BelowFloorError(WorldError):
    """Cameras that would lie below the floor."""

    def __init__(self, heights_m: Sequence[tuple[str, float]], *, method: str, do_next: str) -> None:
        got = ", ".join(f"{camera} at {height:+.2f} m" for camera, height in heights_m)
        super().__init__(
            f"{', '.join(camera for camera, _ in heights_m)} would lie below the floor",
            where=method,
            expected="every camera above the floor",
            got=got,
            do_next=do_next,
        )


class WorldPointError(WorldError):
    """Named points that contradict the rig or each other, or that do not determine a world."""


class DriftError(RigcalError):
    """Board views that cannot tell whether, or which, camera moved."""
