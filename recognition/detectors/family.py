"""A family of networks: those whose outputs are read in one way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from recognition.detectors.manifest import BoxManifest, PoseManifest
from rigcal.geometry import Floats


@dataclass(frozen=True, slots=True)
class BoxFamily:
    """Networks that find boxes."""

    output_shape: Callable[[BoxManifest], tuple[int, ...]]
    """Shape of the output that a manifest leads one to expect."""
    decode: Callable[[NDArray[Any], tuple[int, int]], tuple[Floats, Floats]]
    """(output, input size_wh) to boxes (A, 4) left, top, right, bottom in edge coordinates of the input, and a score
    (A, C) of each box and class."""


@dataclass(frozen=True, slots=True)
class PoseFamily:
    """Networks that find the joints of one person."""

    output_shape: Callable[[PoseManifest], tuple[int, ...]]
    """Shape of the output that a manifest leads one to expect."""
    decode: Callable[[NDArray[Any], tuple[int, int]], Floats]
    """(output, input size_wh) to joints (17, 3): x, y in edge coordinates of the input, score."""
