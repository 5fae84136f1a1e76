"""Networks and manifests from files: what is loaded, and every way in which it is refused."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import tiny_onnx
from tiny_onnx import UINT8, tiny_network

from recognition import detectors
from recognition.detectors import load_model
from recognition.errors import ModelError
from rigcal.errors import OptionError


def tiny_yolox(classes=2, height_px=32, **network):
    """One person in the grid of stride 32, centre (16, 16), 32 px wide; its score is the brightest input value."""
    constant, gain = np.zeros((2, 1, 16 + 4 + 1, 5 + classes))
    constant[0, 20, :6] = 0.5, 0.5, 0, np.log(height_px / 32), 0, 1
    gain[0, 20, 4] = 1
    return tiny_network(constant, gain, **network)


BOXES = """
family = "yolox"
licence = "MIT"
sha256 = "{sha256}"
classes = ["person", "hard_hat"]
person_class = "person"
score_threshold = 0.5

[input]
name = "images"
size_wh = [32, 32]
layout = "nchw"
dtype = "float32"
colour = "bgr"
scale = 0.01
resize = "letterbox"
"""
POSES = """
family = "movenet"
licence = "MIT"
sha256 = "{sha256}"
joints = "coco17"
crop_margin = 1.0

[input]
name = "image"
size_wh = [32, 32]
layout = "nhwc"
dtype = "uint8"
colour = "rgb"
resize = "letterbox"
align = "centre"
"""


def write(folder, onnx=None, text=BOXES, stem="model"):
    return tiny_onnx.write(folder, onnx or tiny_yolox(), text, stem)


def refusal(call, *args, **kwargs):
    with pytest.raises(ModelError) as caught:
        call(*args, **kwargs)
    return str(caught.value)


@pytest.mark.parametrize("suffix", [".onnx", ".toml"])
def test_a_network_is_loaded_by_its_file_or_by_its_manifest(tmp_path, suffix):
    path = write(tmp_path)
    model = load_model(path.with_suffix(suffix))
    found = model.boxes(np.full((64, 64, 3), 80, np.uint8))
    assert found.classes == ("person",)
    assert found.xyxy == pytest.approx(np.array([[-0.5, -0.5, 63.5, 63.5]]))
    assert found.score == pytest.approx([0.8])
    assert model.person_class == "person"


def test_a_network_says_which_it_is(tmp_path):
    path = write(tmp_path)
    (info,) = load_model(path).model_info
    assert (info.name, info.family, info.licence) == ("model.onnx", "yolox", "MIT")
    assert info.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_an_open_dimension_is_accepted(tmp_path):
    path = write(tmp_path, tiny_yolox(shape=("batch", 3, 32, 32)))
    assert load_model(path).boxes(np.zeros((32, 32, 3), np.uint8)).classes == ()


def test_the_public_names_exist_and_are_sorted():
    assert all(hasattr(detectors, name) for name in detectors.__all__)
    assert detectors.__all__ == sorted(detectors.__all__, key=lambda name: (not name.isupper(), name))


def test_onnxruntime_is_imported_when_a_network_is_loaded_and_not_before():
    code = "import recognition.detectors, sys; sys.exit('onnxruntime' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_missing_file_is_named(tmp_path):
    assert refusal(load_model, tmp_path / "no.onnx") == (
        "cannot read the model\n"
        f"  where:    {tmp_path / 'no.onnx'}\n"
        "  expected: an ONNX file\n"
        "  got:      No such file or directory\n"
        "  do next:  check the path; a manifest FILE.toml needs FILE.onnx beside it"
    )


def test_a_manifest_alone_misses_its_network(tmp_path):
    path = write(tmp_path)
    path.unlink()
    assert f"where:    {path}" in refusal(load_model, path.with_suffix(".toml"))


def test_another_kind_of_file_is_refused(tmp_path):
    assert refusal(load_model, tmp_path / "model.pt") == (
        "not a model file\n"
        f"  where:    {tmp_path / 'model.pt'}\n"
        "  expected: FILE.onnx or FILE.toml\n"
        "  got:      model.pt\n"
        "  do next:  give the ONNX file, or its manifest"
    )


def test_a_network_without_a_manifest_gets_told_how_to_write_one(tmp_path):
    path = write(tmp_path)
    path.with_suffix(".toml").unlink()
    message = refusal(load_model, path)
    assert message.startswith(f"this network has no manifest\n  where:    {path}\n  expected: model.toml beside it; ")
    assert hashlib.sha256(path.read_bytes()).hexdigest() in message
    assert (
        "write model.toml with the entries family, licence, sha256, classes, person_class, rename, score_threshold, "
        "input.name, input.size_wh, input.layout, input.dtype, input.colour, input.scale, input.mean, input.std, "
        "input.resize, input.align, input.pad (family fastestdet, yolov7, yolov8, yolox), or family, licence, sha256, "
        "joints, score_threshold, input.name, "
    ) in message
    assert "(family movenet_multipose, yolov7_pose, yolov8_pose), or family, licence, sha256, joints, crop_" in message
    assert message.endswith("input.pad (family movenet, rtmpose); entries with a default may be left out")


def test_a_manifest_of_another_network_is_refused(tmp_path):
    path = write(tmp_path)
    stated = hashlib.sha256(path.read_bytes()).hexdigest()
    path.write_bytes(tiny_yolox(height_px=8))
    assert refusal(load_model, path) == (
        "the manifest describes another network than the one beside it\n"
        f"  where:    {path}\n"
        f"  expected: SHA-256 {stated}, as model.toml states\n"
        f"  got:      SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}\n"
        "  do next:  restore the network that belongs to model.toml, or mend the manifest for this one"
    )


@pytest.mark.parametrize(
    ("network", "got"),
    [
        ({"name": "input"}, "'input' 1x3x32x32 tensor(float)"),
        ({"shape": (1, 32, 32, 3)}, "'images' 1x32x32x3 tensor(float)"),
        ({"shape": (1, 3, 32)}, "'images' 1x3x32 tensor(float)"),
        ({"element_type": UINT8}, "'images' 1x3x32x32 tensor(uint8)"),
    ],
    ids=["name", "shape", "dimensions", "type"],
)
def test_an_input_other_than_the_manifest_states_is_refused(tmp_path, network, got):
    path = write(tmp_path, tiny_yolox(**network))
    assert refusal(load_model, path) == (
        "the network's input is not what its manifest states\n"
        f"  where:    {path}\n"
        "  expected: 'images' 1x3x32x32 tensor(float)\n"
        f"  got:      {got}\n"
        "  do next:  mend input.name, input.size_wh, input.layout and input.dtype of the manifest"
    )


@pytest.mark.parametrize(
    "onnx",
    [b"no network at all", tiny_yolox()[:-200], tiny_yolox(op_type="Levitate")],
    ids=["text", "cut off", "unknown operator"],
)
def test_a_file_that_onnxruntime_cannot_run_is_refused(tmp_path, onnx):
    path = write(tmp_path, onnx)
    message = refusal(load_model, path)
    assert message.startswith(f"onnxruntime cannot run this network\n  where:    {path}\n")
    assert message.endswith("export the network again with an older opset")


def test_text_that_is_no_toml_is_refused(tmp_path):
    path = write(tmp_path, text="family = yolox")
    assert refusal(load_model, path).startswith(
        f"the model manifest is not TOML\n  where:    {path.with_suffix('.toml')}\n  expected: TOML text\n"
    )


@pytest.mark.parametrize(("family", "got"), [('family = "yolov99"', "'yolov99'"), ("", "None"), ("family = 5", "5")])
def test_an_unknown_family_is_refused(tmp_path, family, got):
    path = write(tmp_path, text=BOXES.replace('family = "yolox"', family))
    assert refusal(load_model, path) == (
        "unknown model family\n"
        f"  where:    {path.with_suffix('.toml')}\n"
        "  expected: family = one of fastestdet, movenet, movenet_multipose, rtmpose, yolov7, yolov7_pose, yolov8, "
        "yolov8_pose, yolox\n"
        f"  got:      {got}\n"
        "  do next:  name the family whose output the network has, or add an adapter to recognition.detectors"
    )


@pytest.mark.parametrize(
    ("old", "new", "what", "got", "do_next"),
    [
        ("licence =", "license =", "entry licence: field required", "nothing", "add licence"),
        ('licence = "MIT"', 'licence = "MIT"\nauthor = "x"', "entry author: extra inputs are not permitted", "'x'",
         "mend or remove author"),
        ('joints = "coco17"', 'joints = "body25"', "entry joints: input should be 'coco17'", "'body25'",
         "mend or remove joints"),
        ("crop_margin = 1.0", "crop_margin = 0.5", "entry crop_margin: input should be greater than or equal to 1",
         "0.5", "mend or remove crop_margin"),
        ('colour = "rgb"', 'colour = "grey"', "entry input.colour: input should be 'bgr' or 'rgb'", "'grey'",
         "mend or remove input.colour"),
        ('align = "centre"', "border = 3", "entry input.border: extra inputs are not permitted", "3",
         "mend or remove input.border"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_manifest_is_named(tmp_path, old, new, what, got, do_next):
    path = write(tmp_path, text=POSES.replace(old, new))
    message = refusal(load_model, path)
    assert message.startswith(
        f"model manifest: {what}\n  where:    {path.with_suffix('.toml')}\n  expected: the entries "
    )
    assert message.endswith(f"  got:      {got}\n  do next:  {do_next}")


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('classes = ["person", "hard_hat"]', 'classes = "coco81"',
         "entry classes: value error, unknown set of classes; give a list of names, or coco80"),
        ('classes = ["person", "hard_hat"]', 'classes = ["person", "person"]',
         "entry classes: value error, class names repeat"),
        ('classes = ["person", "hard_hat"]', "classes = []",
         "entry classes: tuple should have at least 1 item after validation, not 0"),
        ('person_class = "person"', 'person_class = "worker"', "entry person_class: value error, none of the classes"),
        ("score_threshold = 0.5", 'rename = {helmet = "hard_hat", hat = "hard_hat"}\nscore_threshold = 0.5',
         "entry rename: value error, none of the classes: helmet, hat"),
        ("score_threshold = 0.5", "score_threshold = 0", "entry score_threshold: input should be greater than 0"),
        ('dtype = "float32"', 'dtype = "uint8"',
         "entry input: value error, an input of whole numbers takes pixels as they are: leave out scale, mean and std"),
        ('resize = "letterbox"', 'resize = "stretch"\nalign = "centre"',
         "entry input: value error, align is for letterbox: a stretched image fills the input"),
    ],
)  # fmt: skip
def test_entries_that_contradict_each_other_are_named(tmp_path, old, new, what):
    path = write(tmp_path, text=BOXES.replace(old, new))
    assert refusal(load_model, path).startswith(f"model manifest: {what}\n")


def test_a_number_of_threads_below_one_is_refused(tmp_path):
    with pytest.raises(OptionError, match="option threads is out of range"):
        load_model(write(tmp_path), threads=0)


def test_more_threads_give_the_same_boxes(tmp_path):
    path, image = write(tmp_path), np.full((64, 64, 3), 80, np.uint8)
    assert load_model(path, threads=2).boxes(image).xyxy == pytest.approx(load_model(path).boxes(image).xyxy)
