"""Data sets with 3D truth are read in both forms, and a run is judged by them at the right instants."""

import json

import numpy as np
import pytest

from recognition.errors import DatasetError
from recognition.evaluation import TimedTruth, evaluate_people, open_dataset
from recognition.metrics import Truth
from recognition.observations import JOINTS, FrameSet, Instant, Scene, ViewDetections, WorkerTrack
from recognition.synthetic import walking
from rigcal.geometry import Pose

STANDING = walking(np.zeros((1, 2)))[0]
LIMBS = JOINTS[5:]  # the twelve that data sets without faces know


def write_frames(folder, *, joints=LIMBS, about=None, **arrays):
    """A multi-view data set of two workers in frames 10 to 19, with detections of nobody."""
    frame, person = (each.ravel() for each in np.meshgrid(np.arange(10, 20), [1, 2], indexing="ij"))
    places = np.stack([STANDING[[JOINTS.index(name) for name in joints if name in JOINTS]]] * len(frame))
    places[..., 0] += 2.0 * person[:, None]
    nobody = {"det_frame": np.zeros(0, int), "det_view": np.zeros(0, int), "det_kpts": np.zeros((0, 17, 3))}
    given = {**nobody, "gt_frame": frame, "gt_person": person, "gt_joints": places} | arrays
    np.savez(folder / "data.npz", **{name: array for name, array in given.items() if array is not None})
    facts = {"name": "x", "gt_joints": list(joints)} if about is None else about
    (folder / "dataset.json").write_text(json.dumps(facts))
    (folder / "x.rig.json").touch()
    return folder


def write_sequence(folder, **changed):
    t_s = np.array([[0.0, 0.01], [0.5, 0.51], [1.0, 1.01]])
    joints = np.stack([STANDING[None] + [x, 0, 0] for x in (0.0, 1.0, 1.5)])
    arrays = {"t_s": t_s, "joints_m": joints} | changed
    np.savez(folder / "truth.npz", **{name: array for name, array in arrays.items() if array is not None})
    (folder / "truth.json").write_text(json.dumps({"format": "sicsg.sequence", "epoch_s": 1_790_000_000.0}))
    for name in ("true.rig.json", "cam0.mp4"):
        (folder / name).touch()
    return folder


def instants(times_ns, numbers=None):
    nothing = (ViewDetections.empty(),) * 2
    return [
        Instant(FrameSet(number, t_ns, (None, None)), nothing)
        for number, t_ns in zip(numbers or range(len(times_ns)), times_ns, strict=True)
    ]


def standing_at(place_m, rig_from_world=None):
    """Places one worker where ``place_m`` of the time in seconds says."""

    def place(instant):
        t_ns = instant.frame_set.t_ns
        joints = STANDING + [place_m(t_ns * 1e-9), 0, 0]
        joints = joints if rig_from_world is None else rig_from_world.apply(joints)
        worker = WorkerTrack(1, joints, np.full(17, 2), np.zeros(2))
        return Scene(instant.frame_set.index, t_ns, (worker,), ())

    return place


def test_a_perfect_run_scores_full_marks_in_the_world_frame():
    world_from_rig = Pose.from_quat_wxyz([0.8, 0.0, 0.6, 0.0], [1.0, 2.0, 3.0])
    place = standing_at(lambda t_s: t_s, world_from_rig.inverse())
    truth = Truth.of(np.stack([STANDING[None] + [i / 30, 0, 0] for i in range(5)]))
    times = [round(i / 30 * 1e9) for i in range(5)]
    done = []
    found = evaluate_people(instants(times), place, truth, world_from_rig=world_from_rig, progress=done.append)
    assert (found.scores.pcp3d, found.scores.idf1, found.scores.recall) == (1.0, 1.0, 1.0)
    assert found.scores.mpjpe_m < 1e-8
    assert (found.instants, found.scenes, found.truth_instants, done[-1]) == (5, 5, 5, 5)
    assert evaluate_people(instants(times), place, truth, world_from_rig=None).scores.recall == 0.0


def test_instants_that_nothing_was_placed_at_are_misses():
    place = standing_at(lambda _: 0.0)
    truth = Truth.of(np.stack([STANDING[None]] * 4))
    found = evaluate_people(
        instants([0, 1, 2, 3]), lambda i: place(i) if i.frame_set.index > 1 else None, truth, world_from_rig=None
    )
    assert (found.scores.recall, found.scores.pcp3d, found.scenes) == (0.5, 0.5, 2)


