"""The calibration report as one HTML page: nothing loaded from elsewhere, the same bytes for one rig.

Everything is there without its one script, which turns the picture in 3D; the page's policy allows that script alone.
"""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path

import numpy as np
from jinja2 import Template

from rigcal.camera import FOCAL_AND_CENTRE, MODELS
from rigcal.errors import EvidenceError
from rigcal.evidence import Evidence
from rigcal.report import numbers, solved, words
from rigcal.report.coverage import Coverage, coverage_of
from rigcal.report.overlap import overlap_graph
from rigcal.report.paper import beside_paper
from rigcal.report.pictures import picture_figures
from rigcal.report.plan import plan_of
from rigcal.report.rays import horizontal_fov_deg
from rigcal.report.residuals import ResidualFigure, residual_figure
from rigcal.report.scene import scene_of
from rigcal.report.spreads import WANTED_TILT_DEG, Histogram, histograms_of
from rigcal.report.templates import page_environment
from rigcal.rigdocument import CameraEntry, GateEntry, RigDocument
from rigcal.rigfile import readable_json, rig_of

RMSE_TOLERANCE = 0.01
"""Share by which the residuals' RMSE may differ from the rig file's before the page says that they do not belong to it;
measured within 1e-13 for those that do."""
SCENE_POINTS = {"scene_sigma_m": "a point at the scene's centre"}
"""Gates on the sigma of a point that the rig triangulates, and where that point lies."""
FEW_CAMERAS = 6
"""Cameras whose table of pairs has room beside the graph."""
FINDINGS_SHOWN = 6
"""Findings of a camera that are unfolded."""


@dataclass(frozen=True, slots=True)
class CameraPage:
    """What the page says of one camera."""

    camera: CameraEntry
    residuals: ResidualFigure | None = None
    coverage: Coverage | None = None
    spreads: tuple[Histogram, ...] = ()
    problem: str = ""
    """What is wrong with its residuals in words; empty: nothing."""


def html_report(document: RigDocument, evidence: Evidence | None, *, title: str | None = None) -> str:
    """The report of a rig file as one page that works offline, on a phone and printed on A4.

    Args:
        document: The rig file's content.
        evidence: The residuals beside it; without them the page says that they are missing.
        title: Heading of the page; the site's name where it is not given.

    Raises:
        EvidenceError: where the residuals are of other cameras than the rig.
    """
    if evidence is not None and set(evidence.camera_ids) != set(document.camera_ids):
        raise EvidenceError(expected=document.camera_ids, got=evidence.camera_ids)
    rig = rig_of(document)
    centres = {camera.id: camera.cam_from_rig.inverse().translation_m for camera in rig.cameras}
    return _template().render(
        document=document,
        title=title or f"Calibration of {document.site}",
        sentence=words.verdict_sentence(document),
        actions=words.next_actions(document),
        points=words.open_points(document),
        facts=_facts(document),
        has_rmse=any(value is not None for c in document.cameras for value in c.rmse_px.model_dump().values()),
        failed_cells={(gate.name, gate.camera) for gate in words.failed_gates(document)},
        failed=_by_name(words.failed_gates(document)),
        passed=_by_name(tuple(gate for gate in document.gates if gate.passed)),
        has_evidence=evidence is not None,
        has_positions=evidence is not None and len(evidence.board_idx) > 0,
        plan=plan_of(document, evidence),
        scene=scene_of(document, evidence),
        graph=overlap_graph(document),
        camera_pages=tuple(_camera_page(camera, document, evidence) for camera in document.cameras),
        pictures=picture_figures(document, evidence) if evidence else (),
        paper_rows=beside_paper(document),
        scene_sigmas=_scene_sigmas(document),
        pairs={frozenset(pair.cameras): pair for pair in document.pairs},
        centres=centres,
        distances={camera_id: float(np.linalg.norm(centre)) for camera_id, centre in centres.items()},
        fields_of_view={camera.id: horizontal_fov_deg(camera.camera) for camera in rig.cameras},
        links=words.chain_links(document),
        instants=words.instants_sentence(document),
        held=words.held_sentence(document),
        graph_sentences=solved.graph_sentences(document),
        solve_sentences=solved.solve_sentences(document),
    )


