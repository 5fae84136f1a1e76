"""Crowds cross, cameras lose workers for the spans that were asked for, and the truth comes with it."""

import numpy as np
import pytest

from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_crowds import Bursts, crowd, lost_joints
from rigcal.errors import OptionError

SITE = simulate(semicircle_rig(4), workers=8, frames=1800, fps=30.0, seed=3, crossing=True)
CROWD = crowd(4, seconds=3.0, seed=0)


def test_workers_cross_each_others_paths_and_do_not_walk_through_each_other():
    hips_m = SITE.joints_in_world_m[:, :, 11:13, :2].mean(axis=2)
    apart_m = np.linalg.norm(hips_m[:, :, None] - hips_m[:, None], axis=-1)[:, *np.triu_indices(8, 1)]
    meetings = (np.diff((apart_m < 1.0).astype(int), axis=0) == 1).sum()
    assert apart_m.min() > 0.45
    assert meetings > 150  # in a minute
    assert np.abs(hips_m).max() <= 2.6 + 1e-9


def test_those_who_cross_walk_and_turn_as_people_do():
    steps_m = np.diff(SITE.joints_in_world_m[:, :, 11:13, :2].mean(axis=2), axis=0)
    speed_m_s = np.linalg.norm(steps_m, axis=-1) * 30
    turn_rad_s = np.abs(np.diff(np.unwrap(np.arctan2(steps_m[..., 1], steps_m[..., 0]), axis=0), axis=0)) * 30
    assert 0.4 < np.median(speed_m_s) < 1.4
    assert speed_m_s.max() < 1.6
    assert np.quantile(turn_rad_s, 0.999) < 4.01


def test_bursts_have_the_rate_the_lengths_and_the_parts_that_were_asked_for():
    lost = lost_joints(SITE, Bursts(per_minute=6.0, shortest_s=0.5, longest_s=2.0, whole=0.5), seed=1)
    assert lost.shape == (1800, 4, 8, 17)
    assert lost.any(axis=-1).mean() == pytest.approx(0.125, abs=0.02)
    assert lost.all(axis=-1).mean() == pytest.approx(0.0625, abs=0.015)
    rare = lost_joints(SITE, Bursts(per_minute=0.5, whole=1.0), seed=2).all(axis=-1)
    edges = np.diff(np.pad(rare, ((1, 1), (0, 0), (0, 0))).astype(int), axis=0)
    spans = (np.argwhere(np.moveaxis(edges, 0, -1) < 0) - np.argwhere(np.moveaxis(edges, 0, -1) > 0))[:, -1]
    assert len(spans) > 8
    assert spans.max() <= 61  # 2 s
    assert np.median(spans) == pytest.approx(37.5, abs=15)


def test_no_bursts_lose_nothing():
    assert not lost_joints(SITE, Bursts(per_minute=0.0), seed=0).any()


def test_a_crowd_loses_joints_and_has_false_people_and_labels_them():
    views = [view for instant in CROWD.views for view in instant]
    labels = np.concatenate([view.worker_idx for view in views])
    people = np.concatenate([view.detections.people_px for view in views])
    full = lost_joints(CROWD.site, Bursts(), seed=(0, 1))
    there = [len(view.worker_idx[view.worker_idx >= 0]) for view in views]
    assert (labels < 0).sum() / len(views) == pytest.approx(0.2, abs=0.06)  # 5 % of four workers
    assert sum(there) <= (~full.all(axis=-1)).sum()
    assert 0.2 < np.isnan(people[labels >= 0]).any(axis=-1).mean() < 0.4


def test_labelled_detections_are_where_the_truth_projects():
    truth = CROWD.truth
    for frame in (0, 40, 89):
        for view, camera, cam_from_world in zip(
            CROWD.views[frame], CROWD.site.rig.cameras, CROWD.site.cam_from_world, strict=True
        ):
            for row, worker in enumerate(view.worker_idx):
                if worker >= 0:
                    joints = truth.joints_m[(truth.frame == frame) & (truth.person == worker)][0]
                    px = camera.camera.project(cam_from_world.apply(joints))
                    off_px = np.linalg.norm(view.detections.people_px[row] - px, axis=-1)
                    assert np.nanmax(off_px) < 5 * 3.0


def test_alone_gives_the_detections_of_one_worker_and_nothing_else():
    for worker in range(4):
        for instant, labelled in zip(CROWD.alone(worker), CROWD.views, strict=True):
            for seen, view in zip(instant.views, labelled, strict=True):
                assert len(seen.people_px) == (view.worker_idx == worker).sum()
                assert not seen.object_class


def test_instants_are_the_views_at_the_sites_times():
    assert [instant.frame_set.t_ns for instant in CROWD.instants] == CROWD.site.t_ns.tolist()
    assert CROWD.instants[7].views[2] is CROWD.views[7][2].detections


def test_the_same_seed_gives_the_same_crowd():
    for one, other in zip(CROWD.views[:20], crowd(4, seconds=3.0, seed=0).views[:20], strict=True):
        for a, b in zip(one, other, strict=True):
            assert np.array_equal(a.detections.people_px, b.detections.people_px, equal_nan=True)
            assert np.array_equal(a.worker_idx, b.worker_idx)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("per_minute", -1.0, "a number in 0..inf"),
        ("shortest_s", -0.1, "a number in 0..inf"),
        ("longest_s", 0.4, "a number in 0.5..inf"),
        ("whole", 1.1, "a number in 0..1"),
    ],
)
def test_bursts_out_of_range_say_what_is_expected(name, value, expected):
    with pytest.raises(OptionError) as caught:
        Bursts(**{name: value})
    assert str(caught.value) == (
        f"option {name} is out of range\n  expected: {expected}\n  got:      {value!r}\n"
        f"  do next:  give {name} as {expected}"
    )
