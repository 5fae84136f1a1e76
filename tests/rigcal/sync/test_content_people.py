from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recognition.synthetic import semicircle_rig, simulate, walking
from rigcal.errors import OptionError
from rigcal.formats import import_rig
from rigcal.rigfile import rig_of
from rigcal.sync.content.people.keypoints import Keypoints, read_keypoints
from rigcal.sync.content.people.lags import PeopleOptions, people_lags
from rigcal.sync.content.people.search import Profile
from rigcal.sync.content.people.tracklets import tracklets
from rigcal.sync.content.people.verdict import search_problem, solution_problem

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "recognition" / "pose2sim_multi"
FPS, FINER = 30.0, 16
RIG = semicircle_rig(4)


def recorded(joints_at, seconds, late, *, noise_px=0.0, seed=0):
    """Keypoints of people in the world, each camera's frames ``late`` instants of 1/480 s after the first's."""
    cameras = [mounted.cam_from_rig @ RIG.world_from_rig.inverse() for mounted in RIG.cameras]
    frames = np.arange(round(seconds * FPS))
    rng = np.random.default_rng(seed)
    rows = []
    for view, (mounted, cam_from_world) in enumerate(zip(RIG.cameras, cameras, strict=True)):
        joints = joints_at[200 + late[view] + frames * FINER]
        px = mounted.camera.project(cam_from_world.apply(joints))
        px += rng.normal(0, noise_px, px.shape)
        inside = (px >= 0).all(axis=-1) & (px < mounted.camera.size_wh).all(axis=-1)
        kpts = np.where(inside[..., None], np.concatenate([px, np.ones((*px.shape[:-1], 1))], axis=-1), 0.0)
        for frame in frames:
            rows += [(frame, view, kpts[frame, person]) for person in rng.permutation(kpts.shape[1])]
    frame, view, kpts = zip(*rows, strict=True)
    times_s = np.repeat(frames[:, None] / FPS, 4, axis=1)
    return Keypoints(np.array(frame), np.array(view), np.array(kpts)), times_s


def walkers(seconds, workers=3, seed=1):
    count = round(seconds * FPS) * FINER + 400
    return simulate(RIG, workers=workers, frames=count, fps=FPS * FINER, seed=seed).joints_in_world_m


def treadmill(seconds, speed_m_s):
    count = round(seconds * FPS) * FINER + 400
    walked_m = speed_m_s * np.arange(count) / (FPS * FINER)
    joints = walking(np.stack([walked_m, 0 * walked_m], axis=-1))
    joints[..., 0] -= walked_m[:, None]
    return joints[:, None]


LATE = [0, 100, -37, 160]
TRUTH_S = np.array(LATE) / (FPS * FINER)


def test_exact_people_give_offsets_to_a_fiftieth_of_a_millisecond():
    keypoints, times_s = recorded(walkers(8.0), 8.0, LATE)
    found = people_lags(RIG, keypoints, times_s)
    assert all(lag.confident and not lag.reason for lag in found.cameras)
    assert np.abs([lag.offset_s for lag in found.cameras] - TRUTH_S).max() < 2e-5  # measured: 0.004 ms


def test_noisy_people_give_offsets_within_their_bounds():
    keypoints, times_s = recorded(walkers(16.0), 16.0, LATE, noise_px=3.0)
    found = people_lags(RIG, keypoints, times_s)
    assert found.method == "people"
    assert found.reference == "cam0"
    for lag, truth_s in zip(found.cameras, TRUTH_S, strict=True):
        assert lag.confident
        assert abs(lag.offset_s - truth_s) <= min(lag.bound_s, 0.003)  # measured: 1.7 ms at the most


def test_stamps_since_1970_give_the_same_offsets_as_stamps_since_zero():
    keypoints, times_s = recorded(walkers(5.0), 5.0, LATE)
    near, far = (people_lags(RIG, keypoints, times_s + epoch) for epoch in (0.0, 1.7e9))
    assert [lag.offset_s for lag in far.cameras] == pytest.approx([lag.offset_s for lag in near.cameras], abs=1e-5)
    assert far.cameras[1].at_s - near.cameras[1].at_s == pytest.approx(1.7e9, abs=1e-3)