def test_minutes_of_a_worker_are_of_the_truths_instants():
    def place(instant):
        half = instant.frame_set.index // 30
        worker = WorkerTrack(1 + half, STANDING, np.full(17, 2), np.zeros(2))
        return Scene(instant.frame_set.index, instant.frame_set.t_ns, (worker,), ())

    truth = Truth(np.arange(0, 60, 2), np.zeros(30), np.stack([STANDING] * 30))  # every other of 60 instants: 6 s
    times = [round(i * 1e8) for i in range(60)]
    scores = evaluate_people(instants(times), place, truth, world_from_rig=None).scores
    assert (scores.switches, scores.switches_per_worker_minute) == (1, pytest.approx(10.0))
    one = evaluate_people(instants([0]), place, Truth.of(STANDING[None, None]), world_from_rig=None).scores
    assert np.isnan(one.switches_per_worker_minute)


def test_a_timed_truth_is_asked_for_at_the_instants_times():
    truth = TimedTruth(np.array([0, 500, 1000]), np.stack([STANDING[None] + [x, 0, 0] for x in (0.0, 1.0, 1.5)]))
    at = truth.at(np.array([7, 8, 9, 10, 11]), np.array([-1, 0, 250, 900, 1001]))
    assert at.frame.tolist() == [8, 9, 10]
    assert (at.joints_m[:, 0, 0] - STANDING[0, 0]) == pytest.approx([0.0, 0.5, 1.4])


def test_a_timed_truth_that_knows_a_worker_at_one_time_only_gives_it_there_only():
    joints = np.full((3, 1, 17, 3), np.nan)
    joints[1] = STANDING
    truth = TimedTruth(np.array([0, 500, 1000]), joints).at(np.arange(5), np.array([0, 499, 500, 501, 1000]))
    assert truth.frame.tolist() == [2]


def test_a_run_at_other_times_than_the_truth_says_so():
    truth = TimedTruth(np.array([10**18, 2 * 10**18]), np.zeros((2, 1, 17, 3)))
    with pytest.raises(DatasetError) as caught:
        evaluate_people(instants([0, 1]), lambda _: None, truth, world_from_rig=None)
    assert str(caught.value) == (
        "the truth knows none of the instants of this run\n  expected: frames or times that both have\n"
        "  got:      a truth of 0 frames, a run of 2 instants, 0 to 1\n"
        "  do next:  see that gt_frame counts as det_frame does, or that the rig's clocks are those of the truth"
    )


def test_joints_have_the_names_that_the_data_set_gives_them(tmp_path):
    found = open_dataset(write_frames(tmp_path, joints=(*LIMBS[::-1],)))
    assert np.isnan(found.truth.joints_m[:, :5]).all()
    assert found.truth.joints_m[0, 5:] == pytest.approx(STANDING[5:] + [2.0, 0, 0])
    assert found.truth.frame.tolist() == sorted([*range(10, 20)] * 2)
    assert found.warnings == ()


def test_networks_look_at_the_videos_where_there_are_no_detections(tmp_path):
    found = open_dataset(write_frames(tmp_path))
    assert (found.rig, found.detections, found.capture) == (tmp_path / "x.rig.json", tmp_path / "data.npz", None)
    write_frames(tmp_path, det_frame=None, det_view=None, det_kpts=None, points_2d=np.zeros((4, 2)))
    with pytest.raises(DatasetError, match="this data set has neither detections nor videos") as caught:
        open_dataset(tmp_path)
    assert caught.value.got == "gt_frame, gt_person, gt_joints, points_2d"
    assert open_dataset(tmp_path, detections=tmp_path / "d.npz").detections == tmp_path / "d.npz"
    (tmp_path / "cam0.mp4").touch()
    found = open_dataset(tmp_path)
    assert (found.detections, found.capture) == (None, tmp_path)


def test_joints_without_names_are_coco_17_and_others_are_left_out(tmp_path):
    seventeen = np.stack([STANDING] * 20)
    found = open_dataset(write_frames(tmp_path, about={}, gt_joints=seventeen))
    assert np.array_equal(found.truth.joints_m, seventeen)
    names = ["top_head", *LIMBS]
    joints = np.concatenate([np.zeros((20, 1, 3)), seventeen[:, 5:]], axis=1)
    found = open_dataset(write_frames(tmp_path, about={"gt_joints": names}, gt_joints=joints))
    assert np.array_equal(found.truth.joints_m[:, 5:], seventeen[:, 5:])
    assert found.warnings == (
        "1 of the 13 joints of the truth have no name of COCO-17 and are not scored: top_head",
        "20 joints of the truth at exactly 0, 0, 0 were taken as not known, which NaN would say",
    )


