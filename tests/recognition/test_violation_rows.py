"""Rows of the evaluation on a simulated site: who decides what, from which cameras, at which instants."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from violation_scenes import BARE_S, HEAD, PAPER, observed_sequence, rule, rules, truth

from recognition.errors import DatasetError
from recognition.evaluation.violations import (
    KINDS,
    Rules,
    decisions,
    document_of,
    evaluate_violations,
    flat_scene,
    held,
    rows_of,
    seen_with,
)
from recognition.evaluation.violations.flat import flat_judge, single_frame_truth
from recognition.observations import ViewDetections
from recognition.rules import parse_rules
from recognition.synthetic import semicircle_rig, walking

NO_HAT = KINDS.index("no_hat")
ALL = (True,) * 4
STANDING = walking(np.zeros((1, 2)))[0]


@pytest.fixture(scope="module")
def sequence():
    return observed_sequence()


@pytest.fixture(scope="module")
def found(sequence):
    return evaluate_violations([sequence], rules(), ALL)


def picture(hat_m, *, scale=100.0, joints=range(17)):
    """One worker seen from the front, and a hat so far above the middle of the shoulders."""
    pixels = np.full((1, 17, 2), np.nan)
    pixels[0, list(joints)] = (STANDING[:, [1, 2]] * [scale, -scale] + [400, 600])[list(joints)]
    neck = STANDING[[5, 6]].mean(axis=0)
    middle = np.array([neck[1], -neck[2] - hat_m]) * scale + [400, 600]
    score = np.isfinite(pixels[..., 0]).astype(float)
    return ViewDetections(pixels, score, ("hard_hat",), np.array([[*middle - 5, *middle + 5]]), np.ones(1))


def said(view, kinds=KINDS):
    judge = flat_judge(parse_rules(PAPER, "paper"), semicircle_rig())
    return single_frame_truth(judge, flat_scene(view, index=0, t_ns=0), kinds)


@pytest.mark.parametrize("scale", [30.0, 100.0, 300.0])
def test_distances_in_a_picture_are_shares_of_the_workers_height(scale):
    height_m = 1.75
    assert said(picture(0.24 * height_m, scale=scale))[NO_HAT] is False
    assert said(picture(0.27 * height_m, scale=scale))[NO_HAT] is True


def test_a_picture_without_the_workers_body_leaves_it_unknown_and_without_anybody_nothing_is_violated():
    assert said(picture(0.4, joints=range(5)))[NO_HAT] is None
    assert said(ViewDetections.empty()) == [False] * 4


@pytest.mark.parametrize("sign", ["<", ">"])
def test_a_distance_of_nothing_is_no_share_of_a_height_that_is_not_known(sign):
    text = f"""format = "recognition.rules"
