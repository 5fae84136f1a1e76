"""The bundled detector on tiny networks of the bundled layout whose answers are known, from files to the command."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from tiny_onnx import FLOAT, UINT8, model, node, tiny_network, write

from recognition import detectors
from recognition.cli import app
from recognition.detectors import OneStagePeople, PeopleAndObjects, load_bundled, load_detector
from recognition.detectors.bundled.geometry import crop_placing, crop_xyxy
from recognition.errors import ModelError
from recognition.observations import JOINTS
from recognition.recording import check_recording, iter_messages, read_metadata
from recognition.synthetic import semicircle_rig
from rigcal.errors import OptionError
from rigcal.rigfile import document_of_rig, write_rigfile

NOTICE = "not validated on real people"
HEAD = f"""
licence = "MIT"
sha256 = "{{sha256}}"
notice = "{NOTICE}"
"""
TRAINED = """
[trained]
command = "make networks"
data = "SICSG, 4000 images"
date = "2026-11-22"
"""
CLASSES = ("person", "hard_hat", "ladder", "bucket")
SITE = f"""
family = "rigcal_site"
{HEAD}
classes = {json.dumps(CLASSES)}
keypoints = {{hard_hat = 1, ladder = 3}}
score_thresholds = {{person = 0.4, hard_hat = 0.3, ladder = 0.5, bucket = 0.6}}
joint_score = 0.5
min_joints = 4
{TRAINED}
"""
WORKER = f"""
family = "rigcal_worker"
{HEAD}
joints = {json.dumps(JOINTS)}
joint_score = 0.3
hat_score = 0.4
{TRAINED}
"""
IMAGE = np.zeros((1080, 1920, 3), np.uint8)
TIMES = 1920 / 512
"""Image pixels per pixel of the site network's input."""
PERSON_EDGES = np.array([228.0, 44.0, 260.0, 124.0])
"""The person's box in the site network's input."""
PERSON_PX = PERSON_EDGES * TIMES - 0.5
COARSE = np.column_stack([np.linspace(230, 258, 17), np.linspace(50, 120, 17)])
"""The person's joints in the site network's input."""


def place(scores, places, name, score, edges, keypoints=(), *, joints=None, visible=0.0):
    """Let the cell of stride 8 in the middle of a box say what is there; all in pixels of the input."""
    low, high = np.reshape(edges, (2, 2))
    column, row = np.floor((low + high) / 16).astype(int)
    cell, centre = row * 64 + column, np.array([column, row]) * 8 + 4.0
    scores[cell, CLASSES.index(name)] = score
    places[cell, :4] = np.log(np.concatenate([centre - low, high - centre]) / 8)
    if joints is not None:
        places[cell, 4:38] = ((joints - centre) / 8).ravel()
        places[cell, 38:55] = visible
    points = (np.asarray(keypoints, dtype=float).reshape(-1, 2) - centre) / 8
    places[cell, 55 : 55 + points.size] = points.ravel()


def site_network(things=(), *, person=0.9, visible=3.0):
    """Finds the person, and things: (class, score, edges, keypoints)."""
    scores, places = np.zeros((3024, len(CLASSES))), np.zeros((3024, 63))
    place(scores, places, "person", person, PERSON_EDGES, joints=COARSE, visible=visible)
    for thing in things:
        place(scores, places, *thing)
    outputs = {"scores": scores[None], "places": places[None]}
    return tiny_network(outputs, name="image", element_type=UINT8, shape=(1, 288, 512, 3))