def test_the_order_of_detections_does_not_matter():
    keypoints, times_s = recorded(walkers(5.0), 5.0, LATE)
    order = np.random.default_rng(0).permutation(len(keypoints.frame))
    mixed = Keypoints(keypoints.frame[order], keypoints.view[order], keypoints.kpts[order])
    offsets = [[lag.offset_s for lag in people_lags(RIG, k, times_s).cameras] for k in (keypoints, mixed)]
    assert offsets[1] == pytest.approx(offsets[0], abs=1e-6)


def test_people_who_stand_still_decide_nothing():
    keypoints, times_s = recorded(treadmill(5.0, 0.0), 5.0, LATE, noise_px=3.0)
    found = people_lags(RIG, keypoints, times_s)
    assert not any(lag.confident for lag in found.cameras)
    assert {lag.reason for lag in found.cameras[1:]} == {"the people hardly move: every offset fits alike"}
    assert found.cameras[0].reason == "no other camera's clock can be told against it"


def test_a_treadmill_repeats_itself_and_decides_nothing():
    keypoints, times_s = recorded(treadmill(8.0, 1.3), 8.0, LATE, noise_px=3.0)
    found = people_lags(RIG, keypoints, times_s)
    assert not any(lag.confident for lag in found.cameras)
    assert all("two offsets fit nearly alike" in lag.reason for lag in found.cameras[1:])


def test_a_camera_that_sees_nobody_says_so_and_the_others_are_told():
    keypoints, times_s = recorded(walkers(8.0), 8.0, LATE)
    others = keypoints.view != 2
    kept = Keypoints(keypoints.frame[others], keypoints.view[others], keypoints.kpts[others])
    found = people_lags(RIG, kept, times_s)
    assert [lag.confident for lag in found.cameras] == [True, True, False, True]
    assert found.cameras[2].reason == "nobody was followed in this camera for a quarter of a second"


def test_without_anybody_no_camera_is_told():
    empty = Keypoints(np.zeros(0), np.zeros(0), np.zeros((0, 17, 3)))
    found = people_lags(RIG, empty, np.zeros((0, 4)))
    assert not any(lag.confident for lag in found.cameras)


def test_cameras_that_recorded_at_different_hours_have_nothing_in_common():
    keypoints, times_s = recorded(walkers(4.0), 4.0, LATE)
    found = people_lags(RIG, keypoints, times_s + 3600 * np.arange(4))
    assert not any(lag.confident for lag in found.cameras)
    assert found.cameras[1].reason == "too few common frames: no other camera sees people at the same time"


