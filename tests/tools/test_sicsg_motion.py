"""Motion of workers: bones keep their lengths, feet and hands touch exactly what the state says, nothing jumps."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from tools.sicsg.catalog import item, leaning_pose
from tools.sicsg.scene import Action, Attachment, Keyframe, Scene, Thing, Worker
from tools.sicsg.skeleton import BONES, JOINTS, PARENT, REST_ARM_RAD, body, crown, rest_coco, rest_joints
from tools.sicsg.workers.motion import WorkerState, worker_state
from tools.sicsg.workers.motion_writer import MotionError
from tools.sicsg.workers.stations import (
    StationError,
    carry_grips,
    carry_height_m,
    carry_stations,
    climb_base,
    hold_grips,
    hold_station,
    ladder_of,
    mount_base,
)

VARIANT, BODY, MOTION = "0003", "0009", "0004"
STEP_S = 1 / 30
LIMBS = [("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("left_hip", "left_knee")]
LIMBS += [("left_knee", "left_ankle"), ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")]
LIMBS += [tuple(name.replace("left", "right") for name in limb) for limb in LIMBS[:4]]


def keyframe(t_s: float, matrix: np.ndarray) -> Keyframe:
    half = np.arctan2(matrix[1, 0], matrix[0, 0]) / 2
    return Keyframe(
        t_s=t_s, position_m=tuple(matrix[:3, 3].tolist()), quat_wxyz=(float(np.cos(half)), 0, 0, float(np.sin(half)))
    )


def upright(x: float, y: float, z: float, yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def act(verb: str, start_s: float, end_s: float, **entries) -> Action:
    return Action(verb=verb, start_s=start_s, end_s=end_s, **entries)


def worker(*actions: Action, motion: str = MOTION, name: str = "w", build: str = BODY) -> Worker:
    return Worker(id=name, body=build, clothes="0000", motion=motion, actions=actions)


def scene(one: Worker, *things: Thing) -> Scene:
    """Motion reads nothing else of a scene."""
    return SimpleNamespace(workers=(one,), things=things)


def point(at: np.ndarray) -> tuple[float, float, float]:
    return tuple(np.asarray(at, dtype=float).tolist())


@cache
def step_ladder() -> Thing:
    return Thing(id="ladder", category="step_ladder", variant=VARIANT, path=(keyframe(0, upright(0.4, -0.3, 0, 0.7)),))


@cache
def leaning() -> Thing:
    pose = leaning_pose(item("ladder", VARIANT), np.array([0.5, 0.2, 0.0]), 0.4, np.deg2rad(15.0))
    w = 0.5 * np.sqrt(1 + np.trace(pose[:3, :3]))
    v = [pose[2, 1] - pose[1, 2], pose[0, 2] - pose[2, 0], pose[1, 0] - pose[0, 1]] / (4 * w)
    key = Keyframe(t_s=0.0, position_m=point(pose[:3, 3]), quat_wxyz=(float(w), *point(v)))
    return Thing(id="ladder", category="ladder", variant=VARIANT, path=(key,))


@cache
def window() -> Thing:
    z = carry_height_m(item("large_window", VARIANT), body(BODY))
    path = ((0.0, (0, 0, z, 0.3)), (1.0, (0, 0, z, 0.3)), (3.0, (-0.3, 0.9, z, 0.7)), (4.0, (-0.3, 0.9, z, 0.7)))
    keys = tuple(keyframe(t, upright(*place)) for t, place in path)
    return Thing(id="window", category="large_window", variant=VARIANT, path=keys)


@cache
def platform() -> Thing:
    return Thing(id="deck", category="platform", variant=VARIANT, path=(keyframe(0, upright(0.2, 0.1, 0, 2.5)),))


def climbs(thing: Thing) -> Worker:
    what, pose = item(thing.category, thing.variant), thing.pose(0.0)
    at, yaw = climb_base(what, pose)
    top = float(ladder_of(what, pose).middles[2, 2])
    return worker(
        act("stand", 0, 1, at_m=point(at), yaw_rad=yaw),
        act("climb", 1, 4, thing="ladder", height_m=(0.0, top)),
        act("climb", 4, 6, thing="ladder", height_m=(top, top)),
        act("climb", 6, 9, thing="ladder", height_m=(top, 0.0)),
        act("stand", 9, 10, at_m=point(at), yaw_rad=yaw),
    )


def mounts() -> Worker:
    what, pose = item("platform", VARIANT), platform().pose(0.0)
    deck = what.deck_m @ pose[:3, :3].T + pose[:3, 3]
    spot = 0.8 * deck.mean(axis=0) + 0.1 * (deck[1] + deck[2])
    at, yaw = mount_base(what, pose, spot)
    top = float(spot[2])
    return worker(
        act("stand", 0, 1, at_m=point(at), yaw_rad=yaw),
        act("mount", 1, 4, thing="deck", at_m=point(spot), height_m=(0.0, top)),
        act("mount", 4, 6, thing="deck", at_m=point(spot), height_m=(top, top), look_m=(0.0, 2.0, top + 1.3)),
        act("mount", 6, 9, thing="deck", at_m=point(spot), height_m=(top, 0.0)),
        act("stand", 9, 10, at_m=point(at), yaw_rad=yaw),
    )


def holds(thing: Thing, side: str) -> Worker:
    at, _ = hold_station(item(thing.category, thing.variant), thing.pose(0.0), side)
    away = (at[0] + 0.9, at[1] - 0.4, 0.0)
    return worker(
        act("walk", 0, 1.5, path_m=(away, point(at))),
        act("hold", 1.5, 4, thing="ladder", side=side),
        act("walk", 4, 5.5, path_m=(point(at), away)),
    )


def carries(side: str) -> Worker:
    return worker(act("carry", 0, 4, thing="window", side=side))


def goes_about() -> Worker:
    path = ((0.0, 0.0, 0.0), (1.6, 0.2, 0.0), (1.2, 1.9, 0.0))
    return worker(
        act("stand", 0, 2, at_m=path[0], yaw_rad=-2.5),
        act("walk", 2, 5.4, path_m=path),
        act("crouch", 5.4, 7.4, at_m=path[-1], yaw_rad=0.5),
        act("work", 7.4, 9.4, at_m=path[-1], yaw_rad=2.0, look_m=(1.0, 2.4, 1.3)),
        act("stand", 9.4, 12.0, at_m=path[-1], yaw_rad=1.0, look_m=(-2.0, 0.0, 1.0)),
    )


CASES = {
    "goes_about": lambda: (goes_about(),),
    "step_ladder": lambda: (climbs(step_ladder()), step_ladder()),
    "ladder": lambda: (climbs(leaning()), leaning()),
    "hold": lambda: (holds(step_ladder(), "left"), step_ladder()),
    "carry": lambda: (carries("left"), window()),
    "alone": lambda: (carries("alone"), window()),
    "mount": lambda: (mounts(), platform()),
}
every_case = pytest.mark.parametrize("name", CASES)


@cache
def played(name: str) -> tuple[np.ndarray, tuple[WorkerState, ...]]:
    one, *things = CASES[name]()
    times = np.arange(one.actions[0].start_s, one.actions[-1].end_s, STEP_S)
    return times, tuple(worker_state(scene(one, *things), one, float(t)) for t in times)


def of_bone(state: WorkerState, bone: str, rest_point: np.ndarray) -> np.ndarray:
    matrix = state.bones[BONES.index(bone)]
    return matrix[:3, :3] @ rest_point + matrix[:3, 3]


def ball(state: WorkerState, side: str) -> np.ndarray:
    """The sole under the ball of the foot, 0.075 of the body height before the ankle."""
    ankle = rest_joints(body(BODY))[BONES.index(f"{side}_foot")]
    return of_bone(state, f"{side}_foot", np.array([ankle[0] + 0.075 * body(BODY).height_m, ankle[1], 0.0]))


def palm(state: WorkerState, side: str, build: str = BODY) -> np.ndarray:
    sign = 1.0 if side == "left" else -1.0
    along = np.array([0.0, sign * np.sin(REST_ARM_RAD), -np.cos(REST_ARM_RAD)])
    wrist = rest_joints(body(build))[BONES.index(f"{side}_hand")]
    return of_bone(state, f"{side}_hand", wrist + 0.05 * body(build).height_m * along)


def joint(state: WorkerState, name: str) -> np.ndarray:
    return state.joints_m[JOINTS.index(name)]


@every_case
def test_bones_are_rotations_and_stay_joined(name):
    rest = rest_joints(body(BODY))
    for state in played(name)[1][::15]:
        rotations = state.bones[:, :3, :3]
        np.testing.assert_allclose(rotations @ rotations.transpose(0, 2, 1), np.tile(np.eye(3), (17, 1, 1)), atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-9)
        for i, parent in enumerate(PARENT):
            if parent >= 0:
                joined = of_bone(state, BONES[i], rest[i]) - of_bone(state, BONES[parent], rest[i])
                np.testing.assert_allclose(joined, 0.0, atol=1e-9)


@every_case
def test_limbs_keep_their_lengths(name):
    rest = rest_coco(body(BODY))
    for one, two in LIMBS:
        i, j = JOINTS.index(one), JOINTS.index(two)
        wanted = np.linalg.norm(rest[i] - rest[j])
        found = [np.linalg.norm(state.joints_m[i] - state.joints_m[j]) for state in played(name)[1]]
        np.testing.assert_allclose(found, wanted, atol=1e-9, err_msg=f"{one}-{two}")


@every_case
def test_nothing_jumps(name):
    """Heads and hips move less than 5 cm per frame beyond walking pace; feet and hands are slower than 6 m/s."""
    joints = np.array([state.joints_m for state in played(name)[1]])
    moved = np.linalg.norm(np.diff(joints, axis=0), axis=2)
    calm = [JOINTS.index(joint) for joint in ("nose", "left_hip", "right_hip", "left_shoulder", "right_shoulder")]
    assert moved[:, calm].max() < 0.05 + 1.3 * STEP_S
    assert moved.max() < 6.0 * STEP_S


@every_case
def test_motion_is_continuous_in_time(name):
    """At a hundredth of a frame a jump would stand out."""
    one, *things = CASES[name]()
    borders = [action.start_s for action in one.actions]
    for t in (*borders, *np.random.default_rng(4).uniform(borders[0], one.actions[-1].end_s, 16)):
        before, after = (worker_state(scene(one, *things), one, float(t) + dt).joints_m for dt in (-1e-4, 1e-4))
        assert np.linalg.norm(after - before, axis=1).max() < 2e-4 * 8.0


@every_case
def test_planted_feet_stay_where_they_are(name):
    _, states = played(name)
    for side, which in enumerate(("left", "right")):
        for before, after in pairwise(states):
            if before.feet_on[side] and before.feet_on[side] == after.feet_on[side]:
                moved = np.linalg.norm(ball(after, which) - ball(before, which))
                assert moved < 0.005 or moved > 0.1, "neither stands nor has stepped in between"


@every_case
def test_soles_are_at_the_height_of_what_they_stand_on(name):
    _, *things = CASES[name]()
    levels = {"floor": [0.0]}
    for thing in things:
        what, pose = item(thing.category, thing.variant), thing.pose(0.0)
        points = np.concatenate([what.steps_m.mean(axis=1), what.deck_m]) @ pose[:3, :3].T + pose[:3, 3]
        levels[thing.id] = points[:, 2].tolist()
    for state in played(name)[1]:
        for on, side in zip(state.feet_on, ("left", "right"), strict=True):
            z = ball(state, side)[2]
            assert z > -0.005
            if on:
                assert min(abs(z - level) for level in levels[on]) < 0.01


@every_case
def test_one_foot_at_least_stands(name):
    assert all(any(state.feet_on) for state in played(name)[1])


@every_case
def test_knees_and_elbows_bend_one_way(name):
    for state in played(name)[1]:
        for side in ("left", "right"):
            knee = joint(state, f"{side}_knee")
            forward = state.bones[BONES.index(f"{side}_thigh"), :3, 0]
            along = joint(state, f"{side}_ankle") - joint(state, f"{side}_hip")
            off = knee - joint(state, f"{side}_hip")
            assert (off - along * (off @ along) / (along @ along)) @ forward > -1e-9
            fore = joint(state, f"{side}_wrist") - joint(state, f"{side}_elbow")
            assert fore @ state.bones[BONES.index(f"{side}_upper_arm"), :3, 0] > -1e-9


@pytest.mark.parametrize("side", ["left", "right", "front"])
@pytest.mark.parametrize("thing", [step_ladder, leaning], ids=["step_ladder", "ladder"])
def test_who_holds_a_ladder_has_both_hands_on_its_grips(thing, side):
    one = holds(thing(), side)
    grips = hold_grips(item(thing().category, VARIANT), thing().pose(0.0))
    for t in np.arange(2.9, 4.0, 0.2):
        state = worker_state(scene(one, thing()), one, float(t))
        assert state.hands_on == ("ladder", "ladder")
        hands = np.stack([palm(state, "left"), palm(state, "right")])
        off = np.linalg.norm(hands[:, None] - grips[None], axis=2)
        assert min(np.trace(off), np.trace(off[::-1])) < 0.02
    assert worker_state(scene(one, thing()), one, 1.4).hands_on == ("", "")
    assert worker_state(scene(one, thing()), one, 4.5).hands_on == ("", "")


@pytest.mark.parametrize("side", ["left", "right", "alone"])
@pytest.mark.parametrize("build", ["0003", BODY, "0077"])
def test_carriers_never_lose_the_window(side, build):
    one = worker(act("carry", 0, 4, thing="window", side=side), build=build)
    grips = carry_grips(item("large_window", VARIANT), side)
    for t in np.arange(0.0, 4.0, 0.2):
        state = worker_state(scene(one, window()), one, float(t))
        assert state.hands_on == ("window", "window")
        pose = window().pose(float(t))
        for hand, grip in zip(("left", "right"), grips, strict=True):
            assert np.linalg.norm(palm(state, hand, build) - (pose[:3, :3] @ grip + pose[:3, 3])) < 0.02
        at, _ = carry_stations(item("large_window", VARIANT), pose, side)
        hips = (joint(state, "left_hip") + joint(state, "right_hip")) / 2
        assert np.linalg.norm((hips - at)[:2]) < 0.12


@pytest.mark.parametrize("name", ["step_ladder", "ladder"])
def test_climbing_leaves_the_floor_once_and_comes_back_once(name):
    times, states = played(name)
    on_floor = np.array(["floor" in state.feet_on for state in states])
    changes = times[np.flatnonzero(np.diff(on_floor.astype(int)))]
    assert len(changes) == 2
    assert 1.0 < changes[0] < 4.0
    assert 6.0 < changes[1] < 9.0
    assert states[0].feet_on == states[-1].feet_on == ("floor", "floor")
    stays = [state for t, state in zip(times, states, strict=True) if 4.0 <= t < 6.0]
    assert all(state.feet_on == ("ladder", "ladder") for state in stays)


@pytest.mark.parametrize("name", ["step_ladder", "ladder"])
def test_a_climber_holds_on_and_works_with_one_hand_up_there(name):
    times, states = played(name)
    for t, state in zip(times, states, strict=True):
        if 1.6 < t < 4.0 or 6.5 < t < 9.0:
            assert "ladder" in state.hands_on
        if 4.6 < t < 6.0:
            assert sorted(state.hands_on) == ["", "ladder"]


def test_hands_on_rails_are_on_the_rails():
    what, pose = item("ladder", VARIANT), leaning().pose(0.0)
    ladder = ladder_of(what, pose)
    for state in played("ladder")[1]:
        for side, on in zip(("left", "right"), state.hands_on, strict=True):
            if on:
                hand = palm(state, side)
                assert min(np.linalg.norm(ladder.rail(i, hand[2]) - hand) for i in range(2)) < 0.021


def test_mounting_ends_on_the_deck_at_the_point_asked_for():
    times, states = played("mount")
    spot = mounts().actions[1].at_m
    for t, state in zip(times, states, strict=True):
        if 4.0 < t < 6.0 and all(state.feet_on):
            assert state.feet_on == ("deck", "deck")
    there = states[int(5.5 / STEP_S)]
    hips = (joint(there, "left_hip") + joint(there, "right_hip")) / 2
    assert np.linalg.norm(hips[:2] - spot[:2]) < 0.08
    assert states[-1].feet_on == ("floor", "floor")


def test_a_walk_ends_where_its_path_ends():
    one = goes_about()
    state = worker_state(scene(one), one, 5.4)
    feet = (ball(state, "left") + ball(state, "right")) / 2
    hips = (joint(state, "left_hip") + joint(state, "right_hip")) / 2
    assert np.linalg.norm(hips[:2] - one.actions[1].path_m[-1][:2]) < 0.05
    assert np.linalg.norm(feet[:2] - one.actions[1].path_m[-1][:2]) < 0.12


def test_a_walk_keeps_its_speed_and_bobs():
    one = worker(act("walk", 0, 4, path_m=((0.0, 0.0, 0.0), (4.4, 0.0, 0.0))))
    hips = np.array(
        [worker_state(scene(one), one, t).joints_m[11:13].mean(axis=0) for t in np.arange(0.8, 3.2, STEP_S)]
    )
    speed = np.diff(hips[:, 0]) / STEP_S
    assert speed.std() < 0.1 * speed.mean()
    assert 0.015 < np.ptp(hips[:, 2]) < 0.09


def test_a_hat_is_put_on_by_the_hand_that_holds_it():
    spans = [(-1e6, 3.0, "right_hand"), (3.0, 1e6, "head")]
    attached = tuple(Attachment(start_s=a, end_s=b, worker="w", bone=bone) for a, b, bone in spans)
    hat = Thing(id="hat", category="hard_hat", variant=VARIANT, path=window().path, attached=attached)
    one = worker(act("stand", 0, 6, at_m=(0.0, 0.0, 0.0), yaw_rad=0.0))

    def from_crown(t_s: float) -> float:
        state = worker_state(scene(one, hat), one, t_s)
        return float(np.linalg.norm(palm(state, "right") - of_bone(state, "head", crown(body(BODY)))))

    assert from_crown(3.0) < 0.15
    assert from_crown(2.4) > 0.35
    assert from_crown(3.6) > 0.35


def test_the_same_names_give_the_same_motion_and_others_another():
    one, other = goes_about(), goes_about().model_copy(update={"motion": "0031"})
    first, again = (worker_state(scene(one), one, 3.3).bones for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - worker_state(scene(other), other, 3.3).bones).max() > 0.01


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (act("climb", 0, 2, thing="nowhere", height_m=(0, 1)), r"'w', action 0 \(climb.*'nowhere' is not in the scene"),
        (act("climb", 0, 2, thing="ladder"), r"'w', action 0 \(climb, 0 to 2 s\): needs the entry height_m"),
        (act("stand", 0, 2, at_m=(0, 0, 0)), r"action 0 \(stand, 0 to 2 s\): needs the entry yaw_rad"),
        (act("work", 0, 2, at_m=(0, 0, 0), yaw_rad=0), r"needs the entry look_m"),
        (act("walk", 0, 2), r"needs the entry path_m"),
        (act("carry", 0, 2, thing="ladder", side="left"), r"step_ladder 0003 has 2 grips; to be carried it needs four"),
    ],
)
def test_an_action_that_cannot_be_done_names_worker_action_and_entry(action, message):
    one = worker(action)
    with pytest.raises(MotionError, match=message):
        worker_state(scene(one, step_ladder()), one, 1.0)


def test_an_action_far_from_the_one_before_is_refused():
    one = worker(
        act("stand", 0, 1, at_m=(0, 0, 0), yaw_rad=0.0),
        act("stand", 1, 2, at_m=(2.5, 0, 0), yaw_rad=0.0),
    )
    with pytest.raises(MotionError, match=r"action 1 .* begins 2\.50 m from where the action before ends"):
        worker_state(scene(one), one, 1.5)


def test_what_has_no_deck_cannot_be_mounted():
    with pytest.raises(StationError, match="step_ladder 0003 has no deck"):
        mount_base(item("step_ladder", VARIANT), np.eye(4), np.zeros(3))
