"""Claims and groups against known workers: simulated views, where each detection carries whom it shows."""

from dataclasses import replace

import numpy as np
import pytest

from recognition.association import claims as claims_module
from recognition.association import leftovers as leftovers_module
from recognition.association.claims import claim
from recognition.association.leftovers import MOST_AT_ONCE, group
from recognition.observations import ViewDetections
from recognition.observed import DetectorModel, observe
from recognition.optics import Optics
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, with_noise
from recognition.synthetic_views import observe as seen_by
from rigcal.errors import OptionError

RIG = semicircle_rig(4)
OPTICS = Optics.of(RIG)
NOISE = DetectorNoise(pixel_sigma=3.0, missing_joint=0.2, false_per_view=0.3)


def instant(seed, workers=4, noise=NOISE, frame=0, sure=range(4)):
    """Joints in the rig frame (W, 17, 3), people and boxes, and whom each of the people shows.

    People of views that are not ``sure`` are hints.
    """
    site = simulate(RIG, workers=workers, frames=2, seed=seed)
    views = with_noise(seen_by(site, frame), RIG, noise, seed=[seed, frame])
    seen = [
        v.detections if number in sure else replace(v.detections, hints=np.arange(len(v.worker_idx)))
        for number, v in enumerate(views)
    ]
    people, boxes = observe(OPTICS, seen, {}, DetectorModel(), keypoints=False)
    joints = RIG.world_from_rig.inverse().apply(site.joints_in_world_m[frame])
    return joints, people, boxes, np.concatenate([v.worker_idx for v in views])


def claims(joints, people, variance=0.02**2, sigmas=5.0):
    count = len(joints)
    return claim(
        OPTICS, people, joints, np.full((count, 17), variance), np.ones((count, 17), dtype=bool),
        np.zeros(count, dtype=np.int64), min_shared=3, max_sigmas=sigmas,
    ).rows  # fmt: skip


def groups(people, free=None, sigmas=3.0):
    rows = np.arange(people.count) if free is None else free
    return group(OPTICS, people, rows, min_shared=3, max_sigmas=sigmas, max_parallax_var=1.0)


@pytest.mark.parametrize("workers", [1, 4, 8])
def test_tracks_claim_their_own_detections(workers):
    for seed in range(4):
        joints, people, _, who = instant(seed, workers)
        members = claims(joints, people)
        for worker, row in enumerate(members):
            assert {int(who[d]) for d in row if d >= 0} <= {worker}
        assert (members >= 0).sum() == (who >= 0).sum()


@pytest.mark.parametrize("sigmas", [0.0, 1.0, 3.0])
def test_a_claim_says_how_far_the_detection_is(sigmas):
    joints, people, _, _ = instant(0, 1, DetectorNoise())
    aside = np.array([1.0, 0.0, 0.0])  # of camera 0, which is the rig frame
    found = claim(
        OPTICS, people, joints + sigmas * 0.2 * aside, np.full((1, 17), 0.2**2), np.ones((1, 17), dtype=bool),
        np.zeros(1, dtype=np.int64), min_shared=3, max_sigmas=5.0,
    )  # fmt: skip
    assert found.sigmas[0, 0] == pytest.approx(sigmas, rel=0.05, abs=1e-3)
    assert found.beyond(2.5)[0, 0] == (sigmas > 2.5)


def test_a_track_half_a_metre_away_claims_nothing():
    joints, people, _, _ = instant(0, 1, DetectorNoise())
    assert (claims(joints + [0.5, 0.0, 0.0], people) < 0).sum() >= 3


def test_of_two_tracks_the_one_that_is_sure_claims_first():
    joints, people, _, _ = instant(0, 1, DetectorNoise())
    both, known = np.repeat(joints, 2, axis=0), np.ones((2, 17), dtype=bool)
    variance = np.array([[0.3**2], [0.02**2]]).repeat(17, axis=1)
    label = np.zeros(2, dtype=np.int64)
    members = claim(OPTICS, people, both, variance, known, label, min_shared=3, max_sigmas=5.0).rows
    assert (members[0] < 0).all()
    assert (members[1] >= 0).all()


