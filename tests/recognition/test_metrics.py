"""Every figure of tracks against a truth is what a hand computes in small cases."""

from dataclasses import asdict
from itertools import permutations

import numpy as np
import pytest

from recognition.metrics import AGREE_M, FOUND_M, PARTS, Truth, correct_parts, correspondences, idf1, nearest_m, score
from recognition.poses import Poses
from recognition.synthetic import walking

STANDING = walking(np.zeros((1, 2)))[0]  # 1.75 m tall
FAR = np.array([10.0, 0.0, 0.0])


def poses(*rows):
    """(frame, track, joints) of each row."""
    frame, track, joints = zip(*rows, strict=True) if rows else ((), (), ())
    joints = np.array(joints).reshape(-1, 17, 3)
    return Poses(np.array(frame, int), np.array(frame, int), np.array(track, int), joints, np.full((len(rows), 17), 4))


def truth(*rows):
    frame, person, joints = zip(*rows, strict=True)
    return Truth(np.array(frame), np.array(person), np.array(joints))


def at(x_m):
    """The standing body, moved along x."""
    return STANDING + np.array([x_m, 0.0, 0.0])


def test_perfect_tracks_score_full_marks():
    rows = [(frame, person, at(2.0 * person)) for frame in range(5) for person in (0, 1)]
    scores = score(truth(*rows), poses(*((f, p + 7, j) for f, p, j in rows)), period_s=0.1)
    assert (scores.pcp3d, scores.recall, scores.precision, scores.idf1, scores.mota) == (1.0, 1.0, 1.0, 1.0, 1.0)
    assert (scores.joints_found, scores.mpjpe_m, scores.switches) == (1.0, 0.0, 0)
    assert set(scores.pcp3d_parts.values()) == {1.0}


@pytest.mark.parametrize(
    ("moved_m", "wrong"),
    [
        (0.09, []),  # half a head: 0.5 * 0.107 * 1.75 = 0.094 m
        (0.10, ["head"]),
        (0.13, ["head", "lower arms"]),  # half a lower arm: 0.5 * 0.146 * 1.75 = 0.128 m
        (0.17, ["head", "lower arms", "upper arms"]),  # 0.5 * 0.186 * 1.75 = 0.163 m
        (0.22, ["head", "lower arms", "lower legs", "upper arms", "upper legs"]),  # 0.5 * 0.246 * 1.75 = 0.215 m
        (0.26, ["head", "lower arms", "lower legs", "torso", "upper arms", "upper legs"]),  # 0.5 * 0.288 * 1.75
    ],
)
def test_a_part_is_wrong_where_its_ends_are_off_by_half_its_length(moved_m, wrong):
    scores = score(truth((0, 0, STANDING)), poses((0, 1, at(moved_m))), period_s=1.0)
    assert sorted(name for name, share in scores.pcp3d_parts.items() if share == 0.0) == wrong
    assert scores.pcp3d == pytest.approx(1 - sum(name in wrong for name, _, _ in PARTS) / 10)


def test_a_part_is_judged_by_the_mean_of_its_two_ends():
    one_end = STANDING.copy()
    one_end[9] += (0.25, 0.0, 0.0)  # the left wrist, beyond half the lower arm; with the elbow's 0 it is 0.125 m
    assert score(truth((0, 0, STANDING)), poses((0, 1, one_end)), period_s=1.0).pcp3d == 1.0
    one_end[9] += (0.01, 0.0, 0.0)
    assert score(truth((0, 0, STANDING)), poses((0, 1, one_end)), period_s=1.0).pcp3d == 0.9


def test_what_the_truth_does_not_know_is_not_counted_and_what_the_track_does_not_know_is_wrong():
    partly = STANDING.copy()
    partly[[9, 10]] = np.nan
    known, correct = correct_parts(truth((0, 0, partly)), poses((0, 1, STANDING)))
    assert known.sum() == correct.sum() == 8
    known, correct = correct_parts(truth((0, 0, STANDING)), poses((0, 1, partly)))
    assert (known.sum(), correct.sum()) == (10, 8)


