"""Claims about stories: a seed gives a scene, vignettes give their violations, the sealed half shares nothing."""

import ast
from pathlib import Path

import numpy as np
import pytest

from tools.sicsg.assets import is_sealed
from tools.sicsg.cameras import semicircle
from tools.sicsg.scene import Scene, read_scene, write_scene
from tools.sicsg.story import Plot, write_story
from tools.sicsg.story.write import MAX_THINGS, MAX_WORKERS, VIGNETTES
from tools.sicsg.violations import violations_at

ROOT = Path(__file__).parents[2]
KIND = {"hat": "no_hat", "ladder": "ladder", "window": "window", "platform": "platform"}


def cameras(rng, room):
    return semicircle(rng, (640, 360), room, count=2, fps=5.0)


def story(seed, *acts, split="train", duration_s=8.0):
    plot = Plot(split, acts, "indoor", cameras, duration_s=duration_s, workers=2, things=6)
    return write_story(seed, plot)


@pytest.fixture(scope="module", params=sorted(VIGNETTES))
def violating(request):
    return request.param, [story(seed, (request.param, 0.5)) for seed in (1, 2)]


def test_a_seed_gives_the_same_scene_and_another_seed_another():
    first, again, other = story(3, ("hat", 0.5)), story(3, ("hat", 0.5)), story(4, ("hat", 0.5))
    assert first == again
    assert first.assets() != other.assets()


def test_a_scene_file_gives_back_the_scene(tmp_path):
    scene = story(5, ("window", 0.5))
    write_scene(scene, tmp_path / "scene.json")
    assert read_scene(tmp_path / "scene.json") == scene


def test_an_unknown_entry_of_a_scene_file_is_refused(tmp_path):
    scene = story(5, ("hat", 0.5)).model_dump()
    with pytest.raises(ValueError, match="wheather"):
        Scene.model_validate(scene | {"wheather": "rain"})


def test_a_vignette_holds_its_violation_for_about_half_of_the_time_and_no_other(violating):
    name, scenes = violating
    for scene in scenes:
        assert {violation.kind for violation in scene.violations} == {KIND[name]}
        lasting = sum(violation.end_s - violation.start_s for violation in scene.violations)
        assert 0.3 < lasting / scene.duration_s < 0.7


def test_the_timeline_is_what_holds_at_any_time(violating):
    _, scenes = violating
    rng = np.random.default_rng(0)
    for scene in scenes:
        borders = [t for violation in scene.violations for t in (violation.start_s, violation.end_s)]
        for t_s in rng.uniform(0, scene.duration_s, 12):
            if all(abs(t_s - border) > 0.01 for border in borders):
                expected = {(v.kind, v.workers, v.things) for v in scene.violations if v.start_s <= t_s < v.end_s}
                assert violations_at(scene, float(t_s)) == expected


def test_each_action_starts_when_the_one_before_ends(violating):
    _, scenes = violating
    for worker in (worker for scene in scenes for worker in scene.workers):
        ends = [0.0, *(action.end_s for action in worker.actions)]
        assert [action.start_s for action in worker.actions] == ends[:-1]


@pytest.mark.parametrize("name", sorted(VIGNETTES))
def test_a_boundary_negative_looks_like_a_violation_and_is_none(name):
    scene = story(7, (name, 0.0))
    assert scene.violations == ()
    wanted = {"hat": "hard_hat", "ladder": "ladder", "window": "large_window", "platform": "platform"}[name]
    assert any(wanted in thing.category for thing in scene.things)


def test_scenes_keep_to_the_papers_size():
    plot = Plot("train", (("ladder", 0.5), ("platform", 0.5)), "dusk", cameras)
    scene = write_story(11, plot)
    assert len(scene.workers) == MAX_WORKERS == 4
    assert len(scene.things) <= MAX_THINGS == 14


def test_the_sealed_half_shares_no_asset_with_the_open_one():
    for split, sealed in (("train", False), ("validation", False), ("test", True)):
        scenes = [story(seed, ("hat", 0.5), split=split, duration_s=2.0) for seed in (21, 22)]
        names = {name.rpartition("/")[2] for scene in scenes for _, name in scene.assets()}
        assert {is_sealed(name) for name in names} == {sealed}


def test_the_generator_knows_nothing_of_recognition():
    for path in sorted((ROOT / "tools" / "sicsg").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.partition(".")[0] == "recognition" for name in names), path