def worker_network(*, joints=17, sure=0.9, hats=(), batch="n"):
    """Every joint is the brightest spot of the crop, a white one scoring ``sure`` times its brightness / 255.

    ``hats`` are (row, column, score, left, top, right, bottom) in every crop.
    """
    hat = np.zeros((1, 5, 32, 24))
    for row, column, *values in hats:
        hat[0, :, row, column] = values
    constants = {
        "share": np.full((1, joints, 1, 1), 1 / 255 / 9),
        "hat": hat,
        "sure": np.full((1, joints, 2), sure),
        "zero": np.zeros((1, 1, 1)),
        "zero4": np.zeros((1, 1, 1, 1)),
    }
    nodes = [
        node("Cast", ["image"], "float", to=FLOAT),
        node("Transpose", ["float"], "planes", perm=[0, 3, 1, 2]),
        node("AveragePool", ["planes"], "pooled", kernel_shape=[4, 4], strides=[4, 4]),
        node("ReduceMax", ["pooled"], "grey", axes=[1], keepdims=1),
        node("Mul", ["grey", "share"], "heat"),
        node("ReduceMax", ["float"], "rows", axes=[3], keepdims=0),
        node("ReduceMax", ["rows"], "one", axes=[1, 2], keepdims=1),
        node("Mul", ["one", "zero"], "nothing"),
        node("Add", ["nothing", "sure"], "states"),
        node("ReduceMax", ["float"], "one4", axes=[1, 2, 3], keepdims=1),
        node("Mul", ["one4", "zero4"], "nothing4"),
        node("Add", ["nothing4", "hat"], "hats"),
    ]
    shapes = {"heat": (batch, joints, 32, 24), "states": (batch, joints, 2), "hats": (batch, 5, 32, 24)}
    return model(nodes, constants, shapes, name="image", element_type=UINT8, shape=(batch, 128, 96, 3))


def bundle(folder, site=None, worker=None, *, site_text=SITE, worker_text=WORKER):
    """The four files of int8, written where ``load_bundled`` looks for them."""
    write(folder, site or site_network(), site_text, "site_int8")
    write(folder, worker or worker_network(), worker_text, "worker_int8")
    return load_bundled(folder=folder)


def with_spot(image, xy, sigma_px):
    """The image with a white Gaussian spot."""
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    spot = 255 * np.exp(-((columns - xy[0]) ** 2 + (rows - xy[1]) ** 2) / (2 * sigma_px**2))
    return np.maximum(image, np.rint(spot[..., None]).astype(np.uint8))


def refusal(call, *args, **kwargs):
    with pytest.raises(ModelError) as caught:
        call(*args, **kwargs)
    return str(caught.value)


# --- people ---------------------------------------------------------------------------------------------------------


def test_joints_that_no_crop_shows_are_those_of_the_whole_image(tmp_path):
    found = bundle(tmp_path).detect(IMAGE)
    assert found.people_px[0] == pytest.approx(COARSE * TIMES - 0.5, abs=1e-3)
    assert found.people_score == pytest.approx(np.full((1, 17), 1 / (1 + np.exp(-3.0))))