def test_parts_are_those_of_the_track_that_has_most_of_them_right_whoever_it_is():
    partly = STANDING.copy()
    partly[11:] = np.nan
    tracked = poses((0, 1, partly), (0, 2, at(0.05)), (1, 3, STANDING))
    _, correct = correct_parts(truth((0, 0, STANDING), (1, 0, STANDING)), tracked)
    assert correct.all()


def test_pcp_is_the_mean_over_workers_not_over_instants():
    rows = [(frame, 0, STANDING) for frame in range(9)]
    scores = score(truth(*rows, (0, 1, at(5.0))), poses(*((f, 1, j) for f, _, j in rows)), period_s=1.0)
    assert [person.pcp3d for person in scores.people] == [1.0, 0.0]
    assert scores.pcp3d == 0.5
    assert [person.instants for person in scores.people] == [9, 1]


def test_without_tracks_nothing_is_right_and_errors_are_not_known():
    scores = score(truth((3, 0, STANDING)), poses(), period_s=1.0)
    assert (scores.pcp3d, scores.recall, scores.joints_found, scores.idf1, scores.mota) == (0.0,) * 5
    assert np.isnan([scores.mpjpe_m, scores.precision, scores.people[0].mpjpe_m]).all()


def test_errors_are_over_the_joints_that_both_know():
    off = STANDING.copy()
    off[0] += (0.0, 0.2, 0.0)
    off[5:] = np.nan
    scores = score(truth((0, 0, STANDING)), poses((0, 1, off)), period_s=1.0)
    assert scores.mpjpe_m == pytest.approx(0.2 / 5)
    assert scores.joints_found == pytest.approx(4 / 17)


def test_a_track_is_a_worker_up_to_half_a_metre_of_mean_distance():
    near, far = (score(truth((0, 0, STANDING)), poses((0, 1, at(x))), period_s=1.0) for x in (0.499, 0.501))
    assert (AGREE_M, FOUND_M) == (0.5, 0.15)
    assert (near.recall, near.precision, near.mota, near.idf1) == (1.0, 1.0, 1.0, 1.0)
    assert (far.recall, far.precision, far.mota, far.idf1) == (0.0, 0.0, -1.0, 0.0)


def test_workers_who_swap_tracks_are_two_switches():
    rows = [(frame, person, at(3.0 * person)) for frame in range(10) for person in (0, 1)]
    tracked = poses(*((f, 1 + (p if f < 6 else 1 - p), j) for f, p, j in rows))
    scores = score(truth(*rows), tracked, period_s=3.0)  # two workers, half a minute
    assert scores.switches == 2
    assert scores.switches_per_worker_minute == pytest.approx(2.0)
    assert [person.switches for person in scores.people] == [1, 1]
    assert scores.idf1 == pytest.approx(0.6)
    assert scores.mota == pytest.approx(1 - 2 / 20)


def test_a_new_identity_after_a_gap_is_a_switch_and_the_same_one_is_none():
    rows = [(frame, 0, STANDING) for frame in range(10)]
    seen = [row for row in rows if not 3 <= row[0] < 6]
    same = score(truth(*rows), poses(*((f, 4, j) for f, _, j in seen)), period_s=1.0)
    other = score(truth(*rows), poses(*((f, 4 if f < 3 else 5, j) for f, _, j in seen)), period_s=1.0)
    assert (same.switches, same.recall, same.idf1) == (0, 0.7, pytest.approx(2 * 7 / 17))
    assert (other.switches, other.recall, other.idf1) == (1, 0.7, pytest.approx(2 * 4 / 17))


def test_a_worker_keeps_its_track_while_the_two_agree_though_another_comes_nearer():
    rows = [(0, 0, STANDING), (1, 0, STANDING)]
    tracked = poses((0, 1, at(0.1)), (1, 1, at(0.3)), (1, 2, at(0.1)))
    pairs = correspondences(truth(*rows), tracked)
    assert pairs.pose.tolist() == [0, 1]
    assert not pairs.switched.any()
    gone = poses((0, 1, at(0.1)), (1, 1, at(0.6)), (1, 2, at(0.1)))
    pairs = correspondences(truth(*rows), gone)
    assert pairs.pose.tolist() == [0, 2]
    assert pairs.switched.tolist() == [False, True]