version = 1
name = "eyes"
[[rules]]
name = "no_hat"
sentence = "an eye and the nose"
when = "each w: dist(w.nose, w.left_eye) {sign} 0.25 H"
"""
    seen = picture(0.4, joints=range(5))
    together = seen.people_px.copy()
    together[0, 1] = together[0, 0]
    judge = flat_judge(parse_rules(text, "eyes"), semicircle_rig())
    assert single_frame_truth(judge, flat_scene(replace(seen, people_px=together), index=0, t_ns=0), ("no_hat",)) == [
        None
    ]


def test_a_picture_does_not_show_who_is_only_a_hint():
    seen = picture(0.3 * 1.75)
    assert said(seen)[NO_HAT] is True
    assert said(replace(seen, hints=np.array([0])))[NO_HAT] is False


def test_rules_that_need_the_floor_cannot_be_the_baselines():
    text = PAPER.replace("dist(w.feet, p) < 0.10 H", "clearance(w.feet) > 0.10 H and dist(w.feet, p) < 1 H")
    with pytest.raises(DatasetError, match="cannot be judged by these rules"):
        Rules(rules().ours, parse_rules(text, "paper"))


def test_rules_must_judge_all_four_violations():
    alone = parse_rules(HEAD + rule("no_hat", "each w: not exists hard_hat o: dist(w.neck, o) < 0.25 H"), "x")
    with pytest.raises(DatasetError, match="none named ladder, window, platform"):
        Rules(alone, rules().paper)


def test_four_cameras_have_six_pairs_and_each_method_its_rows():
    rows = {row.name: row for row in rows_of(ALL)}
    assert list(rows) == ["baseline", "one_view", "two_views", "all_views", "paper_two_views", "paper_all_views"]
    assert len(set(rows["two_views"].uses)) == 6
    assert {sum(use) for use in rows["two_views"].uses} == {2}
    assert rows["baseline"].uses == ((True, False, False, False),)
    assert rows["all_views"].uses == (ALL,)
    assert [row.name for row in rows_of((False, True, True, False))] == [
        "baseline", "one_view", "all_views", "paper_all_views",
    ]  # fmt: skip
    assert [row.name for row in rows_of((False, True, False, False))] == ["baseline", "one_view"]


def test_an_instant_has_the_newest_decision_that_is_not_later():
    known = truth({}, frames=5, period_s=0.2)
    yes, no = [True, False, False, False], [False] * 4
    got = held(known, iter([(200_000_000, yes), (390_000_000, no), (650_000_000, yes)]))
    assert got[:, 0].tolist() == [False, True, False, True, True]
    assert not held(known, iter([])).any()


def test_cameras_that_are_left_out_saw_nothing(sequence):
    own = list(seen_with(sequence.instants, (False, True, False, True)))
    assert len(own) == len(sequence.instants)
    assert own[4].frame_set.times_ns[0] is None
    assert own[4].frame_set.cameras == 2
    assert len(own[4].views[0].people_px) == 0
    assert len(own[4].views[1].people_px) == len(sequence.instants[4].views[1].people_px) > 0
    assert own[4].frame_set.t_ns == sequence.instants[4].frame_set.t_ns


def test_ours_and_the_papers_method_find_the_bare_head_and_nothing_else(found):
    for name in ("all_views", "paper_all_views"):
        decided = found.row(name).decided[0][0]
        t_s = found.truths[0].t_s
        inside = (t_s >= BARE_S[0] + 0.6) & (t_s < BARE_S[1])
        outside = ((t_s > 0) & (t_s < BARE_S[0])) | (t_s > BARE_S[1] + 0.6)  # hats are tracks from the second instant
        assert decided[inside, NO_HAT].all()
        assert not decided[outside, NO_HAT].any()
        assert not decided[:, [KINDS.index(kind) for kind in ("window", "platform")]].any()
    assert found.main.row.name == "all_views"


def test_the_temporal_filter_waits_where_the_single_frame_does_not(sequence):
    frame, filtered = (decisions(row, sequence, rules())[0, :, NO_HAT] for row in rows_of(ALL)[:2])
    first = [int(np.argmax(said)) for said in (frame, filtered)]
    assert frame.any()
    assert filtered.any()
    assert first[0] < first[1]


def test_same_sequence_and_rules_same_decisions(sequence, found):
    for result in (found.main, found.row("paper_all_views"), found.row("one_view")):
        assert np.array_equal(decisions(result.row, sequence, rules()), result.decided[0])


def test_the_document_has_every_row_and_nothing_that_json_cannot_hold(found):
    document = document_of(found, ("cam0", "cam1", "cam2", "cam3"))
    json.dumps(document, allow_nan=False)
    rows = {row["name"]: row for row in document["rows"]}
    assert rows["two_views"]["views"][0] == "cam0+cam1"
    assert set(rows["two_views"]["by_views"]) == set(rows["two_views"]["views"])
    assert "by_views" not in rows["all_views"]
    assert rows["all_views"]["by_light"].keys() == {"indoor"}
    assert rows["all_views"]["outside_transitions"]["ladder"]["balanced_accuracy_percent"] is None
    assert rows["all_views"]["outside_transitions"]["no_hat"]["balanced_accuracy_percent"] == 100.0
    assert document["paper_table"]["note"] == "other data, not comparable"
    assert document["paper_table"]["accuracy_percent"]["four views"]["no_hat"] == 92.0
    assert document["sequences"][0]["true_s"]["no_hat"] == [list(BARE_S)]
    pairs = {(each["row"], each["than"]) for each in document["differences"]}
    assert {("all_views", "two_views"), ("two_views", "baseline"), ("all_views", "paper_all_views")} <= pairs


def test_nothing_to_evaluate_and_other_cameras_are_refused(sequence):
    with pytest.raises(DatasetError, match="nothing to evaluate"):
        evaluate_violations([], rules(), ALL)
    with pytest.raises(DatasetError, match="different cameras"):
        evaluate_violations([sequence], rules(), (True, True))
