"""Lenses on their own, as ``rigcal intrinsics`` writes them: ``NAME.json``, and any rig file read as one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from rigcal.camera import MODELS, Camera
from rigcal.detections import BoardDetections, Finding
from rigcal.errors import RigFileSchemaError
from rigcal.geometry import Floats
from rigcal.intrinsics import IntrinsicsResult
from rigcal.rigdocument import CameraEntry
from rigcal.rigfile import read_rigfile, readable_json, write_atomically
from rigcal.site import entry_name

FORMAT = "rigcal.intrinsics"


@dataclass(frozen=True, slots=True)
class KnownLens:
    """A lens that was calibrated before."""

    camera: Camera
    rmse_px: float
    """Of the calibration that gave it."""
    covariance: Floats | None = None
    """(P, P) of the coefficients; None where nothing says how surely they are known."""


class _Lens(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    id: str
    size_wh: tuple[int, int]
    model: Literal["opencv4", "opencv5", "opencv8", "fisheye4"]
    coefficients: dict[str, float]
    sigma: dict[str, float]
    covariance: tuple[tuple[float, ...], ...] | None = None
    rmse_px: dict[str, float]
    views: dict[str, Any]


class _LensFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    format: Literal["rigcal.intrinsics"]
    version: Literal[1]
    board: str
    cameras: tuple[_Lens, ...]


def lens_document(
    board: str, cameras: Sequence[BoardDetections], results: Sequence[IntrinsicsResult]
) -> dict[str, Any]:
    """What ``rigcal intrinsics`` writes: one entry per camera, in the words of the rig file."""
    return {
        "format": FORMAT,
        "version": 1,
        "board": board,
        "cameras": [_entry(detections, result) for detections, result in zip(cameras, results, strict=True)],
    }


def _entry(detections: BoardDetections, result: IntrinsicsResult) -> dict[str, Any]:
    names = result.camera.names
    return {
        "id": result.camera_id,
        "size_wh": list(result.camera.size_wh),
        "model": result.camera.model,
        "coefficients": result.camera.coefficients,
        "sigma": dict(zip(names, result.sigma.tolist(), strict=True)),
        "covariance": result.covariance.tolist(),
        "rmse_px": {"intrinsic": result.rmse_px},
        "views": {
            "frames": len(detections.frames),
            "detected": len(detections.views),
            "used": len(result.views),
            "findings": findings_entries((*detections.findings, *result.findings)),
        },
    }


def findings_entries(findings: Sequence[Finding]) -> list[dict[str, str]]:
    """Findings as the files hold them."""
    return [{"frame": f.frame, "action": f.action, "reason": f.reason} for f in findings]


def write_lenses(document: Mapping[str, Any], path: Path) -> None:
    """Write a lens document, to a temporary file that is then renamed."""
    write_atomically(path, readable_json(dict(document)) + "\n")


def read_lenses(path: Path) -> dict[str, KnownLens]:
    """Lenses by camera, from a lens file or a rig file.

    Raises:
        RigFileError: where the file is neither, or is damaged.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise _not_a_lens_file(path, "the file", "a file of rigcal intrinsics, or a rig file", error) from error
    if not (isinstance(content, dict) and content.get("format") == FORMAT):
        return {
            entry.id: KnownLens(
                Camera(entry.model, entry.size_wh, np.array([entry.coefficients[n] for n in MODELS[entry.model]])),
                entry.rmse_px.intrinsic or 0.0,
                _variances(MODELS[entry.model], _sigma_of(entry)),
            )
            for entry in read_rigfile(path).cameras
        }
    try:
        document = _LensFile.model_validate(content)
        return {entry.id: _known(entry) for entry in document.cameras}
    except ValidationError as error:
        first = error.errors()[0]
        raise _not_a_lens_file(path, entry_name(first["loc"]), first["msg"], first["input"]) from error
    except (KeyError, ValueError) as error:
        raise _not_a_lens_file(path, "cameras", "the coefficients of each camera's model", error) from error


def _known(entry: _Lens) -> KnownLens:
    params = np.array([entry.coefficients[name] for name in MODELS[entry.model]])
    covariance = _variances(MODELS[entry.model], entry.sigma)
    if entry.covariance is not None:
        covariance = np.array(entry.covariance, dtype=np.float64).reshape(covariance.shape)
    return KnownLens(Camera(entry.model, entry.size_wh, params), entry.rmse_px["intrinsic"], covariance)


def _variances(names: Sequence[str], sigma: Mapping[str, float]) -> Floats:
    """(P, P) diagonal covariance from one sigma of each coefficient, where it is known."""
    return np.diag([sigma.get(name, 0.0) ** 2 for name in names])


def _sigma_of(entry: CameraEntry) -> dict[str, float]:
    sigma = entry.sigma
    return {"fx": sigma.fx_px, "fy": sigma.fy_px, "cx": sigma.cx_px, "cy": sigma.cy_px} if sigma else {}


def _not_a_lens_file(path: Path, entry: str, expected: str, got: object) -> RigFileSchemaError:
    return RigFileSchemaError(path, entry=entry, expected=expected, got=got)
