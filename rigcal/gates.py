"""The gates: each holds one figure against its limit, and together they say PASS or RECAPTURE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rigcal import advice
from rigcal.advice import CONTRADICTION_GATES, CameraFigures, RigFigures

AT_LEAST = frozenset({"views", "tilt_spread_deg", "image_coverage", "chain_overlap_views"})
"""Gates whose value must not fall below the limit; all others must not exceed it."""


@dataclass(frozen=True, slots=True)
class Gate:
    """One judged figure."""

    name: str
    """Field of :class:`rigcal.site.GateLimits`."""
    camera: str | None
    """The camera it is about; None: the whole rig."""
    value: float | None
    """None where it could not be measured, which fails the gate."""
    limit: float
    passed: bool
    advice: str | None
    """The next action, where the gate failed."""


def judge(cameras: Sequence[CameraFigures], rig: RigFigures, limits: Mapping[str, float]) -> tuple[Gate, ...]:
    """Every gate, per camera and for the rig; ``limits`` by name, as in :class:`rigcal.site.GateLimits`."""
    failed = [_failed(camera, limits) for camera in cameras]
    contradicting = tuple(c.camera_id for c, names in zip(cameras, failed, strict=True) if names & CONTRADICTION_GATES)
    rig = replace(rig, contradicting=contradicting)
    gates: list[Gate] = []
    for camera, names in zip(cameras, failed, strict=True):
        for name, value in _camera_values(camera).items():
            words = advice.for_camera(name, camera, rig, names, limits) if name in names else None
            gates.append(_gate(name, camera.camera_id, value, limits, words))
    for name, value in _rig_values(rig, len(cameras)).items():
        words = None if _passes(name, value, limits) else advice.for_rig(name, rig, limits)
        gates.append(_gate(name, None, value, limits, words))
    return tuple(gates)


def _failed(camera: CameraFigures, limits: Mapping[str, float]) -> frozenset[str]:
    return frozenset(name for name, value in _camera_values(camera).items() if not _passes(name, value, limits))


def verdict(gates: Sequence[Gate]) -> str:
    """``PASS`` where every gate passed, else ``RECAPTURE``."""
    return "PASS" if all(gate.passed for gate in gates) else "RECAPTURE"


def _passes(name: str, value: float | None, limits: Mapping[str, float]) -> bool:
    return value is not None and (value >= limits[name] if name in AT_LEAST else value <= limits[name])


def _gate(name: str, camera: str | None, value: float | None, limits: Mapping[str, float], words: str | None) -> Gate:
    rounded = None if value is None else float(f"{value:.6g}")
    return Gate(name, camera, rounded, float(limits[name]), _passes(name, value, limits), words)


def _camera_values(camera: CameraFigures) -> dict[str, float | None]:
    """Figures of one camera by gate, in the order in which the gates are told."""
    held_out, refined = camera.held_out_px, max(camera.refined_rmse_px, 1e-9)
    values: dict[str, float | None] = {
        "intrinsic_rmse_px": camera.intrinsic_rmse_px,
        "refined_rmse_px": camera.refined_rmse_px,
        "dropped_share": camera.dropped_share,
        "held_out_ratio": None if held_out is None else held_out / refined,
        "focal_sigma_percent": camera.focal_sigma_percent,
        "views": camera.coverage.views,
        "tilt_spread_deg": camera.coverage.tilt_spread_deg,
        "image_coverage": camera.coverage.share,
    }
    if camera.lens_agreement is not None:
        values["lens_agreement"] = camera.lens_agreement
    if camera.sister is not None:
        values["sister_percent"] = abs(camera.sister.percent)
    if camera.parent_id is not None:
        values["pairwise_rmse_px"] = camera.pairwise_rmse_px
        values["position_sigma_m"] = camera.position_sigma_m
        values["chain_overlap_views"] = camera.chain_overlap_views
    return values


def _rig_values(rig: RigFigures, cameras: int) -> dict[str, float | None]:
    values: dict[str, float | None] = {}
    if cameras > 1:
        values["scene_sigma_m"] = rig.scene_sigma_m
        values["split_half"] = None if rig.split_half is None else rig.split_half.gap
        values["solver_agreement"] = rig.solver_agreement
    if rig.scale is not None:
        values["scale_percent"] = abs(rig.scale.percent)
    return values
