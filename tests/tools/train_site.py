"""A data set of one picture and exported networks of known answers for it, for tests of what is shipped."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "recognition"))
from tiny_onnx import FLOAT, UINT8, model, node, tiny_network

from recognition.observations import JOINTS

CLASSES = ("person", "hard_hat", "ladder")
PERSON = np.array([228.0, 44.0, 260.0, 124.0])
"""Edges in the site network's input, which is as large as the picture."""
HAT = np.array([236.0, 44.0, 252.0, 58.0])
COARSE = np.column_stack([np.linspace(230, 258, 17), np.linspace(50, 120, 17)])
SCORES = {"person": 0.8, "hard_hat": 0.4, "ladder": 0.3}
"""Of the site network; the ladder is not there."""
WORKER_HAT, SURE = 0.6, 0.9
CATEGORIES = [
    {"id": 1, "name": "person", "keypoints": list(JOINTS)},
    {"id": 2, "name": "hard_hat", "keypoints": ["centre"]},
    {"id": 3, "name": "ladder", "keypoints": ["foot_left", "foot_right", "top_left", "top_right"]},
]


def make_data(folder):
    """The picture as training and as validation data."""
    (folder / "images").mkdir(parents=True)
    (folder / "scenes").mkdir()
    cv2.imwrite(str(folder / "images" / "a.png"), np.full((288, 512, 3), 90, np.uint8))
    (folder / "scenes" / "100000.json").write_text(json.dumps({"room": {"name": "0007"}}))
    image = {"id": 0, "file_name": "a.png", "width": 512, "height": 288, "light": "dusk", "renderer": "gl"}
    joints = np.column_stack([COARSE - 0.5, np.full(17, 2)]).ravel().tolist()
    content = {
        "images": [image | {"scene": "100000"}],
        "annotations": [_note(0, 1, PERSON, joints), _note(1, 2, HAT, [244.0, 48.0, 2])],
        "categories": CATEGORIES,
    }
    for split in ("train", "validation"):
        (folder / f"coco_{split}.json").write_text(json.dumps(content))
    return folder


def _note(number, category, edges, keypoints):
    bbox = [*(edges[:2] - 0.5), *(edges[2:] - edges[:2])]
    return {"id": number, "image_id": 0, "category_id": category, "bbox": bbox, "keypoints": keypoints, "ignore": 0}


def make_exports(folder, *, joints=17):
    """Folders of both networks as ``export`` leaves them."""
    networks = {"site": site_network(), "worker": worker_network(joints)}
    for name, onnx in networks.items():
        files = {f"{name}.onnx": onnx, f"{name}_int8.onnx": onnx + b"\x6a\x00"}  # an empty domain more
        (folder / name).mkdir(parents=True)
        for file, content in files.items():
            (folder / name / file).write_bytes(content)
        options = {"network": name, "joints": "all", "epochs": 3, "batch": 8, "rate": 0.002, "seed": 5}
        summary = {
            "epochs": 3,
            "plans": [[0, 2], [1, 3]],
            "options": options,
            "parameters": 7,
            "files": {key: {"sha256": hashlib.sha256(value).hexdigest()} for key, value in files.items()},
        }
        (folder / name / "export.json").write_text(json.dumps(summary))
    return {name: folder / name for name in networks}


def site_network():
    """Finds the person with joints 2 px to the right of the true ones, a hat, and a ladder that is not there."""
    scores, places = np.zeros((3024, len(CLASSES))), np.zeros((3024, 63))
    for number, (name, edges) in enumerate((("person", PERSON), ("hard_hat", HAT), ("ladder", PERSON + 40))):
        low, high = np.reshape(edges, (2, 2))
        column, row = np.floor((low + high) / 16).astype(int)
        cell, centre = row * 64 + column, np.array([column, row]) * 8 + 4.0
        scores[cell, number] = SCORES[name]
        places[cell, :4] = np.log(np.concatenate([centre - low, high - centre]) / 8)
        if name == "person":
            places[cell, 4:38] = ((COARSE + [2.0, 0.0] - centre) / 8).ravel()
            places[cell, 38:55] = 2.0
    outputs = {"scores": scores[None], "places": places[None]}
    return tiny_network(outputs, name="image", element_type=UINT8, shape=(1, 288, 512, 3))


def worker_network(joints):
    """Sees every joint in the first cell, which is none's place, and one hat that is the person's."""
    heat, hat = np.full((1, joints, 32, 24), 1e-6), np.zeros((1, 5, 32, 24))
    heat[:, :, 0, 0] = 1.0
    height = 1.25 * 80.0
    corner = np.array([244.0, 84.0 - 0.05 * height]) - [height * 3 / 8, height / 2]
    hat[0, :, 4, 12] = [WORKER_HAT, *((HAT - np.tile(corner, 2)) * 128 / height)]
    constants = {"heat0": heat, "hat0": hat, "sure": np.full((1, joints, 2), SURE), "zero": np.zeros((1, 1, 1))}
    constants["zero4"] = np.zeros((1, 1, 1, 1))
    nodes = [
        node("Cast", ["image"], "float", to=FLOAT),
        node("ReduceMax", ["float"], "rows", axes=[3], keepdims=0),
        node("ReduceMax", ["rows"], "one", axes=[1, 2], keepdims=1),
        node("Mul", ["one", "zero"], "nothing"),
        node("Add", ["nothing", "sure"], "states"),
        node("ReduceMax", ["float"], "one4", axes=[1, 2, 3], keepdims=1),
        node("Mul", ["one4", "zero4"], "nothing4"),
        node("Add", ["nothing4", "heat0"], "heat"),
        node("Add", ["nothing4", "hat0"], "hats"),
    ]
    shapes = {"heat": ("n", joints, 32, 24), "states": ("n", joints, 2), "hats": ("n", 5, 32, 24)}
    return model(nodes, constants, shapes, name="image", element_type=UINT8, shape=("n", 128, 96, 3))