@cache
def _template() -> Template:
    environment = page_environment()
    environment.filters |= {
        "fixed": numbers.fixed,
        "scaled": numbers.scaled,
        "signed": numbers.signed,
        "short_digest": words.short_digest,
        "drawn": words.drawn,
        "gate_value": words.gate_value,
        "gate_limit": words.gate_limit,
        "gate_meaning": words.gate_meaning,
        "findings_counts": words.findings_counts,
        "json": readable_json,
    }
    environment.globals |= {
        "counted": words.counted,
        "with_sigma": numbers.with_sigma,
        "frozenset": frozenset,
        "few_cameras": FEW_CAMERAS,
        "findings_shown": FINDINGS_SHOWN,
        "wanted_tilt": "{:g} to {:g}°".format(*WANTED_TILT_DEG),
        "script": _script(),
        "script_digest": "sha256-" + base64.b64encode(hashlib.sha256(_script().encode()).digest()).decode("ascii"),
        "rmse_meanings": words.RMSE_MEANINGS,
        "focal_and_centre": FOCAL_AND_CENTRE,
        "distortion_names": {model: names[len(FOCAL_AND_CENTRE) :] for model, names in MODELS.items()},
    }
    return environment.get_template("report.html.j2")


@cache
def _script() -> str:
    return (Path(__file__).parent / "turn.js").read_text(encoding="utf-8")


def _by_name(gates: tuple[GateEntry, ...]) -> list[tuple[str, list[GateEntry]]]:
    """Gates of one name together, names in the order in which they first appear."""
    order = list(dict.fromkeys(gate.name for gate in gates))
    grouped = groupby(sorted(gates, key=lambda gate: order.index(gate.name)), key=lambda gate: gate.name)
    return [(name, list(group)) for name, group in grouped]


def _facts(document: RigDocument) -> list[tuple[str, str, str]]:
    """The few figures that sum the rig up: what, figure, whose."""
    facts = [("cameras", str(len(document.cameras)), f"reference {document.reference}")]
    refined = [(c.rmse_px.refined, c.id) for c in document.cameras if c.rmse_px.refined is not None]
    if refined:
        worst, camera_id = max(refined)
        facts.append(("greatest refined RMSE", f"{numbers.fixed(worst)} px", camera_id))
    positions = [(c.sigma.position_m, c.id) for c in document.cameras if c.sigma is not None]
    if len(positions) > 1:
        worst, camera_id = max(positions)
        facts.append(("least certain position", f"± {numbers.scaled(worst, 1e3, 1)} mm", f"{camera_id}, one sigma"))
    for what, sigma_m in _scene_sigmas(document):
        facts.append((what, f"± {numbers.scaled(sigma_m, 1e3, 1)} mm", "one sigma"))
    return facts


def _scene_sigmas(document: RigDocument) -> list[tuple[str, float]]:
    """What a sigma of a 3D point is of, and the sigma in metres."""
    sigmas = [
        (SCENE_POINTS[gate.name], gate.value)
        for gate in document.gates
        if gate.name in SCENE_POINTS and gate.value is not None
    ]
    edge_m = solved.edge_sigma_m(document)
    return sigmas if edge_m is None else [*sigmas, ("a point at the scene's edges, at worst", edge_m)]


def _camera_page(camera: CameraEntry, document: RigDocument, evidence: Evidence | None) -> CameraPage:
    if evidence is None or not (figure := residual_figure(camera, evidence)):
        return CameraPage(camera)
    return CameraPage(
        camera,
        figure,
        coverage_of(camera, evidence),
        histograms_of(camera, document.calibration_board, evidence),
        _contradiction(camera.rmse_px.refined, figure.rmse_px),
    )


def _contradiction(stated_px: float | None, measured_px: float | None) -> str:
    if stated_px is None or measured_px is None:
        return ""
    if abs(stated_px - measured_px) <= RMSE_TOLERANCE * stated_px + 1e-6:
        return ""
    return (
        f"these residuals have an RMSE of {numbers.fixed(measured_px, 3)} px, the rig file states "
        f"{numbers.fixed(stated_px, 3)} px: they are of another calibration. Run rigcal calibrate again."
    )
