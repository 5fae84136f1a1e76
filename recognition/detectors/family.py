"""A family of networks: those whose outputs are read in one way.

There are three kinds. Box networks find objects, and people as one class of them; people networks find people with
their joints in one run (one-stage); pose networks find the joints of the one person in a crop, and so need boxes of
people from a box network (two-stage).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from numpy.typing import NDArray

from rigcal.geometry import Floats

Outputs: TypeAlias = tuple[NDArray[Any], ...]
"""The outputs of one run that a family reads, in the order of the graph."""
Layout: TypeAlias = tuple[tuple[int, ...], ...]
"""Shapes of a network's first outputs, those that are read."""
Layouts: TypeAlias = Callable[[tuple[int, int], int], tuple[Layout, ...]]
"""(input size_wh, number of classes) to the layouts that networks of a family may have, the usual one first."""


@dataclass(frozen=True, slots=True)
class BoxFamily:
    """Networks that find boxes."""

    layouts: Layouts
    decode: Callable[[Outputs, tuple[int, int]], tuple[Floats, Floats]]
    """(outputs, input size_wh) to boxes (A, 4) left, top, right, bottom in edge coordinates of the input, and a score
    (A, C) of each box and class."""


@dataclass(frozen=True, slots=True)
class PeopleFamily:
    """Networks that find people, each with a box and 17 joints."""

    layouts: Layouts
    decode: Callable[[Outputs, tuple[int, int]], tuple[Floats, Floats, Floats]]
    """(outputs, input size_wh) to boxes (A, 4) in edge coordinates of the input, a score (A,) of each, and joints
    (A, 17, 3): x, y in edge coordinates of the input, score."""


@dataclass(frozen=True, slots=True)
class PoseFamily:
    """Networks that find the joints of one person."""

    layouts: Layouts
    decode: Callable[[Outputs, tuple[int, int]], Floats]
    """(outputs, input size_wh) to joints (17, 3): x, y in edge coordinates of the input, score."""
    fills_input: bool
    """Whether the crop is widened to the aspect of the input, as these networks were trained; otherwise it shows the
    box alone, and the rest of the input is padded."""


AnyFamily: TypeAlias = BoxFamily | PeopleFamily | PoseFamily


def grid_cells(size_wh: tuple[int, int], strides: tuple[int, ...]) -> int:
    """How many cells the grids of these strides have together."""
    return sum((size_wh[0] // stride) * (size_wh[1] // stride) for stride in strides)


def corners(centre_wh: Floats) -> Floats:
    """Boxes (A, 4) of centre x, y, width, height as left, top, right, bottom."""
    low, half = centre_wh[:, :2], centre_wh[:, 2:] / 2
    boxes = centre_wh.copy()
    boxes[:, :2], boxes[:, 2:] = low - half, low + half
    return boxes
