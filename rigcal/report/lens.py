"""The report of ``rigcal intrinsics`` for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from rigcal.camera import FOCAL_AND_CENTRE
from rigcal.report.numbers import fixed, with_sigma
from rigcal.report.text import findings_parts, heading, plain, table
from rigcal.report.words import counted
from rigcal.rigdocument import ViewsEntry


def lens_report(document: Mapping[str, Any]) -> RenderableType:
    """The report of a lens file, :func:`rigcal.lensfile.lens_document`, as something that a rich console prints."""
    return Group(*_parts(document))


def _parts(document: Mapping[str, Any]) -> Iterator[RenderableType]:
    cameras = document["cameras"]
    views = [ViewsEntry.model_validate(camera["views"]) for camera in cameras]
    yield Text(f"{counted(len(cameras), 'lens', 'lenses')} calibrated, board {plain(document['board'])}", style="bold")
    yield heading("Lenses")
    rows = [
        [
            plain(camera["id"]),
            camera["model"],
            "x".join(str(side) for side in camera["size_wh"]),
            f"{seen.used}/{seen.detected}/{seen.frames}",
            fixed(camera["rmse_px"]["intrinsic"]),
        ]
        for camera, seen in zip(cameras, views, strict=True)
    ]
    yield table(["camera", "model", "size, px", "used/detected/frames", "RMSE, px"], rows, left=(0, 1))
    yield heading("Coefficients with one sigma (fx, fy, cx, cy in px)")
    for camera in cameras:
        yield Text(plain(camera["id"]))
        yield Padding(Text(_coefficients(camera)), (0, 0, 0, 2))
    named = [(camera["id"], seen) for camera, seen in zip(cameras, views, strict=True)]
    yield from findings_parts(named, "in the lens file, under cameras[].views.findings")


def _coefficients(camera: Mapping[str, Any]) -> str:
    """Two lines: focal lengths and centre, then the distortion."""
    parts = {
        name: f"{name} {with_sigma(value, camera['sigma'].get(name))}" for name, value in camera["coefficients"].items()
    }
    first = ", ".join(parts[name] for name in FOCAL_AND_CENTRE)
    return f"{first}\n{', '.join(part for name, part in parts.items() if name not in FOCAL_AND_CENTRE)}"
