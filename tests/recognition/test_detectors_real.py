"""The three public networks on frames of the real four-camera capture, against OpenPose's joints."""

from __future__ import annotations

import itertools
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from recognition.detectors import load_detector, load_model

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
MODELS, CAPTURE = DATA / "models", DATA / "recognition" / "pose2sim_multi"
pytestmark = pytest.mark.skipif(not CAPTURE.is_dir() or not MODELS.is_dir(), reason="needs the public models and video")

MOVENET = MODELS / "movenet_lightning_int8.onnx"
BOX_MODELS = {name: MODELS / f"{name}.onnx" for name in ("yolox_nano", "FastestDet")}


def frames(view):
    with av.open(str(CAPTURE / f"cam0{view + 1}.mp4")) as video:
        for idx, frame in itertools.islice(enumerate(video.decode(video=0)), 0, 41, 20):
            yield idx, frame.to_ndarray(format="bgr24")


@pytest.fixture(scope="module")
def first_frame():
    return next(frames(0))[1]


def openpose_athlete(view, frame_idx):
    # The larger detection that is OpenPose's own: the second person's all score exactly 1, and lie beside the figure
    # that the video shows.
    data = np.load(CAPTURE / "data.npz")
    poses = data["det_kpts"][(data["det_view"] == view) & (data["det_frame"] == frame_idx)]
    own = [pose for pose in poses if (pose[pose[:, 2] > 0, 2] < 1).any()]
    return max(own, key=lambda pose: np.ptp(pose[pose[:, 2] > 0, :2], axis=0).prod())


@pytest.mark.parametrize(("name", "family"), [("yolox_nano", "yolox"), ("FastestDet", "fastestdet")])
def test_public_box_networks_need_no_manifest_beside_them(name, family):
    model = load_model(BOX_MODELS[name])
    assert (model.model_info[0].family, model.person_class) == (family, "person")


def test_the_public_pose_network_needs_no_manifest_beside_it():
    (info,) = load_model(MOVENET).model_info
    assert (info.family, info.licence) == ("movenet", "Apache-2.0")


@pytest.mark.parametrize("view", range(4))
def test_both_near_people_are_found_in_every_view(view):
    # Over all 100 frames yolox_nano gave both a box in every view, and MoveNet both poses in 100, 100, 68 and 98
    # frames; in view 2 the one hides the other, and both crops then show MoveNet the same person.
    detector = load_detector(BOX_MODELS["yolox_nano"], MOVENET)
    counts = [len(detector.detect(image).people_px) for _, image in frames(view)]
    assert min(counts) >= (1 if view == 2 else 2)
    assert max(counts) <= 3


@pytest.mark.parametrize(("name", "limit_px"), [("yolox_nano", 30), ("FastestDet", 35)])
def test_the_joints_of_the_athlete_agree_with_openpose(name, limit_px):
    # On a man of 800 px, median over all views: 18.7 px with yolox_nano (every frame) and FastestDet (every fourth).
    detector = load_detector(BOX_MODELS[name], MOVENET)
    distances = []
    for view in (0, 1):
        for frame_idx, image in frames(view):
            truth, found = openpose_athlete(view, frame_idx), detector.detect(image)
            each = np.linalg.norm(found.people_px - truth[:, :2], axis=-1)
            each[:, truth[:, 2] < 0.3] = np.nan
            distances.append(each[np.nanmedian(each, axis=1).argmin()])
    assert np.nanmedian(distances) < limit_px


@pytest.mark.parametrize("name", BOX_MODELS)
def test_the_same_image_gives_the_same_bytes(name, first_frame):
    first, second = (load_detector(BOX_MODELS[name], MOVENET).detect(first_frame) for _ in range(2))
    assert first.people_px.tobytes() == second.people_px.tobytes()
    assert first.object_xyxy.tobytes() == second.object_xyxy.tobytes()


def test_a_person_cut_by_the_border_keeps_the_joints_that_are_left(first_frame):
    # The image is cut 45 px below the top of the man's box; the crop is padded there, so that it stays as it was.
    pose, box = load_model(MOVENET), np.array([[270.0, 355.0, 577.0, 1152.0]])
    whole = pose.poses(first_frame, box)[0]
    below = pose.poses(np.ascontiguousarray(first_frame[400:]), box - [0, 400, 0, 400])[0] + [0, 400, 0]
    # Measured: 6 px at the hips, less than 1 px at knees and ankles.
    assert np.linalg.norm(whole[11:, :2] - below[11:, :2], axis=1).max() < 12


def test_shrinking_the_image_shrinks_the_boxes_with_it(first_frame):
    model = load_model(BOX_MODELS["yolox_nano"])
    half = cv2.resize(first_frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    large, small = model.boxes(first_frame), model.boxes(half)
    assert small.classes[:2] == large.classes[:2] == ("person", "person")
    assert (small.xyxy[:2] + 0.5) * 2 - 0.5 == pytest.approx(large.xyxy[:2], abs=4)  # 1.6 px, measured
