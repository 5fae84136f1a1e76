"""The rig file ``NAME.rig.json``: digests, reading that refuses damage, writing that never leaves half a file.

The digest is computed over the parsed JSON as it stands in the file, before any model touches it, so that another
program's file (which may write 1 where Python writes 1.0) verifies as well, and one changed digit does not.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from pydantic import ValidationError

from rigcal import __version__
from rigcal.board import Board, board_to_dict
from rigcal.camera import MODELS, Camera
from rigcal.errors import RigFileDigestError, RigFileError, RigFileSchemaError, RigFileVersionError
from rigcal.geometry import Floats
from rigcal.rig import ClockModel, Rig, RigCamera
from rigcal.rigdocument import (
    FORMAT,
    VERSION,
    CameraEntry,
    ClockEntry,
    CovarianceEntry,
    HistoryEntry,
    PoseEntry,
    ProvenanceEntry,
    RigDocument,
    RmseEntry,
    ViewsEntry,
)
from rigcal.site import entry_name

__all__ = [
    "SCHEMA_PATH",
    "RigDocument",
    "digest",
    "document_of_rig",
    "geometry_digest",
    "read_rigfile",
    "readable_json",
    "rig_of",
    "schema",
    "write_atomically",
    "write_rigfile",
    "write_schema",
]

SCHEMA_PATH = Path(__file__).with_name("rig.schema.json")
"""The published JSON Schema, beside this module; :func:`write_schema` renews it."""
_NOT_GEOMETRY = ("geometry_digest", "created_utc", "history", "provenance")
_CLOCK_GATE, _CLOCKS = "clock_error_m", "clocks"


def digest(document: Mapping[str, Any]) -> str:
    """``sha256:`` and the SHA-256 of a parsed rig file without its ``digest``.

    Canonical form: UTF-8 JSON, keys sorted, separators ``,`` and ``:``, characters outside ASCII as they are, floats
    as the shortest text that reads back to the same value.
    """
    return _sha256({key: value for key, value in document.items() if key != "digest"})


def geometry_digest(document: Mapping[str, Any]) -> str:
    """Like :func:`digest`, without clocks, history, times and provenance: equal for equal input, options and seed."""
    left_out = {"digest", *_NOT_GEOMETRY}
    content = {key: value for key, value in document.items() if key not in left_out}
    content["cameras"] = [{k: v for k, v in camera.items() if k != "clock"} for camera in content["cameras"]]
    content["gates"] = [gate for gate in content["gates"] if gate["name"] != _CLOCK_GATE]
    content["extensions"] = _without_clocks(content.get("extensions", {}))
    return _sha256(content)


def _without_clocks(extensions: Mapping[str, Any]) -> dict[str, Any]:
    ours = extensions.get("rigcal")
    kept = {k: v for k, v in ours.items() if k != _CLOCKS} if isinstance(ours, dict) else ours
    others = {name: value for name, value in extensions.items() if name != "rigcal"}
    return others | ({"rigcal": kept} if kept else {})


def _sha256(content: Mapping[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return "sha256:" + hashlib.sha256(text.encode("utf-8")).hexdigest()


def write_rigfile(document: RigDocument, path: Path) -> RigDocument:
    """Write a rig file with its digests; a reader sees the old file or the new one, never a part.

    Returns:
        the document as written, with both digests.

    Raises:
        RigFileError: where the folder is absent or cannot be written.
    """
    content = document.model_dump(mode="json")
    content["geometry_digest"] = geometry_digest(content)
    content["digest"] = digest(content)
    written = RigDocument.model_validate(content)
    write_atomically(path, readable_json(content) + "\n")
    return written


def readable_json(value: Any, depth: int = 0) -> str:
    """JSON with one line for each list or object that holds no other, so that a pose or a matrix row is one line."""
    if isinstance(value, dict):
        items = [f"{json.dumps(key, ensure_ascii=False)}: {readable_json(v, depth + 1)}" for key, v in value.items()]
        brackets, inner = "{}", list(value.values())
    elif isinstance(value, list):
        items, brackets, inner = [readable_json(v, depth + 1) for v in value], "[]", value
    else:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    if any(isinstance(v, dict | list) and v for v in inner):
        margin = "\n" + " " * depth
        return brackets[0] + ",".join(f"{margin} {item}" for item in items) + margin + brackets[1]
    return brackets[0] + ", ".join(items) + brackets[1]


def write_atomically(path: Path, text: str) -> None:
    """Write UTF-8 text to a temporary file in the same folder, flush it to the disk, and rename it over ``path``.

    Raises:
        RigFileError: where the folder is absent or cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        raise RigFileError(
            "cannot write this file",
            where=path,
            expected="a folder that exists and can be written",
            got=error.strerror,
            do_next="make the folder, or give another path with -o",
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def read_rigfile(path: Path) -> RigDocument:
    """Read and verify a rig file.

    Raises:
        RigFileSchemaError: where the file is absent, no JSON, no rig file, or has a missing, unknown, malformed or
            contradictory entry.
        RigFileVersionError: where a newer rigcal wrote it (judged before any other entry).
        RigFileDigestError: where the content was changed after it was written.
    """
    content = _parsed(path)
    if content.get("format") != FORMAT:
        raise RigFileSchemaError(path, entry="format", expected=repr(FORMAT), got=repr(content.get("format")))
    version = content.get("version")
    if isinstance(version, int | float) and version > VERSION:
        raise RigFileVersionError(path, expected=VERSION, got=version)
    try:
        document = RigDocument.model_validate(content)
    except ValidationError as error:
        _raise_schema_error(path, content, error)
    for stated, actual in ((document.digest, digest(content)), (document.geometry_digest, geometry_digest(content))):
        if stated != actual:
            raise RigFileDigestError(path, expected=stated or "(there is none in the file)", got=actual)
    return document


def _parsed(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
        json.dumps(content, ensure_ascii=False).encode("utf-8")  # half a surrogate pair has no UTF-8, so no digest
    except OSError as error:
        problem = "no such file" if isinstance(error, FileNotFoundError) else "it cannot be read"
        raise RigFileSchemaError(path, entry=problem, expected="a rig file", got=error.strerror) from error
    except (ValueError, RecursionError) as error:
        raise RigFileSchemaError(path, entry="it is not JSON", expected="JSON text", got=error) from error
    if not isinstance(content, dict):
        raise RigFileSchemaError(
            path, entry="(top level)", expected="a JSON object", got=f"a JSON {type(content).__name__}"
        )
    return content


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _raise_schema_error(path: Path, content: dict[str, Any], error: ValidationError) -> NoReturn:
    first = error.errors()[0]
    location = _location_in(content, first["loc"])
    if first["type"] == "refusal":
        context = first["ctx"]
        entry = (entry_name(location) if location else "") + context["entry"]
        raise RigFileSchemaError(path, entry=entry.removeprefix("."), expected=context["expected"], got=context["got"])
    if first["type"] == "missing":
        entry = entry_name((*location, first["loc"][-1]))
        raise RigFileSchemaError(path, entry=entry, expected="this entry", got="nothing")
    got = _shortened(repr(first["input"]))
    raise RigFileSchemaError(path, entry=entry_name(location), expected=first["msg"].lower(), got=got)


def _location_in(content: Any, location: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """The parts of a validation error's location that stand in the file (pydantic adds the kinds of unions)."""
    parts: list[int | str] = []
    for part in location:
        stands = part in content if isinstance(content, dict) else isinstance(content, list) and isinstance(part, int)
        if stands:
            content = content[part]
            parts.append(part)
    return tuple(parts)


def _shortened(text: str) -> str:
    return text if len(text) <= 80 else text[:77] + "..."


def rig_of(document: RigDocument) -> Rig:
    """The rig that a document describes."""
    return Rig(
        site=document.site,
        cameras=tuple(_rig_camera(entry, document.covariance) for entry in document.cameras),
        reference=document.reference,
        verdict=document.verdict,
        world_from_rig=document.world_from_rig.pose if document.world_from_rig else None,
        digest=document.digest,
    )


def _rig_camera(entry: CameraEntry, covariance: CovarianceEntry | None) -> RigCamera:
    params = np.array([entry.coefficients[name] for name in MODELS[entry.model]])
    clock = ClockModel(**entry.clock.model_dump()) if entry.clock else None
    camera = Camera(entry.model, entry.size_wh, params)
    known = _pose_covariance(covariance, entry.id) if covariance else None
    return RigCamera(entry.id, camera, entry.cam_from_rig.pose, entry.serial, clock, known)


def _pose_covariance(entry: CovarianceEntry, camera_id: str) -> Floats:
    """(6, 6) of a camera's pose; zeros for one that the matrix leaves out, as it does the reference."""
    name = f"{camera_id}.rotation_rad"
    if name not in entry.order:
        return np.zeros((6, 6))
    first = 3 * entry.order.index(name)
    return np.array(entry.matrix, dtype=np.float64)[first : first + 6, first : first + 6]


def document_of_rig(
    rig: Rig,
    *,
    created_utc: str,
    inputs_sha256: str,
    options: Mapping[str, Any] | None = None,
    extensions: Mapping[str, Any] | None = None,
    board: Board | None = None,
) -> RigDocument:
    """The document of a rig that another tool calibrated: verdict IMPORTED, no gates, no residuals, no views.

    Args:
        rig: the rig; its own verdict is not used.
        created_utc: ISO 8601 time in UTC.
        inputs_sha256: hexadecimal SHA-256 of the file that the rig came from.
        options: what the import was told, for the provenance.
        extensions: what the file held beside the rig.
        board: the board, where it is known.
    """
    return RigDocument.model_validate(
        {
            "site": rig.site,
            "created_utc": created_utc,
            "reference": rig.reference,
            "board": board_to_dict(board) if board else None,
            "cameras": [_camera_entry(camera, rig.reference) for camera in rig.cameras],
            "pairs": [],
            "world_from_rig": PoseEntry.of(rig.world_from_rig) if rig.world_from_rig else None,
            "gates": [],
            "verdict": "IMPORTED",
            "history": [HistoryEntry(command="import", utc=created_utc)],
            "provenance": ProvenanceEntry(
                rigcal=__version__, inputs_sha256=inputs_sha256, options=dict(options or {}), packages={}
            ),
            "extensions": dict(extensions or {}),
        }
    )


def _camera_entry(camera: RigCamera, reference: str) -> CameraEntry:
    return CameraEntry(
        id=camera.id,
        serial=camera.serial,
        size_wh=camera.camera.size_wh,
        model=camera.camera.model,
        coefficients=camera.camera.coefficients,
        cam_from_rig=PoseEntry.of(camera.cam_from_rig),
        rmse_px=RmseEntry(),
        chain=(reference,) if camera.id == reference else (reference, camera.id),
        views=ViewsEntry(frames=0, detected=0, used=0, findings=()),
        clock=ClockEntry.model_validate(camera.clock, from_attributes=True) if camera.clock else None,
    )


def schema() -> dict[str, Any]:
    """The JSON Schema of the rig file."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | RigDocument.model_json_schema()


def write_schema(path: Path = SCHEMA_PATH) -> None:
    """Write the JSON Schema of the rig file."""
    write_atomically(path, readable_json(schema()) + "\n")