@pytest.mark.parametrize("size_wh", [(1920, 1080), (1088, 1920)])
def test_a_joint_that_the_crop_shows_is_where_the_image_has_it(tmp_path, size_wh):
    detector = bundle(tmp_path)
    scale = min(512 / size_wh[0], 288 / size_wh[1])
    person = (PERSON_EDGES.reshape(2, 2) - (np.array([512, 288]) - np.rint(np.array(size_wh) * scale)) // 2) / scale
    spot = person.mean(axis=0) + (11.3, -40.8)
    sigma = 6 / crop_placing(crop_xyxy(person.reshape(1, 4))[0]).scale
    found = detector.detect(with_spot(np.zeros((*size_wh[::-1], 3), np.uint8), spot, sigma))
    assert found.people_px == pytest.approx(np.tile(spot, (1, 17, 1)), abs=0.2)
    assert found.people_score == pytest.approx(np.tile(found.people_score[0, :1], (1, 17)))
    assert 0.3 <= found.people_score[0, 0] <= 0.9


def test_a_worker_network_of_fewer_joints_leaves_the_others_to_the_site_network(tmp_path):
    known = ("right_wrist", "nose")
    text = WORKER.replace(json.dumps(JOINTS), json.dumps(known))
    detector = bundle(tmp_path, worker=worker_network(joints=2), worker_text=text)
    spot = PERSON_PX.reshape(2, 2).mean(axis=0)
    found = detector.detect(with_spot(IMAGE, spot, 20))
    fine = [JOINTS.index(name) for name in known]
    coarse = [idx for idx in range(17) if idx not in fine]
    assert found.people_px[0, fine] == pytest.approx(np.tile(spot, (2, 1)), abs=0.3)
    assert found.people_px[0, coarse] == pytest.approx((COARSE * TIMES - 0.5)[coarse], abs=1e-3)


def test_a_joint_that_neither_network_is_sure_of_is_not_detected(tmp_path):
    hidden = np.full(17, 3.0)
    hidden[5] = -1.0
    found = bundle(tmp_path, site_network(visible=hidden)).detect(IMAGE)
    assert np.isnan(found.people_px[0, 5]).all()
    assert found.people_score[0, 5] == 0
    assert np.isfinite(np.delete(found.people_px[0], 5, axis=0)).all()


def test_somebody_with_too_few_joints_is_nobody(tmp_path):
    visible = np.full(17, -3.0)
    visible[:3] = 3.0
    assert len(bundle(tmp_path, site_network(visible=visible)).detect(IMAGE).people_px) == 0


def test_where_there_is_nobody_the_worker_network_does_not_run(tmp_path):
    found = bundle(tmp_path, site_network(person=0.39), worker_network(hats=[(0, 0, 0.9, 2, 2, 9, 9)])).detect(IMAGE)
    assert len(found.people_px) == 0
    assert found.object_class == ()


# --- objects --------------------------------------------------------------------------------------------------------

LADDER = ("ladder", 0.7, (340, 20, 390, 100), [(350, 30), (380, 30), (500, -20), (345, 95)])


def test_objects_have_their_keypoints_and_no_others(tmp_path):
    bucket = ("bucket", 0.8, (2, 30, 20, 60), [(9, 50)])
    found = bundle(tmp_path, site_network([LADDER, bucket])).detect(IMAGE)
    assert found.object_class == ("bucket", "ladder")
    assert found.object_score == pytest.approx([0.8, 0.7])
    edges = np.array([(2, 30, 20, 60), (340, 20, 390, 100)])
    assert found.object_xyxy == pytest.approx(edges * TIMES - 0.5, abs=1e-3)
    expected = np.full((2, 4, 2), np.nan)
    expected[1, :2] = np.array([(350, 30), (380, 30)]) * TIMES - 0.5  # the third is outside, a fourth there is not
    assert found.object_keypoints_px == pytest.approx(expected, abs=1e-3, nan_ok=True)


@pytest.mark.parametrize(("share", "count"), [(0.7, 1), (0.8, 2)])
def test_hats_that_share_a_seventh_of_their_union_are_one(tmp_path, share, count):
    """One beside the other, ``share`` of its width farther: 0.3 to 1.7 and 0.2 to 1.8 of it are shared."""
    aside = hat_px() + np.array([share, 0, share, 0]) * (hat_px()[2] - hat_px()[0])
    detector = bundle(tmp_path, site_network([site_hat(0.95, aside)]), worker_network(hats=[HAT_IN_CROP]))
    assert detector.detect(IMAGE).object_class == ("hard_hat",) * count


@pytest.mark.parametrize(("score", "count"), [(0.49, 0), (0.51, 1)])
def test_each_class_has_the_threshold_of_the_manifest(tmp_path, score, count):
    found = bundle(tmp_path, site_network([("ladder", score, *LADDER[2:])])).detect(IMAGE)
    assert len(found.object_class) == count


HINTS = SITE.replace("min_joints", "hint_score = 0.2\nmin_joints")


@pytest.mark.parametrize(("score", "people", "hints"), [(0.41, 1, []), (0.39, 1, [0]), (0.21, 1, [0]), (0.19, 0, [])])
def test_somebody_who_scores_too_little_is_a_hint(tmp_path, score, people, hints):
    detector = bundle(tmp_path, site_network(person=score), site_text=HINTS)
    found = detector.detect(IMAGE)
    assert (len(found.people_px), found.hints.tolist()) == (people, hints)
    assert len(detector.people(IMAGE).joints) == people - len(hints)
    assert detector.boxes(IMAGE).classes == ("person",) * (people - len(hints))


def test_without_a_score_for_hints_there_are_none(tmp_path):
    assert len(bundle(tmp_path, site_network(person=0.39)).detect(IMAGE).people_px) == 0


def test_boxes_are_cut_to_the_image(tmp_path):
    found = bundle(tmp_path, site_network([("ladder", 0.7, (340, -30, 600, 100))])).detect(IMAGE)
    assert found.object_xyxy == pytest.approx(np.array([[340 * TIMES - 0.5, -0.5, 1919.5, 100 * TIMES - 0.5]]))


HAT_IN_CROP = (3, 11, 0.6, 38.0, 4.0, 58.0, 20.0)


def hat_px(hat=HAT_IN_CROP):
    placing = crop_placing(crop_xyxy((PERSON_PX + 0.5)[None])[0])
    return placing.to_image(np.reshape(hat[3:], (2, 2))).ravel() - 0.5


def site_hat(score, edges_px):
    return ("hard_hat", score, (np.asarray(edges_px) + 0.5) / TIMES)


def test_a_hat_of_a_crop_goes_before_the_same_of_the_whole_image(tmp_path):
    detector = bundle(tmp_path, site_network([site_hat(0.95, hat_px() + 3)]), worker_network(hats=[HAT_IN_CROP]))
    found = detector.detect(IMAGE)
    assert found.object_class == ("hard_hat",)
    assert found.object_score == pytest.approx([0.6])
    assert found.object_xyxy[0] == pytest.approx(hat_px(), abs=1e-3)
    assert found.object_keypoints_px[0, 0] == pytest.approx(hat_px().reshape(2, 2).mean(axis=0), abs=1e-3)
    assert np.isnan(found.object_keypoints_px[0, 1:]).all()


@pytest.mark.parametrize(("score", "count"), [(0.39, 0), (0.41, 1)])
def test_a_hat_that_a_crop_shows_and_only_the_whole_image_has_needs_the_score_of_crops(tmp_path, score, count):
    found = bundle(tmp_path, site_network([site_hat(score, hat_px())])).detect(IMAGE)
    assert len(found.object_class) == count


def test_a_hat_that_no_crop_shows_needs_the_score_of_whole_images(tmp_path):
    far = hat_px() + [400, 0, 400, 0]
    found = bundle(tmp_path, site_network([site_hat(0.31, far)])).detect(IMAGE)
    assert found.object_xyxy == pytest.approx(far[None], abs=1e-3)


def test_a_hat_that_no_crop_shows_stays(tmp_path):
    far = hat_px() + [400, 0, 400, 0]
    detector = bundle(tmp_path, site_network([site_hat(0.5, far)]), worker_network(hats=[HAT_IN_CROP]))
    found = detector.detect(IMAGE)
    assert found.object_class == ("hard_hat", "hard_hat")
    assert found.object_xyxy == pytest.approx(np.stack([hat_px(), far]), abs=1e-3)


def test_hats_below_the_threshold_are_dropped(tmp_path):
    worker = worker_network(hats=[(3, 11, 0.39, *HAT_IN_CROP[3:])])
    assert bundle(tmp_path, worker=worker).detect(IMAGE).object_class == ()


# --- beside other networks ------------------------------------------------------------------------------------------


def box_network(folder):
    output = np.zeros((1, 6, 21))
    output[0, :, 4], output[0, :, 9] = [16, 16, 32, 16, 0.9, 0], [8, 8, 16, 16, 0, 0.7]
    text = (
        'family = "yolov8"\nlicence = "MIT"\nsha256 = "{sha256}"\nclasses = ["person", "cat"]\n'
        'person_class = "person"\nscore_threshold = 0.5\n[input]\nname = "images"\n'
        'size_wh = [32, 32]\nlayout = "nchw"\ndtype = "float32"\n'
        'colour = "rgb"\nresize = "stretch"\n'
    )
    return write(folder, tiny_network(output), text, "boxes")


def pose_network(folder):
    """Every joint a quarter down and half across the box, with score 0.75."""
    text = (
        'family = "movenet"\nlicence = "MIT"\nsha256 = "{sha256}"\njoints = "coco17"\ncrop_margin = 1.0\n[input]\n'
        'name = "images"\nsize_wh = [32, 32]\nlayout = "nhwc"\ndtype = "uint8"\ncolour = "rgb"\nresize = "stretch"\n'
    )
    output = np.tile([0.25, 0.5, 0.75], (1, 1, 17, 1))
    return write(folder, tiny_network(output, element_type=UINT8, shape=(1, 32, 32, 3)), text, "poses")


def test_a_pose_model_replaces_the_people_and_keeps_the_objects(tmp_path):
    rest = bundle(tmp_path, site_network([LADDER]), worker_network(hats=[HAT_IN_CROP]))
    detector = load_detector(None, pose_network(tmp_path), rest=rest)
    found = detector.detect(IMAGE)
    assert isinstance(detector, PeopleAndObjects)
    left, top, right, bottom = PERSON_PX
    assert found.people_px == pytest.approx(
        np.tile([(left + right) / 2, 0.75 * top + 0.25 * bottom], (1, 17, 1)), abs=1
    )
    assert found.people_score == pytest.approx(np.full((1, 17), 0.75))
    assert found.object_class == ("ladder", "hard_hat")
    assert [info.family for info in detector.model_info] == ["rigcal_site", "rigcal_worker", "movenet"]


def test_an_object_model_replaces_the_objects_and_keeps_the_people(tmp_path):
    rest = bundle(tmp_path, site_network([LADDER]), worker_network(hats=[HAT_IN_CROP]))
    detector = load_detector(box_network(tmp_path), rest=rest)
    found = detector.detect(IMAGE)
    assert isinstance(detector, OneStagePeople)
    assert found.people_px[0] == pytest.approx(COARSE * TIMES - 0.5, abs=1e-3)
    assert found.object_class == ("cat",)
    assert [info.family for info in detector.model_info] == ["yolov8", "rigcal_site", "rigcal_worker"]


def test_with_both_models_nothing_is_left_for_the_bundled_networks(tmp_path):
    detector = load_detector(box_network(tmp_path), pose_network(tmp_path), rest=bundle(tmp_path))
    assert [info.family for info in detector.model_info] == ["yolov8", "movenet"]


# --- files ----------------------------------------------------------------------------------------------------------


def test_networks_say_which_they_are_and_what_to_know_of_them(tmp_path):
    site, worker = bundle(tmp_path).model_info
    assert (site.name, site.family, site.licence, site.notice) == ("site_int8.onnx", "rigcal_site", "MIT", NOTICE)
    assert (worker.name, worker.family, worker.notice) == ("worker_int8.onnx", "rigcal_worker", NOTICE)


def test_each_precision_has_its_files(tmp_path):
    bundle(tmp_path)
    message = refusal(load_bundled, "fp32", folder=tmp_path)
    assert message == (
        "cannot read a network that should come with the package\n"
        f"  where:    {tmp_path / 'site.onnx'}\n"
        "  expected: an ONNX file\n"
        "  got:      No such file or directory\n"
        "  do next:  install the package again with its model files, or give networks of your own: --object-model FILE "
        "and --pose-model FILE"
    )


def test_another_file_than_the_manifest_states_is_refused(tmp_path):
    bundle(tmp_path)
    (tmp_path / "worker_int8.onnx").write_bytes(worker_network(sure=0.5))
    message = refusal(load_bundled, folder=tmp_path)
    assert message.startswith("the manifest describes another network than the one beside it\n")
    assert message.endswith("do next:  install the package again with its model files")


def test_a_site_network_of_other_classes_is_refused(tmp_path):
    text = SITE.replace('"ladder", "bucket"]', '"ladder"]').replace(", bucket = 0.6", "")
    assert refusal(bundle, tmp_path, site_text=text) == (
        "the network's outputs are not those of its family\n"
        f"  where:    {tmp_path / 'site_int8.onnx'}\n"
        "  expected: 'scores' 1x3024x3, 'places' 1x3024x63\n"
        "  got:      'scores' 1x3024x4, 'places' 1x3024x63\n"
        "  do next:  check classes and joints of the manifest, or export the network again with tools/train"
    )


def test_a_worker_network_of_a_fixed_number_of_crops_is_refused(tmp_path):
    message = refusal(bundle, tmp_path, worker=worker_network(batch=1))
    assert message.startswith("the network's input is not what its manifest states\n")
    assert "'image' 2x128x96x3 tensor(uint8)" in message


def test_a_manifest_of_another_family_is_refused(tmp_path):
    message = refusal(bundle, tmp_path, site_text=WORKER)
    assert "expected: family = one of rigcal_site\n  got:      'rigcal_worker'" in message


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (SITE, SITE.replace('["person", "hard_hat"', '["hard_hat", "person"'),
         "entry classes: value error, the first class must be person"),
        (SITE, SITE.replace('"bucket"]', '"ladder"]'), "entry classes: value error, class names repeat"),
        (SITE, SITE.replace("{hard_hat = 1", "{person = 1"),
         "entry keypoints: value error, none of the classes of objects: person"),
        (SITE, SITE.replace("ladder = 3", "ladder = 5"), "entry keypoints.ladder: input should be less than or equal"),
        (SITE, SITE.replace("ladder = 0.5, ", ""),
         "entry score_thresholds: value error, one for each of the classes is needed, not so: ladder"),
        (SITE, SITE.replace("min_joints", "hint_score = 0.4\nmin_joints"),
         "entry hint_score: value error, must be below the score_threshold of person"),
        (SITE, SITE.replace("min_joints = 4", ""), "entry min_joints: field required"),
        (SITE, SITE.replace("date =", "day ="), "entry trained.date: field required"),
        (WORKER, WORKER.replace('"nose"', '"neck"'), "entry joints: value error, none of the 17 joints: neck"),
        (WORKER, WORKER.replace('"left_eye"', '"nose"'), "entry joints: value error, joints repeat"),
        (WORKER, WORKER.replace(f'notice = "{NOTICE}"', ""), "entry notice: field required"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_manifest_is_named(tmp_path, old, new, what):
    texts = {"site_text": new} if old is SITE else {"worker_text": new}
    assert refusal(bundle, tmp_path, **texts).startswith(f"model manifest: {what}")


def test_a_number_of_threads_below_one_is_refused(tmp_path):
    with pytest.raises(OptionError, match="option threads is out of range"):
        load_bundled(folder=tmp_path, threads=0)


def test_threads_may_share_the_detector(tmp_path):
    detector = bundle(tmp_path, site_network([LADDER]), worker_network(hats=[HAT_IN_CROP]))
    rng = np.random.default_rng(0)
    images = [cv2.resize(rng.integers(0, 255, (27, 48, 3), dtype=np.uint8), (1920, 1080)) for _ in range(4)]
    alone = [detector.detect(image) for image in images]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(detector.detect, images * 3))
    for idx, found in enumerate(together):
        assert np.array_equal(found.people_px, alone[idx % 4].people_px, equal_nan=True)
        assert np.array_equal(found.object_xyxy, alone[idx % 4].object_xyxy)


# --- the command ----------------------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path, monkeypatch):
    """`recognition run` over two instants of a rig of two cameras, with tiny bundled networks."""
    rig = semicircle_rig(2, size_wh=(640, 360))
    document = document_of_rig(rig, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(document, tmp_path / "s.rig.json")
    for camera in rig.cameras:
        (tmp_path / "capture" / camera.id).mkdir(parents=True)
        for number in range(2):
            image = np.zeros((*camera.camera.size_wh[::-1], 3), np.uint8)
            assert cv2.imwrite(str(tmp_path / "capture" / camera.id / f"{number:03d}.png"), image)
    models = tmp_path / "models"
    models.mkdir()
    bundle(models, site_network([LADDER]))
    monkeypatch.setattr(detectors, "load_bundled", partial(load_bundled, folder=models))

    def call(*arguments):
        places = [tmp_path / "s.rig.json", "--source", tmp_path / "capture", "-o", tmp_path / "r.mcap"]
        done = CliRunner().invoke(app, ["run", *map(str, [*places, *arguments])])
        assert done.exit_code == 0, done.output
        return done.output

    return call


LINE = f"site_int8.onnx, worker_int8.onnx (bundled): {NOTICE}"


def test_without_a_model_the_bundled_networks_look_and_say_what_to_know(run, tmp_path):
    assert f"notice: {LINE}\n" in run()
    metadata = read_metadata(tmp_path / "r.mcap")
    assert metadata["model.rigcal_site"].startswith("site_int8.onnx ")
    assert metadata["notice.rigcal_site"] == metadata["notice.rigcal_worker"] == NOTICE
    assert LINE in [said.message.message for said in iter_messages(tmp_path / "r.mcap", ["/log"])]
    assert check_recording(tmp_path / "r.mcap").ok


def test_the_json_output_has_the_notices(run):
    told = json.loads(run("--json"))
    assert told["notices"] == [LINE]
    assert set(told["people_detected"].values()) == {2}


@pytest.mark.parametrize(
    ("options", "families"),
    [
        (("--pose-model",), {"rigcal_site", "rigcal_worker", "movenet"}),
        (("--object-model",), {"rigcal_site", "rigcal_worker", "yolov8"}),
        (("--pose-model", "--object-model"), {"movenet", "yolov8"}),
    ],
)
def test_a_model_of_ones_own_replaces_its_half(run, tmp_path, options, families):
    own = {"--pose-model": pose_network(tmp_path), "--object-model": box_network(tmp_path)}
    output = run(*(part for option in options for part in (option, own[option])))
    metadata = read_metadata(tmp_path / "r.mcap")
    assert {name.removeprefix("model.") for name in metadata if name.startswith("model.")} == families
    is_bundled = "rigcal_site" in families
    assert ("notice:" in output) is is_bundled
    assert any(name.startswith("notice.") for name in metadata) is is_bundled
