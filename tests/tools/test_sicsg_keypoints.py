"""What networks are taught of keypoints is what the runtime makes of them, though neither imports the other."""

import tomllib
from itertools import product
from pathlib import Path

import pytest

from recognition.keypoints import KEYPOINTS_OF
from tools.sicsg.catalog import CATEGORIES, category

MODELS = Path(__file__).parents[2] / "recognition" / "models"


def test_both_tables_have_the_same_classes():
    assert set(KEYPOINTS_OF) == {entry.name for entry in CATEGORIES if entry.keypoints}


@pytest.mark.parametrize("name", KEYPOINTS_OF)
def test_keypoints_mean_the_same_to_both(name):
    assert KEYPOINTS_OF[name].names == category(name).keypoints
    assert set(KEYPOINTS_OF[name].symmetries) == set(category(name).symmetries)


@pytest.mark.parametrize("name", KEYPOINTS_OF)
def test_symmetries_are_a_group_with_the_identity_first(name):
    symmetries = KEYPOINTS_OF[name].symmetries
    assert symmetries[0] == tuple(range(len(KEYPOINTS_OF[name].names)))
    assert {tuple(first[k] for k in second) for first, second in product(symmetries, repeat=2)} == set(symmetries)


@pytest.mark.parametrize("manifest", ["site.toml", "site_int8.toml"])
def test_the_bundled_networks_have_these_keypoints(manifest):
    stated = tomllib.loads((MODELS / manifest).read_text(encoding="utf-8"))["keypoints"]
    assert stated == {name: len(entry.names) for name, entry in KEYPOINTS_OF.items()}