def test_a_view_that_a_track_does_not_ask_gives_it_nothing():
    joints, people, _, _ = instant(0, 1, DetectorNoise())
    across = np.array([[1.0], [0.0], [1.0], [1.0]])
    members = claim(
        OPTICS, people, joints, np.full((1, 17), 4e-4), np.ones((1, 17), dtype=bool), np.zeros(1, dtype=np.int64),
        across=across, min_shared=3, max_sigmas=5.0,
    ).rows  # fmt: skip
    assert (members[0] >= 0).tolist() == [True, False, True, True]


def test_what_is_behind_a_camera_claims_nothing():
    joints, people, _, _ = instant(0, 1, DetectorNoise())
    mirrored = OPTICS.centre_m[0] * 2 - joints
    assert claims(mirrored, people, variance=1.0, sigmas=50.0)[0, 0] == -1


def test_nobody_and_nothing_are_no_error():
    joints, people, _, _ = instant(0)
    assert claims(np.zeros((0, 17, 3)), people).shape == (0, 4)
    none, _ = observe(OPTICS, [ViewDetections.empty()] * 4, {}, DetectorModel(), keypoints=False)
    assert (claims(joints, none) < 0).all()
    assert len(groups(none).members) == 0


@pytest.mark.parametrize("workers", [1, 4, 8])
def test_exact_detections_are_grouped_perfectly(workers):
    for seed in range(3):
        joints, people, _, who = instant(seed, workers, DetectorNoise())
        found = groups(people)
        assert sorted(int(who[row[row >= 0][0]]) for row in found.members) == list(range(workers))
        for row, place in zip(found.members, found.place_m, strict=True):
            (worker,) = {int(who[d]) for d in row if d >= 0}
            assert (row >= 0).sum() == (who == worker).sum()
            assert np.nanmax(np.linalg.norm(place - joints[worker], axis=1)) < 1e-3


def test_an_imperfect_detector_mixes_few_groups():
    # measured: 1 of 160 groups holds a false or another person
    mixed = whole = 0
    for seed in range(20):
        _, people, _, who = instant(seed, 8)
        for row in groups(people).members:
            shown = {int(who[d]) for d in row if d >= 0}
            mixed += len(shown) > 1 or -1 in shown
            whole += 1
    assert whole >= 155
    assert mixed <= 3


def test_only_free_detections_are_grouped():
    _, people, _, who = instant(1, 4, DetectorNoise())
    free = np.flatnonzero(who != 2)
    assert {int(who[row[row >= 0][0]]) for row in groups(people, free).members} == {0, 1, 3}
    assert len(groups(people, free[:1]).members) == 0


@pytest.mark.parametrize("sure", [[0], [2], [1, 3]])
def test_hints_join_a_group_that_somebody_sure_began(sure):
    _, people, _, who = instant(1, 4, DetectorNoise(), sure=sure)
    found = groups(people).members
    assert sorted(int(who[row[row >= 0][0]]) for row in found) == [0, 1, 2, 3]
    assert (found >= 0).sum() == people.count


def test_hints_alone_are_no_group_but_are_claimed():
    joints, people, _, who = instant(1, 4, DetectorNoise(), sure=[])
    assert people.count == len(who) > 12
    assert len(groups(people).members) == 0
    assert (claims(joints, people) >= 0).sum() == people.count


def test_people_whose_score_is_too_low_do_not_shift_the_hints():
    site = simulate(RIG, workers=3, frames=1, seed=1)
    view = seen_by(site, 0)[0].detections
    faint = replace(view, people_score=view.people_score * [[1.0], [0.1], [1.0]], hints=np.array([2]))
    people, boxes = observe(OPTICS, [faint, view, *[ViewDetections.empty()] * 2], {}, DetectorModel(), keypoints=False)
    assert people.index.tolist() == [0, 2, 0, 1, 2, -1]
    assert people.hint.tolist() == [False, True, False, False, False, True]
    assert boxes.hint.tolist() == [False] * boxes.count + [True]