@pytest.mark.parametrize(
    ("names", "got"),
    [
        (None, "no names"),
        (14, 14),
        (["left_knee"] * 14, ["left_knee"] * 14),
        ([f"joint {n}" for n in range(14)], [f"joint {n}" for n in range(14)]),
        (["left_knee"], ["left_knee"]),
    ],
)
def test_joints_that_are_not_named_say_how_to_name_them(tmp_path, names, got):
    write_frames(tmp_path, about={"gt_joints": names}, gt_joints=np.zeros((20, 14, 3)))
    with pytest.raises(DatasetError) as caught:
        open_dataset(tmp_path)
    assert str(caught.value) == (
        f"gt_joints does not name the joints of the truth\n  where:    {tmp_path}/dataset.json\n"
        f"  expected: a list of 14 different names, COCO-17's among them: {', '.join(JOINTS)}\n  got:      {got}\n"
        '  do next:  add "gt_joints": [14 names, in the order of the truth] to dataset.json'
    )


SEVENTEEN = np.stack([STANDING + [3.0 * n, 0, 0] for n in range(20)])
NAME_THEM = "name the joints in the order of the truth, as gt_joints in dataset.json, and give metres"
H36M = [11, 12, 14, 16, 11, 13, 15, 5, 6, 0, 1, 5, 7, 9, 6, 8, 10]  # another order of seventeen joints


@pytest.mark.parametrize(
    ("joints", "got", "do_next"),
    [
        (1000 * SEVENTEEN, "as in millimetres", "write it in metres: divide by 1000"),
        (100 * SEVENTEEN, "as in centimetres", "write it in metres: divide by 100"),
        (SEVENTEEN / 1000, "from", NAME_THEM),
        (SEVENTEEN[:, H36M], "from right_shoulder to right_elbow", NAME_THEM),
    ],
)
def test_bodies_of_inhuman_size_are_no_truth(tmp_path, joints, got, do_next):
    with pytest.raises(DatasetError) as caught:
        open_dataset(write_frames(tmp_path, about={}, gt_joints=joints))
    assert caught.value.what == "limbs of the truth have no human length"
    assert got in caught.value.got
    assert caught.value.do_next == do_next


def test_bodies_of_inhuman_size_are_no_truth_of_a_sequence(tmp_path):
    with pytest.raises(DatasetError, match="limbs of the truth have no human length"):
        open_dataset(write_sequence(tmp_path, joints_m=1000 * np.stack([STANDING[None]] * 3)))


def test_a_child_and_a_truth_without_limbs_are_believed(tmp_path):
    found = open_dataset(write_frames(tmp_path, about={}, gt_joints=0.5 * SEVENTEEN))
    assert len(found.truth.frame) == 20
    faces = np.where(np.arange(17)[:, None] < 5, SEVENTEEN, np.nan)
    assert len(open_dataset(write_frames(tmp_path, about={}, gt_joints=faces)).truth.frame) == 20


def test_a_worker_is_in_a_frame_once(tmp_path):
    with pytest.raises(DatasetError) as caught:
        open_dataset(write_frames(tmp_path, gt_person=np.full(20, 3)))
    assert str(caught.value) == (
        f"the truth has a worker twice in one frame\n  where:    {tmp_path}/data.npz\n"
        "  expected: one row for each worker and frame\n  got:      worker 3 in frame 10 again in row 1\n"
        "  do next:  give every worker a number of its own in gt_person"
    )


def test_a_truth_in_another_frame_than_the_tracks_is_told():
    world_from_rig = Pose.from_quat_wxyz([0.8, 0.0, 0.6, 0.0], [1.0, 2.0, 3.0])
    place = standing_at(lambda _: 0.0)
    truth = Truth.of(np.stack([STANDING[None]] * 4))

    def told(truth, world_from_rig):
        return evaluate_people(instants([0, 1, 2, 3]), place, truth, world_from_rig=world_from_rig).warnings

    assert told(truth, None) == ()
    (text,) = told(truth, world_from_rig)
    assert text.startswith("the tracks are ")
    assert text.endswith("; it is in the rig frame: apply the rig file's world_from_rig to it")
    away = Truth.of(np.stack([STANDING[None] + [2.0, 0, 0]] * 4))
    assert told(away, None) == (
        "the tracks are 2 m from the truth (median), which must be in metres in the rig frame, as the rig file has no "
        "world",
    )
    assert told(away, Pose.identity()) == (
        "the tracks are 2 m from the truth (median), which must be in metres in the world of the rig file",
    )