def test_the_others_are_matched_one_to_one_at_the_least_total_distance():
    tracked = poses((0, 1, at(0.25)), (0, 2, at(0.65)))
    pairs = correspondences(truth((0, 0, at(0.0)), (0, 1, at(0.4))), tracked)
    assert pairs.pose.tolist() == [0, 1]  # though track 1 is 0.15 m from the second, it is all that the first has


def test_false_tracks_lower_precision_and_idf1():
    rows = [(frame, 0, STANDING) for frame in range(4)]
    tracked = poses(*((f, 1, j) for f, _, j in rows), *((f, 2, STANDING + FAR) for f in range(4)))
    scores = score(truth(*rows), tracked, period_s=1.0)
    assert (scores.precision, scores.recall, scores.idf1, scores.mota) == (0.5, 1.0, pytest.approx(2 / 3), 0.0)


def test_tracks_at_other_instants_than_the_truths_are_passed_over():
    rows = [(0, 0, STANDING), (5, 0, STANDING)]
    every = poses(*((frame, 1 if frame == 0 or frame == 5 else 2, STANDING) for frame in range(8)))
    scores = score(truth(*rows), every, period_s=1.0)
    assert (scores.precision, scores.idf1, scores.switches) == (1.0, 1.0, 0)


def test_the_nearest_track_of_a_worker_is_that_of_its_instant():
    away = nearest_m(
        truth((0, 0, STANDING), (0, 1, at(9.0)), (1, 0, STANDING)),
        poses((0, 1, at(1.0)), (0, 2, at(7.5)), (2, 1, STANDING)),
    )
    assert away.tolist() == pytest.approx([1.0, 1.5, np.inf])


def test_idf1_is_the_best_of_all_pairings_of_workers_and_tracks():
    rng = np.random.default_rng(0)
    for _ in range(20):
        rows, tracked = [], []
        together = np.zeros((3, 4))
        for frame in range(12):
            track = rng.permutation(4)
            for person in range(3):
                rows.append((frame, person, at(3.0 * person)))
                if rng.random() < 0.8:
                    tracked.append((frame, int(track[person]), at(3.0 * person + 0.1)))
                    together[person, track[person]] += 1
        best = max(sum(together[p, t] for p, t in enumerate(order)) for order in permutations(range(4), 3))
        assert idf1(truth(*rows), poses(*tracked)) == pytest.approx(2 * best / (len(rows) + len(tracked)))


def test_the_order_of_the_rows_does_not_matter():
    rng = np.random.default_rng(1)
    rows = [(f, p, at(0.6 * p) + rng.normal(0, 0.05, (17, 3))) for f in range(6) for p in range(3)]
    tracked = [(f, (p + f // 3) % 3 + 1, at(0.6 * p) + rng.normal(0, 0.05, (17, 3))) for f, p, _ in rows]
    one = score(truth(*rows), poses(*tracked), period_s=1.0)
    other = score(
        truth(*(rows[i] for i in rng.permutation(18))), poses(*(tracked[i] for i in rng.permutation(18))), period_s=1.0
    )
    assert other.switches == one.switches == 3
    for ours, theirs in zip(one.people, other.people, strict=True):
        assert asdict(ours) == pytest.approx(asdict(theirs))
    assert (other.idf1, other.mota, other.precision) == (one.idf1, one.mota, one.precision)


def test_a_truth_of_all_instants_leaves_out_who_is_not_there():
    joints = np.stack([np.stack([at(0.0), at(2.0)])] * 3)
    joints[1, 0] = np.nan
    found = Truth.of(joints)
    assert found.frame.tolist() == [0, 0, 1, 2, 2]
    assert found.person.tolist() == [0, 1, 1, 0, 1]


def test_an_empty_truth_is_refused():
    with pytest.raises(ValueError, match="truth: expected at least one row, got none"):
        score(Truth(np.zeros(0), np.zeros(0), np.zeros((0, 17, 3))), poses(), period_s=1.0)
