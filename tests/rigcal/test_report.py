"""Claims about the calibration report: what it says, that it says all of it, and that it is one harmless page."""

import copy
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from rich.console import Console

from rigcal.camera import Camera
from rigcal.errors import EvidenceError
from rigcal.evidence import Evidence
from rigcal.geometry import Pose
from rigcal.report import html_report, lens_report, text_report
from rigcal.report.numbers import beside_limit, fixed, round_down, round_up, signed, with_sigma
from rigcal.report.plan import horizontal_fov_deg, plan_of
from rigcal.report.residuals import SHOWN_CORNERS, residual_figure, spread
from rigcal.report.words import gate_meaning, next_actions
from rigcal.rig import Rig, RigCamera
from rigcal.rigdocument import PoseEntry, RigDocument
from rigcal.rigfile import document_of_rig
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig

UTC = "2026-11-22T09:30:01Z"
PIXELS = 0.3
"""RMSE that the made-up residuals have in every camera, px."""


def camera_entry(camera: RigCamera, index: int, ids):
    """A camera with figures that no other camera has, so that a test finds each of them in the report."""
    alone = index == 0
    return {
        "id": camera.id,
        "serial": camera.serial,
        "size_wh": camera.camera.size_wh,
        "model": camera.camera.model,
        "coefficients": camera.camera.coefficients,
        "cam_from_rig": PoseEntry.of(camera.cam_from_rig).model_dump(),
        "rmse_px": {
            "intrinsic": 0.11 + index / 1000,
            "pairwise": None if alone else 0.61 + index / 50,
            "chained": None if alone else 1.57 + index / 10,
            "refined": PIXELS,
            "held_out": 0.41 + index / 50,
            "all": 2.33 + index / 10,
        },
        "chain": ids[: index + 1],
        "sigma": {
            "fx_px": 1.13 + index, "fy_px": 1.17 + index, "cx_px": 2.19 + index, "cy_px": 2.23 + index,
            "position_m": index * 0.0041, "rotation_deg": index * 0.031,
        },
        "views": {"frames": 100 + index, "detected": 60 + index, "used": 40 + index, "findings": []},
        "clock": None,
    }  # fmt: skip


def gate(name, camera, value, limit, passed=True, advice=None):
    return {"name": name, "camera": camera, "value": value, "limit": limit, "passed": passed, "advice": advice}


def content(count=4, *, rename=lambda camera_id: camera_id):
    """The content of a rig file with ``count`` cameras that passed."""
    rig = arc_rig(count, arc_deg=360.0 if count > 8 else 150.0)
    cameras = [replace(camera, id=rename(camera.id)) for camera in rig.cameras]
    ids = [camera.id for camera in cameras]
    free = [f"{camera_id}.{part}" for camera_id in ids[1:] for part in ("rotation_rad", "translation_m")]
    return {
        "site": "hall-3",
        "created_utc": UTC,
        "reference": ids[0],
        "board": {"kind": "checkerboard", "columns": 9, "rows": 6, "square_size_m": 0.06},
        "cameras": [camera_entry(camera, index, ids) for index, camera in enumerate(cameras)],
        "pairs": [
            {"cameras": [one, two], "views": 70 + i, "rmse_px": 0.71 + i / 50}
            for i, (one, two) in enumerate(zip(ids, ids[1:], strict=False))
        ],
        "covariance": {"order": free, "matrix": (np.eye(3 * len(free)) * 1e-6).tolist()} if free else None,
        "world_from_rig": PoseEntry.of(rig.world_from_rig).model_dump(),
        "gates": [
            gate("intrinsic_rmse_px", camera_id, 0.1234 + i / 1000, 0.5) for i, camera_id in enumerate(ids)
        ] + [gate("scene_sigma_m", None, 0.00567, 0.02)],
        "verdict": "PASS",
        "history": [{"command": "calibrate", "utc": UTC, "parent_digest": None}],
        "provenance": {
            "rigcal": "0.1.0", "inputs_sha256": "ab" * 32, "options": {"model": "opencv5"}, "packages": {"numpy": "2.2"},
        },
        "extensions": {"rigcal": {"instants": {"rule": "timestamps.csv", "spread_s": 0.0131, "shared": 36}}},
        "geometry_digest": "sha256:" + "cd" * 32,
        "digest": "sha256:" + "ef" * 32,
    }  # fmt: skip


def document(count=4, **changes) -> RigDocument:
    return RigDocument.model_validate(content(count) | changes)


def evidence_for(rig: RigDocument, corners=300, rejected=0) -> Evidence:
    """Residuals of RMSE :data:`PIXELS` over the used corners of every camera, board centres about the scene."""
    rng = np.random.default_rng(3)
    count = len(rig.cameras)
    residuals = rng.normal(0, 1, (count, corners, 2))
    used = np.arange(corners) >= rejected
    residuals *= PIXELS / np.sqrt((residuals[:, used] ** 2).sum(axis=2).mean(axis=1))[:, None, None]
    residuals[:, ~used] += 40
    sizes = np.array([camera.size_wh for camera in rig.cameras])
    return Evidence(
        rig.camera_ids,
        tuple(("000000",) for _ in rig.cameras),
        np.repeat(np.arange(count), corners),
        np.zeros(count * corners, dtype=int),
        np.tile(np.arange(corners), count),
        np.tile(used, count),
        (rng.uniform(0, 1, (count, corners, 2)) * sizes[:, None]).reshape(-1, 2),
        residuals.reshape(-1, 2),
        rng.normal([0, 1, 5], 0.7, (24, 3)),
    )
