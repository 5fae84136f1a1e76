"""Which cameras saw the board together: a graph of cameras, with the chain to the reference and its weakest link."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats
from rigcal.report.numbers import fixed
from rigcal.report.solved import weakest_pair
from rigcal.report.words import chain_links, counted, shortened
from rigcal.rigdocument import PairEntry, RigDocument

RADIUS, MARGIN = 165.0, 34.0
"""Of the circle on which the cameras stand, and the room above and below it, in the figure's units."""
CHARACTER_UNITS = 11.0
"""Width of a character of a camera's id."""
LABEL_UNITS = 19.0
"""Distance of a camera's name from its place."""
WIDEST_UNITS = 9.0
"""Width of the line for the pair with the most shared views."""
CLOSEST_UNITS = 34.0
"""Distance between two labels, or of a label from a camera, below which they would cover each other."""
PLACES = (0.5, 0.4, 0.6, 0.32, 0.68, 0.25, 0.75)
"""Where along its line a label may stand, the best first."""
MOST_LABELS = 24
"""Chain links labelled; more than 24 cameras stand too close on the circle."""


@dataclass(frozen=True, slots=True)
class Node:
    """One camera."""

    label: str
    x: float
    y: float
    label_x: float
    label_y: float
    anchor: str
    """SVG's ``start``, ``middle`` or ``end``."""
    is_reference: bool


@dataclass(frozen=True, slots=True)
class Edge:
    """A pair of cameras that saw the board together."""

    start: tuple[float, float]
    end: tuple[float, float]
    width: float
    on_chain: bool
    weakest: bool
    label: str
    """Number of views; empty where it is not shown."""
    label_at: tuple[float, float]


@dataclass(frozen=True, slots=True)
class OverlapGraph:
    """The graph, ready to be drawn."""

    width: float
    height: float
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    """Those on the chain last, above the others."""
    weakest: str
    """The weakest link in words; empty where the chain has no link."""


def weakest_link(document: RigDocument) -> PairEntry | None:
    """The link of a chain that the rig file names, or that with the greatest RMSE over the root of its views."""
    if named := weakest_pair(document):
        return named
    links = chain_links(document)
    candidates = [pair for pair in document.pairs if frozenset(pair.cameras) in links]
    return max(candidates, key=_looseness, default=None)


def _looseness(pair: PairEntry) -> tuple[float, int]:
    return (pair.rmse_px or 0.0) / math.sqrt(max(pair.views, 1)), -pair.views


def overlap_graph(document: RigDocument) -> OverlapGraph | None:
    """The graph of a rig; None where it has one camera or no pair saw the board together."""
    if not document.pairs:
        return None
    ids = document.camera_ids
    label_units = LABEL_UNITS + CHARACTER_UNITS * max(len(shortened(camera_id)) for camera_id in ids)
    middle = np.array([RADIUS + label_units, RADIUS + MARGIN])
    angles = 2 * np.pi * np.arange(len(ids)) / len(ids) - (np.pi if len(ids) == 2 else np.pi / 2)
    towards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if len(ids) == 2:
        middle[1] = 2 * MARGIN
    places = middle + RADIUS * towards
    width, height = (2 * middle).tolist()
    weakest = weakest_link(document)
    return OverlapGraph(
        width,
        height,
        tuple(
            _node(camera_id, at, way, camera_id == document.reference)
            for camera_id, at, way in zip(ids, places, towards, strict=True)
        ),
        _edges(document, places, weakest),
        "" if weakest is None else _in_words(weakest),
    )


def _in_words(pair: PairEntry) -> str:
    rmse = "" if pair.rmse_px is None else f", RMSE {fixed(pair.rmse_px)} px"
    return f"{pair.cameras[0]} and {pair.cameras[1]} ({counted(pair.views, 'shared view')}{rmse})"


def _node(camera_id: str, at: Floats, towards: Floats, is_reference: bool) -> Node:
    anchor = "middle" if abs(towards[0]) < 0.3 else "start" if towards[0] > 0 else "end"
    x, y, label_x, label_y = (float(v) for v in (*at, *(at + LABEL_UNITS * towards)))
    return Node(shortened(camera_id), x, y, label_x, label_y, anchor, is_reference)


def _edges(document: RigDocument, places: Floats, weakest: PairEntry | None) -> tuple[Edge, ...]:
    index = {camera_id: i for i, camera_id in enumerate(document.camera_ids)}
    links, most = chain_links(document), max(1, *(pair.views for pair in document.pairs))
    labelled = links if len(links) <= MOST_LABELS else frozenset[frozenset[str]]()
    taken, edges = list(places), []
    for pair in sorted(document.pairs, key=lambda pair: frozenset(pair.cameras) in links):
        start, end = places[index[pair.cameras[0]]], places[index[pair.cameras[1]]]
        on_chain, label, label_at = frozenset(pair.cameras) in links, "", (start + end) / 2
        if frozenset(pair.cameras) in labelled:
            label, label_at = str(pair.views), _free_place(start, end, taken)
            taken.append(label_at)
        edges.append(
            Edge(
                (float(start[0]), float(start[1])),
                (float(end[0]), float(end[1])),
                max(WIDEST_UNITS * math.sqrt(pair.views / most), 1.0),
                on_chain,
                pair is weakest,
                label,
                (float(label_at[0]), float(label_at[1])),
            )
        )
    return tuple(edges)


def _free_place(start: Floats, end: Floats, taken: Sequence[Floats]) -> Floats:
    """Along a line, the first place that is not close to what is taken; else the one farthest from it."""
    places = [start + share * (end - start) for share in PLACES]
    rooms = [min(float(np.linalg.norm(place - other)) for other in taken) for place in places]
    free = next((i for i, room in enumerate(rooms) if room >= CLOSEST_UNITS), int(np.argmax(rooms)))
    return places[free]
