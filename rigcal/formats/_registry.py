"""The known formats; import with recognition by content, export with the conventions that were written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from rigcal.errors import FormatError, OptionError, UnknownFormatError
from rigcal.formats import anipose, colmap, kalibr, multiview_dataset
from rigcal.formats._foreign import METRES_PER_UNIT, ForeignRig, Written, largest_distance_m
from rigcal.rig import Rig
from rigcal.rigdocument import FORMAT as RIG_FORMAT
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import document_of_rig, rig_of, write_atomically

LARGEST_ASSUMED_METRES = 50.0
"""A file that does not say its unit is taken for metres up to this distance between cameras: a stereo pair 60 mm apart,
written in millimetres, is already beyond it."""


@dataclass(frozen=True, slots=True)
class Format:
    """A file format of another tool."""

    name: str
    description: str
    recognises: Callable[[str], bool]
    """Whether a text is in this format."""
    read: Callable[[Path, str], ForeignRig]
    write: Callable[[Rig], Written] | None = None

    @property
    def can_export(self) -> bool:
        """Whether a rig can be written in this format; every format can be imported."""
        return self.write is not None


FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        form.name: form
        for form in (
            Format(
                anipose.NAME,
                "aniposelib, Pose2Sim and Caliscope TOML",
                anipose.recognises,
                anipose.read,
                anipose.write,
            ),
            Format(
                colmap.NAME,
                "COLMAP rig configuration, rig_config.json",
                colmap.recognises,
                colmap.read,
                colmap.write,
            ),
            Format(kalibr.NAME, "Kalibr camchain.yaml", kalibr.recognises, kalibr.read, kalibr.write),
            Format(
                multiview_dataset.NAME,
                "dataset.json of a multi-view data set",
                multiview_dataset.recognises,
                multiview_dataset.read,
            ),
        )
    }
)
"""Every format by its name."""


def import_rig(path: Path, *, from_format: str | None, created_utc: str, unit: str | None = None) -> RigDocument:
    """Read another tool's calibration: verdict IMPORTED, the first camera as reference.

    Args:
        path: the file.
        from_format: a name of :data:`FORMATS`, or None to recognise the format by the content.
        created_utc: ISO 8601 time in UTC, for the rig file.
        unit: ``m``, ``cm`` or ``mm``, for formats that do not say; None takes metres, unless that makes a giant.

    Raises:
        UnknownFormatError: for an unknown name, or a content that is not recognised.
        FormatError: for a file that is absent or cannot be read, a missing or malformed entry, or a unit that
            contradicts the file's or is needed.
        OptionError: for a unit that is none of the three.
    """
    data = _bytes_of(path)
    text = _text_of(path, data)
    form = _known(from_format, "--from", path) if from_format else _recognised(path, text)
    foreign = form.read(path, text)
    chosen, said_by = _unit(path, form, foreign, unit)
    try:
        rig = foreign.rig(site=path.stem, metres_per_unit=METRES_PER_UNIT[chosen])
    except ValueError as error:
        do_next = "give every camera a name of its own"
        raise FormatError(str(error), where=path, expected="names that differ", do_next=do_next) from error
    if said_by == "assumed":
        _refuse_giant(path, largest_distance_m(rig))
    return document_of_rig(
        rig,
        created_utc=created_utc,
        inputs_sha256=hashlib.sha256(data).hexdigest(),
        options={"from_format": form.name, "unit": chosen, "unit_from": said_by},
        extensions=foreign.extensions,
    )


def export_rig(document: RigDocument, path: Path, to_format: str) -> list[str]:
    """Write a rig in another tool's format.

    Returns:
        the conventions written, one line each: frames, units, coefficients, pixel centres.

    Raises:
        UnknownFormatError: for a name that is unknown, or of a format that can only be imported.
        LossyExportError: where the format has no place for a coefficient that is not zero; nothing is written.
        RigFileError: where the folder is absent or cannot be written.
    """
    form = _known(to_format, "--to", path)
    if form.write is None:
        exportable = [known.name for known in FORMATS.values() if known.can_export]
        problem = f"{form.name} can be imported only"
        raise UnknownFormatError(problem, where=path, formats=exportable, got=form.name, option="--to")
    written = form.write(rig_of(document))
    write_atomically(path, written.text)
    return list(written.conventions)


def _known(name: str, option: str, path: Path) -> Format:
    if name not in FORMATS:
        problem = f"there is no format {name!r}"
        raise UnknownFormatError(problem, where=path, formats=list(FORMATS), got=name, option=option)
    return FORMATS[name]


def _recognised(path: Path, text: str) -> Format:
    matches = [form for form in FORMATS.values() if form.recognises(text)]
    if len(matches) == 1:
        return matches[0]
    if _is_rig_file(text):
        do_next = "use it as it is: every command takes it"
        raise FormatError("this is a rig file already", where=path, expected="another tool's file", do_next=do_next)
    got = " and ".join(form.name for form in matches) or "none of them"
    problem = "cannot tell the format of this file"
    raise UnknownFormatError(problem, where=path, formats=list(FORMATS), got=got, option="--from")


def _is_rig_file(text: str) -> bool:
    try:
        content = json.loads(text)
    except ValueError:
        return False
    return isinstance(content, dict) and content.get("format") == RIG_FORMAT


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        problem = "no such file" if isinstance(error, FileNotFoundError) else "cannot read this file"
        do_next = "check the path"
        raise FormatError(
            problem, where=path, expected="a calibration file", got=error.strerror, do_next=do_next
        ) from error


def _text_of(path: Path, data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        got = f"a byte that is not UTF-8 at {error.start}"
        raise UnknownFormatError(
            "this is not a text file", where=path, formats=list(FORMATS), got=got, option="--from"
        ) from error


def _unit(path: Path, form: Format, foreign: ForeignRig, unit: str | None) -> tuple[str, str]:
    """The unit of length, and who said so: ``file``, ``option`` or ``assumed``."""
    if unit is not None and unit not in METRES_PER_UNIT:
        raise OptionError("--unit", expected="one of " + ", ".join(METRES_PER_UNIT), got=unit)
    if foreign.unit is None:
        return (unit, "option") if unit else ("m", "assumed")
    if unit not in (None, foreign.unit):
        raise FormatError(
            f"this {form.name} file is in {foreign.unit}",
            where=path,
            expected=f"--unit {foreign.unit}, or no --unit",
            got=f"--unit {unit}",
            do_next="leave --unit out",
        )
    return foreign.unit, "file"


def _refuse_giant(path: Path, distance_m: float) -> None:
    if distance_m > LARGEST_ASSUMED_METRES:
        raise FormatError(
            "the file does not say its unit of length, and metres are unlikely",
            where=path,
            expected=f"cameras up to {LARGEST_ASSUMED_METRES:g} m apart",
            got=f"two cameras {distance_m:.6g} apart",
            do_next="say the unit with --unit mm, --unit cm or --unit m",
        )
