"""The simulated site is what it says: bodies of human proportions that walk inside a room, things along its walls."""

from dataclasses import replace

import numpy as np
import pytest

from recognition.errors import RigRefusedError
from recognition.observations import JOINTS, LIMBS
from recognition.synthetic import FURNITURE, HEIGHT_M, semicircle_rig, simulate, walking

RIG = semicircle_rig(4)
STRAIGHT = np.stack([np.linspace(0, 4, 200), np.zeros(200)], axis=1)
J = {name: i for i, name in enumerate(JOINTS)}


def lengths(joints):
    ends = np.array(LIMBS)
    return np.linalg.norm(joints[..., ends[:, 0], :] - joints[..., ends[:, 1], :], axis=-1)


def test_limbs_keep_their_lengths_while_the_body_walks():
    assert np.ptp(lengths(walking(STRAIGHT)), axis=0).max() < 1e-12


def test_the_body_has_human_proportions():
    pose = walking(np.zeros((1, 2)))[0]
    assert pose[:, 2].max() == pytest.approx(0.936 * HEIGHT_M, abs=0.03)  # the eyes
    thigh = np.linalg.norm(pose[J["left_hip"]] - pose[J["left_knee"]])
    upper_arm = np.linalg.norm(pose[J["left_shoulder"]] - pose[J["left_elbow"]])
    assert thigh == pytest.approx(0.245 * HEIGHT_M)
    assert upper_arm == pytest.approx(0.186 * HEIGHT_M)
    np.testing.assert_allclose(walking(np.zeros((1, 2)), 2.0), walking(np.zeros((1, 2)), 1.0) * 2.0)


def test_the_lower_foot_stays_on_the_floor_and_the_feet_take_turns():
    ankles = walking(STRAIGHT)[:, [J["left_ankle"], J["right_ankle"]], 2]
    np.testing.assert_allclose(ankles.min(axis=1), 0.039 * HEIGHT_M)
    assert len(set(ankles.argmin(axis=1))) == 2


def test_arms_swing_against_the_legs():
    pose = walking(STRAIGHT)
    ahead = pose[..., 0] - pose[:, [J["left_hip"]], 0]
    wrist, ankle = ahead[:, J["left_wrist"]], ahead[:, J["left_ankle"]]
    assert np.corrcoef(wrist, ankle)[0, 1] < -0.5
    assert np.ptp(wrist) > 0.3


def test_the_body_faces_where_it_goes_with_its_left_on_the_left():
    for direction in ([1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]):
        pose = walking(np.arange(5)[:, None] * np.array(direction))[2]
        forward = pose[J["nose"]] - pose[[J["left_ear"], J["right_ear"]]].mean(axis=0)
        left = pose[J["left_shoulder"]] - pose[J["right_shoulder"]]
        assert forward[:2] @ direction > 0
        assert np.cross([*direction, 0.0], left)[2] > 0


def test_one_who_stands_still_keeps_the_heading():
    pose = walking(np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 2.0], [0.0, 2.0]]))
    assert np.isfinite(pose).all()
    np.testing.assert_allclose(pose[4], pose[3], atol=1e-12)
    still = walking(np.zeros((3, 2)))
    assert (still[:, J["nose"], 0] > 0).all()


def test_workers_walk_inside_the_room_at_walking_speed():
    for seed in range(3):
        site = simulate(RIG, workers=5, frames=300, fps=30.0, seed=seed, room_m=(8.0, 5.0))
        hips = site.joints_in_world_m[:, :, 11:13].mean(axis=2)
        assert np.abs(hips[..., 0]).max() <= 4.0
        assert np.abs(hips[..., 1]).max() <= 2.5
        speed = np.linalg.norm(np.diff(hips[..., :2], axis=0), axis=-1) * 30.0
        assert speed.max() <= 1.45
        assert speed.mean() > 0.3
        assert (site.joints_in_world_m[..., 2] > 0).all()


def test_the_site_of_the_paper_has_fourteen_objects():
    site = simulate(RIG, workers=4, frames=2)
    assert len(site.object_class) == 14
    assert site.object_class[:4] == ("hard_hat",) * 4
    assert site.object_class[4:] == tuple(name for name, _ in FURNITURE)


def test_hats_are_worn_and_things_stand_on_the_floor():
    site = simulate(RIG, workers=3, frames=20, seed=1)
    heads = site.joints_in_world_m[:, :, 3:5].mean(axis=2)
    assert np.linalg.norm(site.object_centre_in_world_m[:, :3] - heads, axis=-1).max() < 0.10 * HEIGHT_M
    bottoms = site.object_centre_in_world_m[:, 3:, 2] - site.object_size_m[3:, 2] / 2
    np.testing.assert_allclose(bottoms, 0.0, atol=1e-12)
    assert np.ptp(site.object_centre_in_world_m[:, 3:], axis=0).max() == 0.0


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_site():
    one, same, other = (simulate(RIG, frames=5, seed=seed) for seed in (3, 3, 4))
    assert one.joints_in_world_m.tobytes() == same.joints_in_world_m.tobytes()
    assert one.object_centre_in_world_m.tobytes() == same.object_centre_in_world_m.tobytes()
    assert one.joints_in_world_m.tobytes() != other.joints_in_world_m.tobytes()


def test_instants_are_a_frame_period_apart():
    site = simulate(RIG, frames=4, fps=60.0)
    assert site.t_ns.tolist() == [0, 16666667, 33333333, 50000000]


def test_a_rig_without_a_floor_is_refused():
    with pytest.raises(RigRefusedError) as caught:
        simulate(replace(RIG, world_from_rig=None))
    assert str(caught.value) == (
        "cannot simulate a site without a floor\n  where:    rig simulated\n"
        "  expected: a rig with world_from_rig\n  got:      null\n"
        "  do next:  measure it with rigcal world, or simulate on another rig"
    )


def test_the_semicircle_looks_at_its_centre_from_two_metres():
    rig = semicircle_rig(4, radius_m=6.0)
    target = rig.world_from_rig.inverse().apply([0.0, 0.0, 1.0])
    for mounted in rig.cameras:
        stand = rig.world_from_rig.apply(mounted.cam_from_rig.inverse().translation_m)
        assert np.hypot(*stand[:2]) == pytest.approx(6.0)
        assert stand[2] == pytest.approx(2.0)
        np.testing.assert_allclose(mounted.cam_from_rig.apply(target)[:2], 0.0, atol=1e-9)
        up_in_cam = mounted.cam_from_rig.rotation @ rig.world_from_rig.rotation.T @ [0.0, 0.0, 1.0]
        assert up_in_cam[1] < -0.9  # y is down
        assert up_in_cam[0] == pytest.approx(0.0, abs=1e-12)
    assert len(semicircle_rig(1).cameras) == 1
