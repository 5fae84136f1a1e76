"""Claims about the reader of YAML: the layouts of Kalibr and ROS are read, everything else is refused by line."""

import numpy as np
import pytest

from rigcal.errors import FormatError
from rigcal.formats import import_rig
from rigcal.formats._yaml import list_text, number_text, parse_yaml

AS_KALIBR_WRITES_IT = """\
cam0:
  T_cam_imu:
  - [-0.9995184472361309, 0.021876089843145007, -0.022007051775495362, 0.04246317973602691]
  - [0.025341655517008066, 0.9847584328334349, -0.1720715823693607, 0.0005184030993907625]
  - [0.017907376422356798, -0.17254641594832693, -0.984838596021224, -0.015973750407470507]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.027396339719770575, 0.09512490805715525, -0.11279506361711115,
    0.05123810380038282]
  distortion_model: equidistant
  intrinsics: [274.51623038381354, 275.33528152592356, 313.61364519480173, 251.55631360961928]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: -0.005869528576852833
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [274.5, 275.3, 313.6, 251.5]
  resolution: [640, 480]
  rostopic: /cam1/image_raw
"""
"""The layout of Kalibr's own example, with a list over two lines."""

AS_PEOPLE_EDIT_IT = """\
%YAML:1.0
---
# the gate's cameras
cam0:   # left
    camera_model: "pinhole"

    rostopic: '/a#b/image'   # a hash inside quotes stays
    other: a#b
    empty:
    flags: {indented: no}
    T:
        - [1, -2.5,
           +.5, 3.]   # over lines
        -   [1e3, 2E-3, [4, [5]], ]
    nested:
        deep:
            value: ~
        truth: True
"""


def test_kalibr_s_layout_is_read(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(AS_KALIBR_WRITES_IT, encoding="utf-8")
    document = import_rig(path, from_format=None, created_utc="2026-11-22T09:30:01Z")
    fisheye, pinhole = document.cameras
    assert (fisheye.model, pinhole.model) == ("fisheye4", "opencv4")
    assert fisheye.coefficients["k4"] == 0.05123810380038282
    assert set(pinhole.coefficients.values()) == {274.5, 275.3, 313.6, 251.5, 0.0}
    assert pinhole.cam_from_rig.translation_m == (-0.11, 0.0, 0.0)
    assert document.extensions["kalibr"]["cam0"]["timeshift_cam_imu"] == -0.005869528576852833
    assert set(document.extensions["kalibr"]["cam1"]) == {"cam_overlaps", "rostopic"}


def test_hand_edited_layouts_are_read(tmp_path):
    text = AS_PEOPLE_EDIT_IT.replace("    flags: {indented: no}\n", "")
    assert parse_yaml(tmp_path, text) == {
        "cam0": {
            "camera_model": "pinhole",
            "rostopic": "/a#b/image",
            "other": "a#b",
            "empty": None,
            "T": [[1, -2.5, 0.5, 3.0], [1000.0, 0.002, [4, [5]]]],
            "nested": {"deep": {"value": None}, "truth": True},
        }
    }


AS_ROS_PRINTS_IT = """\
transforms:
- header:
    stamp:
      sec: 1
      nanosec: 0
    frame_id: world
  child_frame_id: cam0_optical_frame
  transform: {}
-   header:
      frame_id: "a: b"
    names:
    - x: 1
    - [2, 3]
    - y: 4
---
"""


def test_lists_of_tables_are_read(tmp_path):
    text = AS_ROS_PRINTS_IT.replace("  transform: {}\n", "")
    first = {"header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "world"}, "child_frame_id": "cam0_optical_frame"}
    second = {"header": {"frame_id": "a: b"}, "names": [{"x": 1}, [2, 3], {"y": 4}]}
    assert parse_yaml(tmp_path, text) == {"transforms": [first, second]}
    with pytest.raises(FormatError, match="line 8"):
        parse_yaml(tmp_path, AS_ROS_PRINTS_IT)


REFUSED = [
    (AS_PEOPLE_EDIT_IT, 10, "a number, a text or a list of them"),
    ("cam0:\n\tmodel: a\n", 2, "spaces before an entry"),
    ("cam0:\n  a: 1\n   b: 2\n", 3, "an entry 'name: value' with 2 spaces before it"),
    ("cam0:\n    a: 1\n  b: 2\n", 3, "an entry 'name: value' with 0 spaces before it"),
    ("cam0:\n  a: [1, 2\n  b: 3\n", 2, "a ] for every ["),
    ("cam0:\n  a: [1, 2]]\n", 2, "nothing after the last ]"),
    ("cam0:\n  a: [1, , 2]\n", 2, "a value between commas"),
    ("cam0:\n  a: [[1] [2]]\n", 2, "a comma between values"),
    ("cam0:\n  a: 1\n  a: 2\n", 3, "one entry a"),
    ("cam0:\n  a: &id001 [1]\n", 2, "a number, a text or a list of them"),
    ("cam0:\n  a: *id001\n", 2, "a number, a text or a list of them"),
    ("cam0:\n  a: |\n", 2, "a number, a text or a list of them"),
    ("cam0:\n  a: 1e999\n", 2, "a number, a text or a list of them"),
    ("cam0\n", 1, "an entry 'name: value' with 0 spaces before it"),
    ("- [1, 2]\n", 1, "an entry 'name: value'"),
]


@pytest.mark.parametrize(("text", "line", "expected"), REFUSED)
def test_other_yaml_is_refused_by_its_line(tmp_path, text, line, expected):
    with pytest.raises(FormatError) as caught:
        parse_yaml(tmp_path / "c.yaml", text)
    assert caught.value.where == f"{tmp_path / 'c.yaml'}, line {line}"
    assert caught.value.expected == expected
    assert caught.value.do_next == "write it as its tool does: tables, lists and numbers, without anchors, tabs or { }"


def test_numbers_are_written_so_that_they_read_back_to_the_last_bit(tmp_path):
    values = [*np.random.default_rng(5).normal(size=50) * 10.0 ** np.arange(-25, 25), 1e-5, -1e22, 0.0, 5e-324]
    assert parse_yaml(tmp_path, f"a: {list_text(values)}\n") == {"a": values}
    assert [number_text(value) for value in (1e-5, -1e22, 0.5)] == ["1.0e-05", "-1.0e+22", "0.5"]
    assert list_text((640, 480)) == "[640, 480]"