def test_what_the_truth_knows_beyond_the_run_or_not_at_all_is_told():
    bodies = np.where(np.arange(17)[:, None] < 5, np.nan, STANDING)
    truth = Truth.of(np.stack([bodies[None]] * 6))
    found = evaluate_people(instants([0, 1, 2, 3]), standing_at(lambda _: 0.0), truth, world_from_rig=None)
    assert found.warnings == (
        "2 of the truth's 6 frames, 4 to 5, are not of this run, 0 to 3: whoever is there counts as missed",
        "the truth does not know these parts, and PCP3D is without them: head",
    )


def test_the_truth_is_known_by_its_form(tmp_path):
    joints = np.stack([STANDING] * 20)
    person = np.arange(20, dtype=np.int16)
    found = open_dataset(
        write_frames(tmp_path, about={}, gt_person=None, gt_joints=None, gt_actor=person, gt_xyz=joints)
    )
    assert np.array_equal(found.truth.joints_m, joints)
    assert np.array_equal(found.truth.person, person)


def test_the_documented_names_come_before_the_form(tmp_path):
    joints = np.stack([STANDING] * 20)
    found = open_dataset(write_frames(tmp_path, about={}, gt_joints=joints, gt_age=np.arange(20), gt_speed=joints + 1))
    assert np.array_equal(found.truth.joints_m, joints)
    assert set(found.truth.person.tolist()) == {1, 2}


@pytest.mark.parametrize(
    ("frames", "counted"),
    [
        ({"evaluation": [[12, 13], [18, 30]], "inclusive": True}, [12, 13, 18, 19]),
        ({"evaluation": [[12, 13], [18, 30]]}, [12, 13, 18, 19]),
        ({"evaluation": [[12, 14]], "inclusive": False}, [12, 13]),
        ({"first": 0}, list(range(10, 20))),
    ],
)
def test_only_frames_that_count_are_judged(tmp_path, frames, counted):
    found = open_dataset(write_frames(tmp_path, about={"gt_joints": LIMBS, "frames": frames}))
    assert sorted(set(found.truth.frame.tolist())) == counted


def test_pcp_is_averaged_over_the_actors_that_are_scored(tmp_path):
    found = open_dataset(write_frames(tmp_path, about={"gt_joints": LIMBS, "gt_actors_scored": [2]}))
    assert found.scored == (2,)
    place = standing_at(lambda _: 2.0)  # at the first worker, who does not count
    every = instants([round(n / 30 * 1e9) for n in range(30)])
    scores = evaluate_people(every, place, found.truth, world_from_rig=None, scored=found.scored).scores
    assert [person.pcp3d for person in scores.people] == [1.0, 0.0]
    assert scores.pcp3d == 0.0
    assert scores.recall == 0.5
    assert evaluate_people(every, place, found.truth, world_from_rig=None).scores.pcp3d == 0.5


def test_a_sequence_has_its_truth_in_rig_time(tmp_path):
    found = open_dataset(write_sequence(tmp_path))
    assert found.truth.t_ns.tolist() == [1_790_000_000_000_000_000 + t for t in (0, 500_000_000, 1_000_000_000)]
    assert (found.rig, found.detections, found.capture) == (tmp_path / "true.rig.json", None, tmp_path)
    other = open_dataset(tmp_path, rig=tmp_path / "my.rig.json", detections=tmp_path / "d.npz")
    assert (other.rig, other.detections) == (tmp_path / "my.rig.json", tmp_path / "d.npz")
    assert other.capture == tmp_path  # whose stamps say when the detections were


def remove(name):
    return lambda folder: (folder / name).unlink()


def rewrite(name, text):
    return lambda folder: (folder / name).write_text(text)


