"""Import with recognition by content, export with the conventions that were written."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rigcal.errors import FormatError, OptionError, UnknownFormatError
from rigcal.formats._foreign import METRES_PER_UNIT, ForeignRig, largest_distance_m
from rigcal.formats._registry import FORMATS, Format
from rigcal.formats._source import Source, read_source, write_folder
from rigcal.rigdocument import FORMAT as RIG_FORMAT
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import document_of_rig, rig_of, write_atomically

LARGEST_ASSUMED_METRES = 50.0
"""A file that does not say its unit is taken for metres up to this distance between cameras: a stereo pair 60 mm apart,
written in millimetres, is already beyond it."""


def import_rig(
    path: Path, *, from_format: str | None, created_utc: str, unit: str | None = None, common_is_world: bool = False
) -> RigDocument:
    """Read another tool's calibration: verdict IMPORTED, the first camera as reference.

    Args:
        path: the file, or the folder of a format of several files.
        from_format: a name of :data:`FORMATS`, or None to recognise the format by the content.
        created_utc: ISO 8601 time in UTC, for the rig file.
        unit: ``m``, ``cm`` or ``mm``, for formats that do not say; None takes metres, unless that makes a giant.
        common_is_world: whether the file's common frame has z up and the floor at 0: it becomes the world.

    Raises:
        UnknownFormatError: for an unknown name, or a content that is not recognised.
        FormatError: for a file that is absent or cannot be read, a missing or malformed entry, a unit that
            contradicts the file's or is needed, or a world where the format has none.
        OptionError: for a unit that is none of the three.
    """
    source = read_source(path)
    form = _known(from_format, "--from", path) if from_format else _recognised(source)
    foreign = _reader(form, path)(source)
    chosen, said_by = _unit(path, form, foreign, unit)
    if common_is_world:
        foreign = _with_world(path, form, foreign)
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
        inputs_sha256=source.sha256,
        options={"from_format": form.name, "unit": chosen, "unit_from": said_by},
        extensions=foreign.extensions,
    )


def export_rig(document: RigDocument, path: Path, to_format: str) -> list[str]:
    """Write a rig in another tool's format: the file ``path``, or the folder ``path`` for a format of several files.

    Returns:
        the conventions written, one line each: frames, units, coefficients, pixel centres.

    Raises:
        UnknownFormatError: for a name that is unknown, or of a format that can only be imported.
        LossyExportError: where the format has no place for a coefficient that is not zero; nothing is written.
        ForeignNameError: where it has no place for a camera's name; nothing is written.
        FormatError: where it cannot hold this rig otherwise, or the folder holds other files.
        RigFileError: where the file's folder is absent or cannot be written; OutputError for a folder.
    """
    form = _known(to_format, "--to", path)
    if form.write is None:
        exportable = [known.name for known in FORMATS.values() if known.can_export]
        problem = f"{form.name} can be imported only"
        raise UnknownFormatError(problem, where=path, formats=exportable, got=form.name, option="--to")
    written = form.write(rig_of(document))
    if isinstance(written.content, str):
        write_atomically(path, written.content)
    else:
        write_folder(path, written.content)
    return list(written.conventions)


def _known(name: str, option: str, path: Path) -> Format:
    if name not in FORMATS:
        problem = f"there is no format {name!r}"
        raise UnknownFormatError(problem, where=path, formats=list(FORMATS), got=name, option=option)
    return FORMATS[name]


def _reader(form: Format, path: Path) -> Callable[[Source], ForeignRig]:
    if form.read is None:
        importable = [known.name for known in FORMATS.values() if known.can_import]
        problem = f"{form.name} can be exported only"
        raise UnknownFormatError(problem, where=path, formats=importable, got=form.name, option="--from")
    return form.read


def _recognised(source: Source) -> Format:
    matches = [form for form in FORMATS.values() if form.recognises(source)]
    if len(matches) == 1:
        return matches[0]
    if any(_is_rig_file(text) for text in source.texts.values()):
        do_next = "use it as it is: every command takes it"
        raise FormatError(
            "this is a rig file already", where=source.path, expected="another tool's file", do_next=do_next
        )
    if source.is_folder and not matches:
        _refuse_folder(source)
    got = " and ".join(form.name for form in matches) or "none of them"
    problem = "cannot tell the format of this " + ("folder" if source.is_folder else "file")
    raise UnknownFormatError(
        problem,
        where=source.path,
        formats=[name for name, form in FORMATS.items() if form.can_import],
        got=got,
        option="--from",
    )


def _refuse_folder(source: Source) -> None:
    """A folder that is of no format may hold a file that is: name it."""
    alone = [Source(source.path / name, {name: data}) for name, data in source.files.items()]
    found = [f"{file.path.name} ({form.name})" for file in alone for form in FORMATS.values() if form.recognises(file)]
    if found:
        raise FormatError(
            "this folder is of no format, but it holds a file that is",
            where=source.path,
            expected="a file, or the folder of a format of several files",
            got=", ".join(found),
            do_next="give that file instead of the folder",
        )


def _is_rig_file(text: str) -> bool:
    try:
        content = json.loads(text)
    except ValueError:
        return False
    return isinstance(content, dict) and content.get("format") == RIG_FORMAT


def _with_world(path: Path, form: Format, foreign: ForeignRig) -> ForeignRig:
    if not form.has_common_frame:
        raise FormatError(
            f"{form.name} has no world frame",
            where=path,
            expected="a format whose poses are from a common frame",
            got="poses from camera to camera",
            do_next="leave --world out, and set the world with rigcal world",
        )
    return replace(foreign, common_is_world=True)


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
