"""The loop: simulated workers come out with their identities and places, everything is recorded on the way."""

import time

import numpy as np
import pytest

from recognition.feeds import instants_of_detections
from recognition.observations import FrameSet, Instant, Scene, WorkerTrack
from recognition.placing import PlacingOptions
from recognition.poses import Poses, write_poses
from recognition.recording import Recorder, check_recording, iter_messages
from recognition.runtime import RunOptions, run
from recognition.sources.detections_file import read_detections, write_detections
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from rigcal.geometry import Pose
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

PAPER = PlacingOptions("paper")


@pytest.fixture
def site(tmp_path):
    """A rig as read from its file, and two workers of whom it sees everything."""
    path = tmp_path / "s.rig.json"
    made = document_of_rig(semicircle_rig(), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(made, path)
    rig = rig_of(read_rigfile(path))
    return path, rig, simulate(rig, workers=2, frames=20, seed=1)


def recorder_for(path, rig, output):
    return Recorder(output, rig=rig, rig_json=path.read_bytes(), metadata={})


def detections_file(tmp_path, simulated, **times):
    path = tmp_path / "d.npz"
    write_detections(path, [[v.detections for v in observe(simulated, f)] for f in range(20)], **times)
    return path


def test_simulated_workers_are_tracked_and_recorded(site, tmp_path):
    path, rig, simulated = site
    known = read_detections(detections_file(tmp_path, simulated, time_s=(simulated.t_ns * 1e-9).tolist()), rig)
    done = []
    with recorder_for(path, rig, tmp_path / "r.mcap") as recorder:
        instants = instants_of_detections(known, fps=30, use=[True] * 4)
        result = run(rig, instants, recorder, RunOptions(PAPER), progress=done.append)
    assert done == list(range(1, 21))
    assert list(result.worker_instants.values()) == [20, 20]
    truth = rig.world_from_rig.inverse().apply(simulated.joints_in_world_m)
    for scene in result.scenes:
        for worker in scene.workers:
            gaps = np.linalg.norm(truth[scene.index] - worker.joints_m, axis=-1)
            assert np.nanmedian(gaps, axis=1).min() < 1e-5
    assert {(scene.status, scene.cameras) for scene in result.scenes} == {("MONITORED", 4)}
    check = check_recording(tmp_path / "r.mcap")
    assert check.ok, check.findings
    assert check.messages["/scene"] == 20
    assert check.messages["/cam2/annotations"] == 20


def test_scenes_say_which_cameras_were_missing(site, tmp_path):
    path, rig, simulated = site
    known = read_detections(detections_file(tmp_path, simulated), rig)
    use = [True, False, True, True]
    for wanted, status in ((None, "DEGRADED"), (use, "MONITORED")):
        with recorder_for(path, rig, tmp_path / f"{status}.mcap") as recorder:
            options = RunOptions(PAPER, use=wanted)
            result = run(rig, instants_of_detections(known, fps=30, use=use), recorder, options)
        assert result.statuses == {status: 20}
    assert result.scenes[0].cameras == 3


def test_a_run_without_kept_scenes_counts_them_all_the_same(site, tmp_path):
    path, rig, simulated = site
    known = read_detections(detections_file(tmp_path, simulated), rig)
    with recorder_for(path, rig, tmp_path / "r.mcap") as recorder:
        options = RunOptions(PAPER, keep_scenes=False)
        result = run(rig, instants_of_detections(known, fps=30, use=[True] * 4), recorder, options)
    assert (result.scenes, result.placed) == ((), 20)
    assert list(result.worker_instants.values()) == [20, 20]


def test_annotations_bear_the_tracks_of_their_detections(site, tmp_path):
    path, rig, simulated = site
    known = read_detections(detections_file(tmp_path, simulated), rig)
    with recorder_for(path, rig, tmp_path / "r.mcap") as recorder:
        result = run(rig, instants_of_detections(known, fps=30, use=[True] * 4), recorder, RunOptions())
    for worker in result.scenes[-1].workers:
        assert (worker.members >= 0).sum() >= 2
    texts = [t.text for m in iter_messages(tmp_path / "r.mcap", ["/cam0/annotations"]) for t in m.message.texts]
    assert {"1", "2"} <= {word for text in texts for word in text.replace("/", " ").split()}


def test_frame_numbers_become_times_at_the_given_rate(site, tmp_path):
    _, rig, simulated = site
    known = read_detections(detections_file(tmp_path, simulated), rig)
    instants = list(instants_of_detections(known, fps=20, use=[True] * 4))
    assert [i.frame_set.t_ns for i in instants[:3]] == [0, 50_000_000, 100_000_000]


def test_cameras_that_are_left_out_see_nothing(site, tmp_path):
    _, rig, simulated = site
    known = read_detections(detections_file(tmp_path, simulated), rig)
    instant = next(instants_of_detections(known, fps=20, use=[True, False, True, True]))
    assert [len(view.people_px) for view in instant.views] == [2, 0, 2, 2]


def test_realtime_paces_the_instants(site, tmp_path):
    path, rig, simulated = site
    views = tuple(view.detections for view in observe(simulated, 0))
    instants = [Instant(FrameSet(i, i * 50_000_000, (None,) * 4), views) for i in range(7)]
    start = time.monotonic()
    with recorder_for(path, rig, tmp_path / "r.mcap") as recorder:
        run(rig, instants, recorder, RunOptions(realtime=True))
    assert time.monotonic() - start >= 0.3


def test_a_run_that_is_stopped_keeps_what_it_has(site, tmp_path):
    path, rig, simulated = site
    known = read_detections(detections_file(tmp_path, simulated), rig)
    asked = iter([False] * 5 + [True])
    with recorder_for(path, rig, tmp_path / "r.mcap") as recorder:
        instants = instants_of_detections(known, fps=30, use=[True] * 4)
        result = run(rig, instants, recorder, RunOptions(), stop=lambda: next(asked))
    assert result.stopped
    assert len(result.scenes) == 5
    assert check_recording(tmp_path / "r.mcap").messages["/scene"] == 5


def test_poses_are_in_the_world_where_the_rig_has_one(tmp_path):
    joints = np.full((17, 3), np.nan)
    joints[3] = [1.0, 2, 3]
    scenes = [Scene(7, 5, (WorkerTrack(4, joints, np.full(17, 2), np.zeros(2, int)),), ()), Scene(8, 6, (), ())]
    world_from_rig = Pose(np.eye(3), np.array([10.0, 0, 0]))
    write_poses(Poses.of(scenes, world_from_rig), tmp_path / "p.npz")
    with np.load(tmp_path / "p.npz") as data:
        assert {name: str(data[name].dtype) for name in data} == {
            "frame": "int32", "t_ns": "int64", "track_id": "int32", "joints_m": "float32", "views": "int16",
        }  # fmt: skip
        assert data["frame"].tolist() == [7]
        assert data["track_id"].tolist() == [4]
        assert data["joints_m"][0, 3].tolist() == [11, 2, 3]
        assert np.isnan(data["joints_m"][0, 4]).all()
    assert Poses.of(scenes, None).joints_m[0, 3].tolist() == [1, 2, 3]
    assert Poses.of([], None).joints_m.shape == (0, 17, 3)
    assert [p.name for p in tmp_path.iterdir()] == ["p.npz"]