@pytest.mark.parametrize(
    ("arrays", "spoil", "what", "got"),
    [
        ({"gt_joints": None}, None, "this data set holds no 3D truth", "gt_frame (20,) int64, gt_person (20,) int64"),
        ({"gt_frame": None, "gt_person": None, "gt_joints": None}, None, "this data set holds no 3D truth",
         "no array gt_..."),
        ({"gt_person": None, "gt_actor": np.zeros(20, int), "gt_age": np.zeros(20, int)}, None,
         "this data set holds no 3D truth", "gt_actor (20,) int64"),
        ({"gt_person": np.zeros(3, int)}, None, "the arrays of the truth do not fit each other", "gt_person (3,)"),
        ({"gt_frame": np.zeros(20)}, None, "the arrays of the truth do not fit each other", "gt_frame (20,) float64"),
        ({"gt_joints": np.zeros((20, 3, 3))}, None, "gt_joints does not name the joints of the truth", "left_shoulder"),
        ({"gt_joints": np.full((20, 12, 3), np.nan)}, None, "the truth has no joint in a frame that counts", "none"),
        ({}, rewrite("dataset.json", "[]"), "this file has another form", "list"),
        ({}, rewrite("dataset.json", "{"), "cannot read this file", "line 1"),
        ({}, rewrite("data.npz", "PK"), "cannot read this file", "pickle"),
        ({}, remove("data.npz"), "this data set holds no 3D truth", "neither of the two files"),
    ],
)  # fmt: skip
def test_a_truth_that_cannot_be_used_says_what_is_wrong(tmp_path, arrays, spoil, what, got):
    write_frames(tmp_path, **arrays)
    if spoil:
        spoil(tmp_path)
    with pytest.raises(DatasetError) as caught:
        open_dataset(tmp_path)
    assert caught.value.what == what
    assert got in str(caught.value.got)


@pytest.mark.parametrize(
    ("about", "what"),
    [
        ({"frames": {"evaluation": "all"}}, "frames.evaluation has another form"),
        ({"frames": {"evaluation": [[50, 60]]}}, "the truth has no joint in a frame that counts"),
        ({"gt_actors_scored": [7]}, "gt_actors_scored names nobody of the truth"),
        ({"gt_actors_scored": 7}, "gt_actors_scored names nobody of the truth"),
    ],
)
def test_facts_that_do_not_suit_the_truth_are_refused(tmp_path, about, what):
    with pytest.raises(DatasetError) as caught:
        open_dataset(write_frames(tmp_path, about={"gt_joints": LIMBS, **about}))
    assert caught.value.what == what


@pytest.mark.parametrize(
    ("changed", "spoil", "what"),
    [
        ({"joints_m": None}, None, "this data set holds no 3D truth of workers"),
        ({"joints_m": np.zeros((3, 1, 15, 3))}, None, "the truth has another form"),
        ({"t_s": np.array([[0.0], [0.5], [0.4]])}, None, "the truth has another form"),
        ({"t_s": np.array([[0.0], [np.nan], [0.4]])}, None, "the truth has another form"),
        ({}, remove("truth.json"), "cannot read this file"),
        ({}, rewrite("truth.json", "{}"), "when the truth begins is not given"),
    ],
)
def test_a_sequence_whose_truth_cannot_be_used_says_what_is_wrong(tmp_path, changed, spoil, what):
    write_sequence(tmp_path, **changed)
    if spoil:
        spoil(tmp_path)
    with pytest.raises(DatasetError) as caught:
        open_dataset(tmp_path)
    assert caught.value.what == what


def test_a_data_set_without_a_rig_file_names_the_command_that_makes_one(tmp_path):
    write_frames(tmp_path)
    (tmp_path / "x.rig.json").unlink()
    with pytest.raises(DatasetError) as caught:
        open_dataset(tmp_path)
    assert str(caught.value) == (
        f"this data set has no rig file\n  where:    {tmp_path}\n"
        "  expected: one NAME.rig.json in the folder, or --rig\n  got:      none\n"
        f"  do next:  rigcal import {tmp_path}/dataset.json --from multiview-dataset -o NAME.rig.json, and then --rig "
        "NAME.rig.json"
    )


def test_of_several_rig_files_one_must_be_named(tmp_path):
    write_frames(tmp_path)
    (tmp_path / "y.rig.json").touch()
    with pytest.raises(DatasetError, match="which rig saw this data set is not clear"):
        open_dataset(tmp_path)
    assert open_dataset(tmp_path, rig=tmp_path / "y.rig.json").rig == tmp_path / "y.rig.json"


def test_a_folder_that_is_not_there_is_said(tmp_path):
    with pytest.raises(DatasetError) as caught:
        open_dataset(tmp_path / "nowhere")
    assert (caught.value.what, caught.value.got) == ("no such data set", "nothing")
