"""Whether a camera that seems to have moved has another lens setting instead: a zoom or a new focus.

A camera whose focal length changed sees boards as if it had moved along its axis, but no pose explains all of them: its
residual stays although its pose is free. So its focal lengths are freed too, and must differ from the calibrated ones
by more than their uncertainty then and now allows, and explain what the pose leaves. (A shifted centre cannot be told
from a small turn, and counts as one.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rigcal.bundle import POSE, SolveOptions, rmse_px, solve
from rigcal.drift.measured import MeasuredGroup
from rigcal.geometry import Bools
from rigcal.rigdocument import SigmaEntry

SIGMAS = 5.0
"""Change of the focal lengths over its uncertainty from which it counts."""
EXPLAINED = 0.1
"""Share of the squared residual that it must explain: a simulated zoom by 0.3 % at full HD and 0.2 px of noise explains
a quarter, and shifts the image's corner by 3 px."""


@dataclass(frozen=True, slots=True)
class LensChange:
    """How a lens differs from the calibrated one."""

    focal_percent: float
    """Change of the focal length."""
    focal_sigma_percent: float
    rmse_px: float
    """Residual of the camera with the calibrated lens, its pose free."""
    freed_rmse_px: float
    """Residual with its focal lengths free too."""


def lens_change(group: MeasuredGroup, camera_id: str, sigma: SigmaEntry | None) -> LensChange | None:
    """The change of a camera's focal length; None where there is none that its views could show.

    Args:
        group: The camera and those that share views with it.
        camera_id: The camera.
        sigma: Uncertainty of the calibrated lens, where the rig file states it.
    """
    joint, index = group.joint, group.poses.ids.index(camera_id)
    params = tuple(_focal(len(lens.params), camera == index) for camera, lens in enumerate(joint.cameras))
    freedom = replace(joint.freedom, params=params, prior_mean=(), prior_information=())
    options = SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01))
    freed = solve(joint.observations, joint.solution.state, freedom, options)
    before = rmse_px(joint.residuals_of(index)) or 0.0
    after = rmse_px(freed.residuals_px[joint.observations.camera_idx == index]) or 0.0
    focal = joint.cameras[index].params[:2]
    gap = freed.state.cameras[index].params[:2] - focal
    covariance = freed.camera_covariance(index, (POSE, POSE + 1))
    if sigma is not None:
        covariance += np.diag([sigma.fx_px, sigma.fy_px]) ** 2
    sigmas = float(np.sqrt(gap @ np.linalg.solve(covariance, gap) / 2))
    if sigmas < SIGMAS or after**2 > (1 - EXPLAINED) * before**2:
        return None
    percent = 100 / focal.mean()
    mean = np.array([0.5, 0.5])
    return LensChange(float(percent * gap.mean()), float(percent * np.sqrt(mean @ covariance @ mean)), before, after)


def _focal(count: int, free: bool) -> Bools:
    return np.arange(count) < (2 if free else 0)
