"""Sequences become pictures with truth and joints in the world; figures and bars by hand."""

from dataclasses import replace

import av
import numpy as np
import pytest

from recognition.observations import JOINTS, ViewDetections
from recognition.placing import PlacingOptions
from recognition.poses import Poses
from recognition.runtime import RunOptions
from recognition.synthetic import semicircle_rig
from rigcal.camera import Camera
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile
from tools.sicsg.catalog import CATEGORIES
from tools.train.coco import DataError
from tools.train.joints3d import Distances, distances, errors_of, joint_facts, run_pipeline
from tools.train.measure import bars
from tools.train.sequences import SITE_CATEGORIES, EvaluationSequence, find_sequences, read_sequence, truth_of

EPOCH_S = 1_790_000_000.0
SIZE_WH = (640, 360)
CENTRE = (319.5, 179.5)


def sequence(folder, *, frames=2, workers=1, **arrays):
    """One camera that looks along z from the origin, workers 4 m away and a ladder 5 m away."""
    params = np.array([500.0, 500.0, *CENTRE, 0.0, 0.0, 0.0, 0.0, 0.0])
    camera = RigCamera(id="cam0", camera=Camera("opencv5", SIZE_WH, params), cam_from_rig=Pose.identity())
    shift = Pose.from_quat_wxyz((1.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    rig = Rig("site", (camera,), "cam0", "IMPORTED", shift)
    corners = np.array([[-0.2, 1.0, 5.0], [0.2, 1.0, 5.0], [-0.2, -1.0, 5.0], [0.2, -4.0, 5.0]])
    facts = {
        "epoch_s": EPOCH_S, "cameras": ["cam0"], "light": "dusk", "instants_s": [0.1 + 0.2 * n for n in range(frames)],
        "objects": [{"id": "thing0", "class": "ladder"}],
    }  # fmt: skip
    known = {
        "joints_m": np.zeros((frames, workers, 17, 3)),
        "joints_px": np.full((frames, 1, workers, 17, 2), 100.0),
        "joints_seen": np.full((frames, 1, workers, 17), 3),
        "worker_xyxy": np.tile([99.5, 49.5, 139.5, 149.5], (frames, 1, workers, 1)),
        "worker_pixels": np.full((frames, 1, workers), 2000),
        "object_keypoints_m": np.tile(corners + [1.0, 2.0, 3.0], (frames, 1, 1, 1)),
        "object_xyxy": np.tile([299.5, 79.5, 339.5, 279.5], (frames, 1, 1, 1)),
        "object_pixels": np.full((frames, 1, 1), 900),
        "worker_full_pixels": np.full((frames, 1, workers), 4000),
        "object_full_pixels": np.full((frames, 1, 1), 1000),
    } | arrays
    return EvaluationSequence(folder, rig, facts, known)


def test_a_frame_has_the_people_then_the_objects_in_edge_coordinates(tmp_path):
    seen = np.full((2, 1, 1, 17), 3)
    seen[..., 0], seen[..., 1], seen[..., 2] = 0, 1, 2
    truth = truth_of(sequence(tmp_path, joints_seen=seen), 1, 0, SIZE_WH)
    assert truth.classes.tolist() == [0, 1 + [entry.name for entry in CATEGORIES].index("ladder")]
    assert truth.boxes.tolist() == [[100, 50, 140, 150], [300, 80, 340, 280]]
    assert truth.points[0, :4].tolist() == [[0, 0, 0], [100.5, 100.5, 1], [100.5, 100.5, 1], [100.5, 100.5, 2]]
    assert not truth.ignore.any()


def test_keypoints_of_objects_are_projected_in_the_order_that_the_picture_has(tmp_path):
    truth = truth_of(sequence(tmp_path), 0, 0, SIZE_WH)
    # x = 319.5 -+ 500 * .2 / 5, y = 179.5 +- 500 * 1 / 5, and one above the picture; edges are half a pixel more
    assert truth.points[1, :4] == pytest.approx(np.array([[300, 280, 1], [340, 280, 1], [300, 80, 1], [0, 0, 0]]))


@pytest.mark.parametrize(
    ("change", "ignored"),
    [
        ({"worker_pixels": np.full((2, 1, 1), 599)}, [True, False]),  # of 4000: less than 15 %
        ({"worker_pixels": np.full((2, 1, 1), 600)}, [False, False]),
        ({"worker_xyxy": np.tile([99.5, 49.5, 139.5, 59.4], (2, 1, 1, 1))}, [True, False]),  # 20/720 of 360 is 10
        ({"object_xyxy": np.tile([99.5, 49.5, 101.9, 149.5], (2, 1, 1, 1))}, [False, True]),  # 5/720 of 360 is 2.5
        ({"object_pixels": np.full((2, 1, 1), 149)}, [False, True]),
    ],
)
def test_what_is_too_small_or_too_hidden_is_not_asked_for(tmp_path, change, ignored):
    assert truth_of(sequence(tmp_path, **change), 0, 0, SIZE_WH).ignore.tolist() == ignored


def test_what_a_view_does_not_show_is_not_there(tmp_path):
    truth = truth_of(sequence(tmp_path, worker_xyxy=np.full((2, 1, 1, 4), np.nan)), 0, 0, SIZE_WH)
    assert len(truth.classes) == 1


def test_a_folder_without_sequences_and_another_form_are_refused(tmp_path):
    with pytest.raises(DataError, match="there is no sequence"):
        find_sequences(tmp_path)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "truth.json").write_text('{"format": "sicsg.sequence", "version": 2}')
    assert find_sequences(tmp_path) == (tmp_path / "a",)
    with pytest.raises(DataError, match="another form"):
        read_sequence(tmp_path / "a")


def test_the_renderer_is_the_end_of_the_name(tmp_path):
    one = sequence(tmp_path / "07-hat-ladder-dusk-cycles")
    assert (one.renderer, one.light, one.fps) == ("cycles", "dusk", pytest.approx(5.0))


def test_each_true_worker_has_the_nearest_that_was_found():
    true = np.zeros((2, 17, 3))
    true[1, :, 0] = 1.0
    found = np.stack([true[1] + [0.0, 0.03, 0.04], true[0] + [0.0, 0.0, 0.1], true[0] + [0.0, 3.0, 0.0]])
    found[0, 3] = np.nan
    errors = errors_of(true, found)
    assert errors[0] == pytest.approx(np.full(17, 0.1))
    assert np.isnan(errors[1, 3])
    assert np.delete(errors[1], 3) == pytest.approx(np.full(16, 0.05))
    assert np.isnan(errors_of(true, true[:1] + [0.0, 0.6, 0.0])).all()
    assert np.isnan(errors_of(true, np.zeros((0, 17, 3)))).all()


def test_what_was_found_is_compared_at_its_instant(tmp_path):
    seen = np.full((2, 2, 1, 17), 3)  # a second view, so that joints are asked for
    seen[1, 1, 0, 0] = 2
    true = np.zeros((2, 1, 17, 3))
    true[1, ..., 0] = 0.2
    one = sequence(tmp_path, joints_seen=seen, joints_m=true)
    t_ns = (EPOCH_S + np.array([0.1004, 0.2996, 0.2996, 0.9])) * 1e9
    found = np.stack([true[0, 0] + 0.01, true[1, 0], true[1, 0] + 5.0, true[1, 0]])
    poses = Poses(np.arange(4), t_ns.astype(np.int64), np.zeros(4), found, np.full((4, 17), 2))
    result = distances(one, poses)
    assert result.error_m[:, 0] == pytest.approx([0.01 * np.sqrt(3), 0.0])
    assert result.asked.tolist() == [[True] * 17, [False] + [True] * 16]
    assert (result.false_workers, result.instants) == (1, 2)


def test_figures_of_joints_by_hand():
    error = np.full((2, 17), np.nan)
    error[0] = 0.02
    error[0, 0] = 0.2
    asked = np.ones((2, 17), bool)
    facts = joint_facts([Distances(error, asked, 3, 2)])
    assert facts["worker_recall"] == 0.5
    assert facts["false_workers_per_instant"] == 1.5
    assert facts["median_mm"] == pytest.approx(20.0)
    assert (facts["recall"], facts["recall_near"]) == pytest.approx((17 / 34, 16 / 34))
    assert facts["by_joint"][JOINTS[0]]["median_mm"] == pytest.approx(200.0)
    assert joint_facts([]) == {"workers": 0}


def figures(ap50, *, lights=()):
    """Figures where all that is counted is the same."""
    row = {"asked": 5, "ap50": ap50, "ap": ap50 - 0.3, "ap50 8-12": ap50 - 0.2, "ap50 >=12": ap50}
    group = {"classes": {category.name: row for category in SITE_CATEGORIES}, "oks_ap50": ap50}
    world = {"all": {"median_mm": 50.0, "p90_mm": 160.0}}
    return {"pictures": {"all": group, **{f"light {name}": group for name in lights}}, "world": world}


def test_bars_are_met_or_not():
    found = {bar.what: bar for bar in bars(figures(0.86, lights=("indoor", "overexposed")), figures(0.9))}
    assert found["AP50 of person"].met
    assert found["AP50 of hard_hat, 8 to 12 px wide"].met
    assert "AP50 of hard_hat" not in found
    assert [found[f"AP50 of {name}"].bound for name in ("ladder", "bucket")] == [0.85, 0.60]
    assert found["joints from four views, median in mm"].met
    assert not found["joints from four views, 90 % in mm"].met
    assert found["fp32 less int8, mean AP50"].value == pytest.approx(0.04)
    assert not found["fp32 less int8, mean AP50"].met
    assert found["fp32 less int8, mean AP"].value == pytest.approx(0.04)
    assert found["indoor less over-exposed, mean AP50"].met


def test_what_has_no_figure_does_not_meet_its_bar():
    found = {bar.what: bar.met for bar in bars(figures(float("nan")), figures(0.9))}
    assert not found["AP50 of person"]
    assert not found["fp32 less int8, mean AP50"]
    assert "indoor less over-exposed, mean AP50" not in found


class Seer:
    """Sees a worker where the joints are; the grey of an image tells the camera."""

    model_info = ()

    def __init__(self, rig, joints_m):
        world = rig.world_from_rig.inverse().apply(joints_m)
        self.px = [camera.camera.project(camera.cam_from_rig.apply(world)) for camera in rig.cameras]

    def detect(self, image_bgr):
        own = self.px[round(float(image_bgr.mean()) / 50) - 1][None]
        return ViewDetections(own, np.full((1, 17), 0.9), (), np.zeros((0, 4)), np.zeros(0))


def test_the_pipeline_on_videos_brings_what_was_seen_back_into_the_world(tmp_path):
    rig = semicircle_rig(3, size_wh=(320, 180))
    stamps = EPOCH_S + 0.1 + 0.2 * np.arange(6)
    rows = []
    for number, camera in enumerate(rig.cameras):
        with av.open(str(tmp_path / f"{camera.id}.mp4"), "w") as file:
            stream = file.add_stream("libx264", rate=5, options={"bf": "0"})
            stream.width, stream.height, stream.pix_fmt = 320, 180, "yuv420p"
            for _ in stamps:
                grey = np.full((180, 320, 3), 50 * (number + 1), np.uint8)
                file.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="bgr24")))
            file.mux(stream.encode())
        rows += [f"{camera.id},{stamp:.9f}" for stamp in stamps]
    (tmp_path / "timestamps.csv").write_text("\n".join(["cam_id,frame_time", *rows]) + "\n")
    document = document_of_rig(rig, created_utc="2026-09-21T14:13:20Z", inputs_sha256="0" * 64)
    write_rigfile(document, tmp_path / "true.rig.json")
    rig = rig_of(read_rigfile(tmp_path / "true.rig.json"))
    joints_m = np.random.default_rng(3).uniform((-0.3, -0.3, 0.2), (0.3, 0.3, 1.8), (17, 3))
    one = replace(sequence(tmp_path, frames=6, joints_m=np.tile(joints_m, (6, 1, 1, 1))), rig=rig)
    seen = np.full((6, 3, 1, 17), 3)
    one.arrays["joints_seen"] = seen
    exact = RunOptions(PlacingOptions(method="paper"))  # believes what it sees, and no lengths of limbs
    result = distances(one, run_pipeline(one, Seer(rig, joints_m), exact))
    found = np.isfinite(result.error_m)
    assert found[-1].all()  # the tracker waits before it believes in somebody
    assert result.error_m[found].max() < 1e-6
    assert result.false_workers == 0
