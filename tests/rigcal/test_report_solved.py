"""What the report says of the solve: loops, halves, lenses, bow, edges; and nothing where nothing is known."""

import pytest

from rigcal.report import html_report
from rigcal.report.solved import edge_sigma_m, graph_sentences, solve_sentences, weakest_pair
from rigcal.rigdocument import PairEntry
from rigcal.rigfile import document_of_rig
from rigcal.synthetic import arc_rig

FIGURES = {
    "graph": {
        "weakest": ["cam2", "cam1"],
        "loops": [
            {"cameras": ["cam0", "cam2"], "path": ["cam0", "cam1", "cam2"], "gap_m": 0.0051},
            {"cameras": ["cam1", "cam2"], "path": ["cam1", "cam0", "cam2"], "gap_m": 0.0004},
        ],
        "doubted": [{"cameras": ["cam0", "cam2"], "views": 3}],
    },
    "split_half": {"gap": 1.0, "distance_percent": 0.44, "cameras": ["cam0", "cam2"]},
    "undetermined": {"cam1": ["k3"]},
    "board_bow": {"bow_m": [0.0021, -0.0003], "sigma_m": [0.0002, 0.0001]},
    "scene": {"centre": None, "edges": [{"sigma_m": 0.004}, {"sigma_m": None}, {"sigma_m": 0.0123}]},
}


def document(figures):
    made = document_of_rig(arc_rig(3), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    pairs = (
        PairEntry(cameras=("cam0", "cam1"), views=8, rmse_px=0.9),
        PairEntry(cameras=("cam1", "cam2"), views=12, rmse_px=0.3),
    )
    return made.model_copy(update={"pairs": pairs, "extensions": {"rigcal": figures} if figures else {}})


def test_loops_and_doubted_pairs_are_told():
    closes, doubted = graph_sentences(document(FIGURES))
    assert closes == (
        "Loops of pairs close within 5.1 mm at the boards' distance; the widest is cam0 and cam2 against the way "
        "cam0, cam1, cam2."
    )
    assert doubted.startswith("The pair cam0 and cam2 (3 views) contradicts the others")


def test_halves_lenses_and_the_bow_are_told():
    assert solve_sentences(document(FIGURES)) == [
        "Solved from either half of the views, camera distances differ by 0.44 % at most (cam0 to cam2).",
        "The views of cam1 did not determine k3: held near the value of a usual lens.",
        "The board's middle stands out by 2.10 ± 0.20 mm along x and -0.30 ± 0.10 mm along y.",
    ]


def test_the_weakest_pair_is_the_one_that_the_file_names():
    assert weakest_pair(document(FIGURES)).cameras == ("cam1", "cam2")
    assert weakest_pair(document(None)) is None


def test_the_worst_edge_of_the_scene_counts():
    assert edge_sigma_m(document(FIGURES)) == pytest.approx(0.0123)


def test_the_page_says_it_and_files_without_figures_say_nothing():
    page = html_report(document(FIGURES), None)
    assert "a point at the scene&#39;s edges, at worst" in page or "a point at the scene's edges, at worst" in page
    assert "camera distances differ by 0.44 %" in page
    bare = document(None)
    assert graph_sentences(bare) == []
    assert solve_sentences(bare) == []
    assert edge_sigma_m(bare) is None
    assert "camera distances differ" not in html_report(bare, None)
