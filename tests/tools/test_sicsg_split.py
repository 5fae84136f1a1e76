"""Claims about the committed evaluation sequences: the halves share nothing, violations last as planned."""

from pathlib import Path

import pytest

from tools.sicsg.assets import is_sealed
from tools.sicsg.planning import CRITICAL, share_of
from tools.sicsg.scene import read_scene
from tools.sicsg.sequences import SCENES, name_of
from tools.sicsg.violations import timeline

FILES = {half: sorted((SCENES / half).glob("*.scene.json")) for half in ("validation", "test")}
ALL = [path for paths in FILES.values() for path in paths]


@pytest.fixture(scope="module")
def scenes():
    return {path: read_scene(path) for path in ALL}


def assets(scenes, half):
    return set().union(*(scenes[path].assets() for path in FILES[half]))


def test_there_are_24_scenes_to_choose_by_and_12_sealed_ones(scenes):
    assert {half: len(paths) for half, paths in FILES.items()} == {"validation": 24, "test": 12}
    assert all(scene.split == path.parent.name for path, scene in scenes.items())


def test_the_halves_share_no_asset(scenes):
    assert not assets(scenes, "validation") & assets(scenes, "test")


def test_only_the_sealed_half_has_sealed_assets_so_that_training_shares_none_either(scenes):
    for half, sealed in (("validation", False), ("test", True)):
        assert {is_sealed(name.rpartition("/")[2]) for _, name in assets(scenes, half)} == {sealed}


def test_each_violation_lasts_for_35_to_65_percent_of_the_sequences_that_have_it(scenes):
    for path, scene in scenes.items():
        for kind in {violation.kind for violation in scene.violations}:
            assert 0.35 <= share_of(scene, kind) <= 0.65, (name_of(path), kind)


def test_there_are_forty_episodes_and_every_kind_in_both_halves(scenes):
    assert sum(len(scene.violations) for scene in scenes.values()) >= 40
    for paths in FILES.values():
        assert {v.kind for path in paths for v in scenes[path].violations} == set(CRITICAL)


def test_both_halves_have_all_lights_and_a_third_is_for_the_path_tracer(scenes):
    for paths in FILES.values():
        assert {scenes[path].light.kind for path in paths} == {"indoor", "backlight", "overexposed", "dusk"}
        assert sum(name_of(path).endswith("-cycles") for path in paths) >= len(paths) / 3


@pytest.mark.parametrize("path", [FILES["validation"][4], FILES["test"][9]], ids=lambda path: Path(path).name)
def test_the_timeline_in_the_file_is_the_one_that_the_scene_gives(scenes, path):
    assert timeline(scenes[path]) == scenes[path].violations
