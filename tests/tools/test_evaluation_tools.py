"""Thresholds are fitted where they are best, and the page says what was reached and links every failure."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "recognition"))
from violation_scenes import PAPER, decided, observed_sequence, rules, truth

from recognition.evaluation.violations import KINDS, RowResult, ViolationEvaluation, document_of, rows_of
from recognition.rules import parse_rules
from tools.evaluation_report import bars_of, interval, lanes_of, write_page
from tools.fit_rules import Placed, best, curves, taus_of, with_taus

NO_HAT = KINDS.index("no_hat")
ALL = (True,) * 4


def document(**said):
    """Two sequences with a bare head each, judged perfectly, but for what is said."""
    truths = tuple(truth({"no_hat": [(2.0, 4.0)]}, name=name) for name in "ab")
    perfect = [decided(each, {"no_hat": [(2.0, 4.0)]}) for each in truths]
    rows = tuple(
        RowResult(row, tuple(np.repeat(said.get(row.name, each), len(row.uses), axis=0) for each in perfect))
        for row in rows_of(ALL)
    )
    found = document_of(ViolationEvaluation(truths, rules(), rows), ("cam0", "cam1", "cam2", "cam3"))
    return {"split": "validation", "views": ["cam0"], **found}


def test_thresholds_are_read_and_replaced_and_nothing_else():
    taus = {"no_hat": 0.17, "ladder": 0.5, "window": 0.6, "platform": 0.7}
    changed = with_taus(PAPER, taus)
    assert taus_of(PAPER) == {"no_hat": 0.25, "ladder": 0.1, "window": 0.1, "platform": 0.1}
    assert taus_of(changed) == taus
    assert with_taus(changed, taus_of(PAPER)) == PAPER
    assert parse_rules(changed, "x").rule("no_hat").for_s == 0


def test_a_rule_file_with_two_thresholds_for_one_violation_is_refused():
    with pytest.raises(SystemExit, match="rule no_hat: expected one threshold"):
        taus_of(PAPER.replace("each w: not wears(w)", "each w: not wears(w) and dist(w.neck, w.feet) < 1 H"))


def test_the_best_threshold_is_in_the_middle_of_its_longest_stretch():
    grid = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    assert best(grid, np.array([0.5, 0.9, 0.5, 0.9, 0.9, 0.9, 0.6])) == 0.5
    assert best(grid, np.array([0.5, 0.6, 0.7, 0.6, 0.5, 0.5, 0.5])) == 0.3
    with pytest.raises(SystemExit, match="give more of them"):
        best(grid, np.full(7, np.nan))


def test_a_fit_finds_the_hats_distance_on_a_simulated_site():
    grid = (0.1, 0.15, 0.2, 0.25, 0.3)
    found = curves(PAPER, [Placed.of(observed_sequence())], grid)[:, NO_HAT]
    assert found[0] == 0.5  # every head is bare
    assert best(grid, found) >= 0.2
    assert found.max() > 0.9


def test_what_is_asked_is_judged_and_what_is_not_known_is_not_reached():
    bars = {bar.what: bar for bar in bars_of(document())}
    assert bars["balanced accuracy, no hard hat, at least 95 %"].holds
    assert bars["F1, no hard hat, at least 0.93"].holds
    alarms = bars["false alarms per hour of safe work, at most 1"]
    assert (alarms.got, alarms.holds) == ("0.0, in 8 s of it", True)
    unknown = bars["balanced accuracy, ladder that nobody holds, at least 95 %"]
    assert (unknown.got, unknown.holds) == ("-", False)
    assert not bars["ours, 4 views better than paper's method, 4 views, points of balanced accuracy"].holds


def test_a_better_row_reaches_its_bar():
    nothing = np.zeros((1, 30, 4), dtype=bool)
    bars = {bar.what: bar for bar in bars_of(document(paper_all_views=nothing))}
    bar = bars["ours, 4 views better than paper's method, 4 views, points of balanced accuracy"]
    assert (bar.got, bar.holds) == ("+50.0 (+50.0 to +50.0)", True)


def test_intervals_and_timelines_are_in_words_and_percent():
    assert interval({"value": 1.25, "low": -0.5, "high": 3.0}) == "+1.2 (-0.5 to +3.0)"
    assert interval({"value": 2.0, "low": None, "high": None}) == "+2.0"
    assert interval({"value": None, "low": None, "high": None}) == "-"
    (lane,) = lanes_of(document()["sequences"][0])
    assert lane.words == "no hard hat"
    assert lane.true[0] == pytest.approx((100 / 3, 100 / 3))
    assert lane.decided[0] == pytest.approx((100 / 3, 100 / 3))


def test_the_page_links_every_failure_and_names_the_papers_table_as_other_data(tmp_path):
    late = decided(truth({}), {"no_hat": [(3.0, 4.0)]})
    found = json.loads(json.dumps(document(all_views=late)))
    assert len(found["failures"]) == 2
    write_page(found, ["clips/0.mp4", "clips/1.mp4"], tmp_path / "index.html")
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert '<a href="clips/1.mp4">watch</a>' in page
    assert "missed in part" in page
    assert "other data, not comparable" in page
    assert "http" not in page.replace("http-equiv", "")
