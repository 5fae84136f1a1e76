"""The data file is read into edge coordinates, checked, and decoded once."""

import json

import cv2
import numpy as np
import pytest

from recognition.detectors.bundled.geometry import SITE_WH
from recognition.observations import JOINTS
from tools.train.__main__ import main
from tools.train.cache import CROP_WH, read_image, site_cache, worker_cache
from tools.train.coco import DataError, read_split

CATEGORIES = [
    {"id": 1, "name": "person", "keypoints": list(JOINTS)},
    {"id": 2, "name": "hard_hat", "keypoints": ["centre"]},
]


def note(number, category, bbox, keypoints=(), ignore=0):
    return {
        "id": number, "image_id": 0, "category_id": category, "bbox": list(bbox), "keypoints": list(keypoints),
        "ignore": ignore, "visible_fraction": 1.0, "worn_by": None,
    }  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "images").mkdir()
    image = np.full((360, 640, 3), 60, np.uint8)
    image[100:200, 300:340] = 200
    cv2.imwrite(str(tmp_path / "images" / "a.png"), image)
    content = {
        "images": [{"id": 0, "file_name": "a.png", "width": 640, "height": 360, "light": "dusk", "renderer": "gl"}],
        "annotations": [
            note(0, 1, (299.5, 99.5, 40, 100), [310.0, 110.0, 2.0] + [0.0, 0.0, 0.0] * 16),
            note(1, 2, (309.5, 95.5, 20, 10), [319.5, 100.0, 2.0]),
            note(2, 1, (10, 10, 5, 9), [0.0, 0.0, 0.0] * 17, ignore=1),
        ],
        "categories": CATEGORIES,
    }
    (tmp_path / "coco_train.json").write_text(json.dumps(content))
    return tmp_path


def rewrite(folder, change):
    path = folder / "coco_train.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def test_boxes_and_points_are_in_edge_coordinates(folder):
    truth = read_split(folder, "train").pictures[0].truth
    assert truth.boxes[0].tolist() == [300.0, 100.0, 340.0, 200.0]
    assert truth.points[0, 0].tolist() == [310.5, 110.5, 2.0]
    assert truth.classes.tolist() == [0, 1, 0]
    assert truth.ignore.tolist() == [False, False, True]
    assert truth.sizes()[0] == pytest.approx(np.sqrt(40 * 100))


def test_the_site_cache_holds_letterboxed_images_with_their_truth(folder):
    cache = site_cache(read_split(folder, "train"), SITE_WH, lambda _: None)
    left, top, right, bottom = cache.truths[0].boxes[0]
    assert (left, top, right, bottom) == (240.0, 80.0, 272.0, 160.0)
    assert cache.images[0, 81:159, 241:271].min() > 190
    assert cache.images[0, :79].max() < 70


def test_the_worker_cache_holds_a_crop_per_worker_who_counts_with_the_hats(folder):
    cache = worker_cache(read_split(folder, "train"), lambda _: None)
    assert cache.images.shape == (1, CROP_WH[1], CROP_WH[0], 3)
    truth = cache.truths[0]
    assert truth.classes.tolist() == [0, 1]
    left, top, right, bottom = np.rint(truth.boxes[0]).astype(int)
    assert cache.images[0, top + 1 : bottom - 1, left + 1 : right - 1].min() > 190
    assert cache.images[0, top:bottom, left - 3].max() < 90


def test_images_are_decoded_again_only_when_the_data_file_changes(folder):
    said = []
    for _ in range(2):
        site_cache(read_split(folder, "train"), SITE_WH, said.append)
    assert len(said) == 1
    rewrite(folder, lambda content: content["annotations"].pop())
    site_cache(read_split(folder, "train"), SITE_WH, said.append)
    assert len(said) == 2
    assert len(list((folder / "cache").iterdir())) == 1


def test_an_image_of_another_size_is_named(folder):
    rewrite(folder, lambda content: content["images"][0].update(width=1280))
    with pytest.raises(DataError, match=r"a\.png: an image is not what the data file says; expected \(1280, 360\)"):
        read_image(read_split(folder, "train").pictures[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["categories"].reverse() or c["categories"][0].update(id=3), "the categories are others"),
        (lambda c: c["annotations"][0].update(category_id=3), "an annotation has no category"),
        (lambda c: c["categories"][1].update(keypoints=list("abcde")), "an object has too many keypoints"),
        (lambda c: c["images"].clear() or c["annotations"].clear(), "the data file is empty"),
    ],
)
def test_another_data_file_is_refused(folder, change, message):
    rewrite(folder, change)
    with pytest.raises(DataError, match=message):
        read_split(folder, "train")


def test_a_class_that_is_missing_is_named(folder):
    with pytest.raises(DataError, match="a class is missing; expected ladder, got person, hard_hat"):
        read_split(folder, "train").number("ladder")


def test_the_command_explains_missing_data(tmp_path, capsys):
    network = str(tmp_path / "site.onnx")
    assert main(["evaluate", "--site", network, "--data", str(tmp_path)]) == 1
    assert "there is no data file" in capsys.readouterr().err
