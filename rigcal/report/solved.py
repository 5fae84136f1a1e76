"""What the rig file's extensions say of the solve, in sentences: loops, halves, lenses, bow, the scene's edges.

Rig files of other programs, and older ones, have no such figures; then there is nothing to say.
"""

from __future__ import annotations

from typing import Any

from rigcal.report.numbers import fixed, scaled
from rigcal.rigdocument import PairEntry, RigDocument


def _own(document: RigDocument, name: str) -> Any:
    own = document.extensions.get("rigcal")
    return own.get(name) if isinstance(own, dict) else None


def weakest_pair(document: RigDocument) -> PairEntry | None:
    """The pair of the chain that adds most to the place of a point; None where the file does not say."""
    graph = _own(document, "graph")
    named = graph.get("weakest") if isinstance(graph, dict) else None
    return next((pair for pair in document.pairs if named and set(pair.cameras) == set(named)), None)


def graph_sentences(document: RigDocument) -> list[str]:
    """Whether the loops of pairs close, and which pairs are not believed."""
    graph = _own(document, "graph")
    if not isinstance(graph, dict):
        return []
    sentences = []
    if loops := graph.get("loops"):
        widest = max(loops, key=lambda loop: loop["gap_m"])
        sentences.append(
            f"Loops of pairs close within {scaled(widest['gap_m'], 1e3, 1)} mm at the boards' distance; the widest is "
            f"{' and '.join(widest['cameras'])} against the way {', '.join(widest['path'])}."
        )
    for pair in graph.get("doubted") or ():
        sentences.append(
            f"The pair {' and '.join(pair['cameras'])} ({pair['views']} views) contradicts the others, so the chain "
            "does not use it: see that these cameras' images were taken together."
        )
    return sentences


def solve_sentences(document: RigDocument) -> list[str]:
    """What halves, lenses and the board told."""
    sentences = []
    split = _own(document, "split_half")
    if isinstance(split, dict):
        sentences.append(
            f"Solved from either half of the views, camera distances differ by {fixed(split['distance_percent'])} % at "
            f"most ({' to '.join(split['cameras'])})."
        )
    for camera_id, names in (_own(document, "undetermined") or {}).items():
        sentences.append(
            f"The views of {camera_id} did not determine {', '.join(names)}: held near the value of a usual lens."
        )
    bow = _own(document, "board_bow")
    if isinstance(bow, dict):
        parts = [
            f"{scaled(size, 1e3, 2)} ± {scaled(sigma, 1e3, 2)} mm along {axis}"
            for axis, size, sigma in zip("xy", bow["bow_m"], bow["sigma_m"], strict=True)
        ]
        sentences.append(f"The board's middle stands out by {' and '.join(parts)}.")
    return sentences


def edge_sigma_m(document: RigDocument) -> float | None:
    """The greatest sigma of a point at the scene's edges in metres; None where none was measured."""
    scene = _own(document, "scene")
    sigmas = [edge["sigma_m"] for edge in (scene.get("edges") or ())] if isinstance(scene, dict) else []
    return max((sigma for sigma in sigmas if sigma is not None), default=None)