def test_bodies_of_inhuman_size_are_no_group():
    """Two people on the epipolar plane of two cameras: their rays meet, where a giant would stand."""
    joints, people, _, _ = instant(0, 1, DetectorNoise())
    near = OPTICS.centre_m[0] + 0.35 * (joints - OPTICS.centre_m[0])  # the same image in camera 0, a third as tall
    views = []
    for v, mounted in enumerate(RIG.cameras):
        px = mounted.camera.project(mounted.cam_from_rig.apply(near if v == 1 else joints))
        seen = np.isfinite(px).all(axis=-1).astype(float)
        views.append(ViewDetections(px, seen, (), np.zeros((0, 4)), np.zeros(0)) if v < 2 else ViewDetections.empty())
    dwarf, _ = observe(OPTICS, views, {}, DetectorModel(), keypoints=False)
    assert len(groups(dwarf).members) == 0
    assert len(groups(people).members) == 1


def test_objects_are_grouped_within_their_class():
    _, _, boxes, _ = instant(0, 4, DetectorNoise())
    found = group(OPTICS, boxes.points(1), np.arange(boxes.count), min_shared=1, max_sigmas=4.0, max_parallax_var=1.0)
    assert len(found.members) == 14
    for row in found.members:
        assert len({int(boxes.label[d]) for d in row if d >= 0}) == 1


def test_scores_below_the_limits_are_not_observed():
    px = np.full((2, 17, 2), 500.0)
    score = np.stack([np.full(17, 0.1), np.linspace(0.1, 0.9, 17)])
    view = ViewDetections(px, score, ("bucket", "cone"), [[0, 0, 9, 9]] * 2, [0.1, 0.9])
    people, boxes = observe(OPTICS, [view] * 4, {}, DetectorModel(), keypoints=False)
    assert people.index.tolist() == [1, 1, 1, 1, -1]
    assert people.seen[0].tolist() == (score[1] >= 0.2).tolist()
    assert boxes.index.tolist() == [1, 1, 1, 1, -1]
    assert not people.seen[-1].any()


@pytest.mark.parametrize("name", ["min_person_score", "joint_m", "object_px"])
def test_options_outside_their_range_are_refused(name):
    with pytest.raises(OptionError, match=name):
        DetectorModel(**{name: -1.0})


def test_how_many_points_are_compared_at_once_changes_nothing(monkeypatch):
    joints, people, _, _ = instant(0, 8)
    at_once = claims(joints, people), groups(people)
    for module in (claims_module, leftovers_module):
        monkeypatch.setattr(module, "POINTS_AT_ONCE", 1)
    one_by_one = claims(joints, people), groups(people)
    assert np.array_equal(at_once[0], one_by_one[0])
    assert np.array_equal(at_once[1].members, one_by_one[1].members)
    assert np.array_equal(at_once[1].place_m, one_by_one[1].place_m, equal_nan=True)


def test_a_large_crowd_before_many_cameras_is_grouped_in_two_rounds():
    rig = semicircle_rig(8)
    site = simulate(rig, workers=12, frames=1, seed=0)
    views = seen_by(site, 0)
    people, _ = observe(Optics.of(rig), [v.detections for v in views], {}, DetectorModel(), keypoints=False)
    who = np.concatenate([v.worker_idx for v in views])
    assert people.count > MOST_AT_ONCE
    found = group(Optics.of(rig), people, np.arange(people.count), min_shared=3, max_sigmas=3.0, max_parallax_var=1.0)
    shown = [{int(who[d]) for d in row if d >= 0} for row in found.members.tolist()]
    assert sorted(map(sorted, shown)) == [[w] for w in range(12)]
    assert (found.members >= 0).sum() == people.count