def test_times_of_another_shape_are_refused():
    keypoints, times_s = recorded(walkers(2.0), 2.0, LATE)
    with pytest.raises(ValueError, match=r"times_s: expected \(60 or more, 4\), got \(60, 3\)"):
        people_lags(RIG, keypoints, times_s[:, :3])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"search_s": 0.0}, "give search_s as seconds in 0.3..60"),
        ({"min_score": 0.0}, "give min_score as a score above 0, at most 1"),
        ({"drift_limit_ppm": -1.0}, "give drift_limit_ppm as parts per million above 0"),
        ({"readout_s": {"cam1": 3.0}}, "give readout_s of cam1 as seconds below 0.2"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        PeopleOptions(**options)


def profile(agreement, lead=9.0):
    change = np.arange(len(agreement)) - len(agreement) // 2
    return Profile(change, np.array(agreement), np.full(len(agreement), lead))


@pytest.mark.parametrize(
    ("seen", "reason"),
    [
        (profile([0.1] * 9 + [0.5, 0.9, 0.5] + [0.1] * 9), ""),
        (
            profile([np.nan] * 10 + [0.9, 0.5] + [0.1] * 9),
            "the best offset, 0 ms, is at the end of what can be compared",
        ),
        (profile([0.1] * 10 + [0.3] + [0.1] * 10), "only 30% of the joints fit at the best offset"),
        (profile([np.nan] * 9 + [0.5, 0.9, 0.5] + [np.nan] * 9), "too few common frames"),
        (profile([0.85] * 10 + [0.9] + [0.85] * 10), "the people hardly move: every offset fits alike"),
        (profile([0.1, 0.88, *[0.1] * 8, 0.9, *[0.1] * 10]), "two offsets fit nearly alike, 0 ms and -450 ms"),
        (profile([0.1] * 9 + [0.5, 0.9, 0.5] + [0.1] * 9, lead=1.0), "two offsets fit nearly alike"),
    ],
)
def test_the_search_says_why_it_does_not_decide(seen, reason):
    found = search_problem(seen, 0.05, 0.0, 2.0)
    assert found.startswith(reason)
    assert bool(found) == bool(reason)


def test_the_solution_says_why_it_does_not_decide():
    assert solution_problem(0.003, 0.001, 0.033) == ""
    assert solution_problem(0.02, 0.0, 0.033) == "the motion tells the offset to 20 ms only, half a frame is 16.5 ms"
    differ = "where most joints fit and where they fit best on average differ by 30 ms"
    assert solution_problem(0.003, -0.03, 0.033) == differ


def crossing(frames=40):
    """Two people who pass each other in one view, 60 px apart in height."""
    body = np.random.default_rng(0).uniform(0, 300, (17, 2))
    x = np.linspace(0, 600, frames)
    one = body + np.stack([x, 0 * x], axis=-1)[:, None]
    two = body[::-1] + np.stack([600 - x, 60 + 0 * x], axis=-1)[:, None]
    return np.stack([one, two], axis=1)


def test_people_who_cross_keep_their_tracklets():
    people = crossing()
    frame = np.repeat(np.arange(len(people)), 2)
    order = np.random.default_rng(1).permutation(len(frame))
    found = tracklets(frame[order], people.reshape(-1, 17, 2)[order], np.arange(len(people)) / FPS)
    assert len(found) == 2
    for tracklet in found:
        steps = np.diff(tracklet.points_px[:, 0, 0])
        assert len(tracklet.frame) == len(people)
        assert (np.sign(steps) == np.sign(steps[0])).all()


def test_a_short_gap_is_bridged_and_a_long_one_is_not():
    people = crossing()[:, 0]
    t_s = np.arange(len(people)) / FPS
    short, long = (np.delete(np.arange(len(people)), slice(15, 15 + gap)) for gap in (5, 14))
    assert len(tracklets(short, people[short], t_s)) == 1
    assert len(tracklets(long, people[long], t_s)) == 2


@pytest.mark.skipif(not DATA.exists(), reason="the shared captures are not here")
@pytest.mark.parametrize(("camera", "shift"), [(0, 17), (1, -30), (2, 23), (3, -8)])
def test_real_people_shifted_by_whole_frames_are_found_exactly(camera, shift):
    rig = rig_of(import_rig(DATA / "dataset.json", from_format="multiview-dataset", created_utc="2026-01-01T00:00:00Z"))
    real = read_keypoints(DATA / "data.npz", rig)
    frame = np.where(real.view == camera, real.frame + shift, real.frame)
    kept = (frame >= 0) & (frame < 100)
    times_s = np.repeat(np.arange(100)[:, None] / 60.0, 4, axis=1)
    found = people_lags(rig, Keypoints(frame[kept], real.view[kept], real.kpts[kept]), times_s)
    right = -shift * ((np.arange(4) == camera) - float(camera == 0))
    assert all(lag.confident for lag in found.cameras)
    assert [round(lag.offset_s * 60) for lag in found.cameras] == right.tolist()
    assert all(abs(lag.offset_s - n / 60) <= lag.bound_s for lag, n in zip(found.cameras, right, strict=True))
