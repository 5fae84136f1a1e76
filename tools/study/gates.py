"""What the curves say of rigcal's default gates, in sentences: whether an error at the limit costs anything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf

import numpy as np

from rigcal.geometry import Floats
from rigcal.site import GateLimits
from tools.study.faults import Axis
from tools.study.figures import COST, Curve

DETECTORS: Mapping[str, str] = {"open": "by an exact detector", "measured": "by the networks' errors"}
"""The curves that speak. The second is what a site would have today; its own errors hide what little a calibration
costs, and what that would cost with better networks is told by the first."""
_SCENE = ("position", "rotation")
"""Kinds of error that misplace the scene; ``orbit`` leaves its middle where it is."""


def gate_sentences(curves: Sequence[Curve], axes: Mapping[str, Axis]) -> Iterator[str]:
    """One for each detector, gate and kind of error that it limits."""
    for detector, words in DETECTORS.items():
        own = {curve.axis: curve for curve in curves if curve.detector == detector}
        for axis, curve in own.items():
            gate = axes[axis].gate
            if gate is not None:
                about = f"{axes[axis].title}, {words}"
                yield _sentence(gate[0], gate[1], axes[axis].unit, curve.levels, curve.cost, about)
        scene = sorted(
            (float(mm), cost)
            for axis in _SCENE
            if axis in own
            for mm, cost in zip(own[axis].about["scene_mm"].tolist(), map(tuple, own[axis].cost.tolist()), strict=True)
        )
        if scene:
            limit_mm = 1e3 * float(GateLimits.model_fields["scene_sigma_m"].default)
            levels, costs = zip(*scene, strict=True)
            about = f"the scene's middle misplaced, by cameras displaced or turned, {words}"
            yield _sentence("scene_sigma_m", limit_mm, "mm", levels, np.array(costs), about)


def _sentence(gate: str, limit: float, unit: str, levels: Sequence[float], costs: Floats, about: str) -> str:
    at_limit, low, high = (100 * float(np.interp(limit, levels, costs[:, column])) for column in range(3))
    first = next((level for level, cost in zip(levels, costs[:, 0].tolist(), strict=True) if cost > COST), inf)
    who = f"no level up to {levels[-1]:.3g} {unit}" if first == inf else f"{first:.3g} {unit}"
    reach, points = f"{who} costs", f"{100 * COST:g} points of balanced accuracy"
    if at_limit > 100 * COST:
        advice = "it should be tighter"
    elif first == inf:
        advice = "it stays on the safe side, and these violations would bear more"
    else:
        advice = f"it stays, {first / limit:.1f} times below"
    spread = "" if np.isnan(low) else f" ({low:+.1f} to {high:+.1f})"
    return (
        f"{gate}, {limit:g} {unit} ({about}): costs {at_limit:+.1f} points there{spread}, {reach} {points}: {advice}."
    )
