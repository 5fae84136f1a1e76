"""The study of errors: what is injected is what it says, what is left alone stays as it is, and curves add up."""

import json
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "recognition"))
from violation_scenes import rules, truth

from recognition.evaluation.violations import (
    KINDS,
    ObservedSequence,
    RowResult,
    Stretch,
    ViolationEvaluation,
    document_of,
    rows_of,
)
from recognition.observations import JOINTS, FrameSet, Instant, Scene, WorkerTrack
from recognition.rules import load_rules
from recognition.synthetic import semicircle_rig, simulate
from rigcal.camera import Camera
from tools.evaluation_report import read_study, write_page
from tools.sicsg.scene import SceneCamera, read_scene, write_scene
from tools.sicsg.sequences import SCENES, Video
from tools.sicsg.truth import Visibility
from tools.study.compress import AS_IT_IS, compressed, kbit_per_s
from tools.study.detector import open_reports, seen_reports, with_joints
from tools.study.errors import measured_errors, shows_of, sizes_px
from tools.study.exact import exact_views
from tools.study.faults import AXES, Injected, injected, misplaced, scene_error_m
from tools.study.figures import COST, curves_of, key_of, newest, read_lines
from tools.study.gates import gate_sentences
from tools.study.measured import MeasuredDetector
from tools.study.plot import study_plot
from tools.study.safe import false_alarms_of, safe_scenes, told
from tools.study.trial import Decided, Trial, decided, jittered, tally
from tools.study.unrendered import _shrunk
from tools.study.world import World
from tools.truth_walk import walk_of

ROOT = Path(__file__).parents[2]
FRAMES, FPS = 10, 5.0
EVERY = tuple(range(17))


@pytest.fixture(scope="module")
def world():
    """Two workers who walk, with their hats, before four cameras; nothing is hidden."""
    rig = semicircle_rig()
    site = simulate(rig, workers=2, frames=FRAMES, fps=FPS, seed=2)
    hats = [n for n, name in enumerate(site.object_class) if name == "hard_hat"]
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    centre, size = site.object_centre_in_world_m[:, hats], site.object_size_m[hats]
    views = len(rig.cameras)
    bare = World(
        truth=truth({}, frames=FRAMES, period_s=1 / FPS),
        rig=rig,
        classes=("hard_hat",) * len(hats),
        t_s=np.arange(FRAMES) / FPS,
        joints_m=site.joints_in_world_m,
        corners_m=centre[:, :, None] + corner * size[:, None],
        keypoints_m=np.full((FRAMES, len(hats), 4, 3), np.nan),
        joint_seen=np.full((FRAMES, views, 2, 17), Visibility.VISIBLE),
        worker_share=np.ones((FRAMES, views, 2)),
        worker_given=np.ones((FRAMES, views, 2), dtype=bool),
        object_share=np.ones((FRAMES, views, len(hats))),
        object_given=np.ones((FRAMES, views, len(hats)), dtype=bool),
        object_xyxy=np.full((FRAMES, views, len(hats), 4), np.nan),
    )
    exact = exact_views(bare, (0.0,) * views)
    inside = exact.inside(exact.joints_px)
    return replace(
        bare,
        object_xyxy=exact.whole_xyxy,
        joint_seen=np.where(inside, Visibility.VISIBLE, Visibility.OUTSIDE),
        worker_share=(inside.sum(axis=-1) >= 4).astype(float),
        object_share=exact.inside(exact.middles_px).astype(float),
    )


def rng(seed=0):
    return np.random.default_rng(seed)


def seen(world, *, pixel=0.0, late_s=(0.0,) * 4, seed=0):
    return list(open_reports(world, exact_views(world, late_s), rng(seed), pixel))


def projected(world, view, points_in_world):
    entry = world.rig.cameras[view]
    return entry.camera.project(entry.cam_from_rig.apply(world.rig.world_from_rig.inverse().apply(points_in_world)))


def test_a_perfect_detector_reports_what_the_lenses_see(world):
    for view, found in enumerate(seen(world)[3]):
        right = projected(world, view, world.joints_m[3])
        inside = np.isfinite(found.people_px[..., 0])
        assert inside.any()
        if len(found.people_px) == 2:
            np.testing.assert_allclose(found.people_px[inside], right[inside], atol=1e-9)


def test_a_clock_that_is_late_shows_a_later_world(world):
    found = seen(world, late_s=(0.0, 0.2, 0.1, 0.0))[3]
    for view, between in ((0, world.joints_m[3]), (1, world.joints_m[4]), (2, world.joints_m[3:5].mean(axis=0))):
        right, inside = projected(world, view, between), np.isfinite(found[view].people_px[..., 0])
        if len(found[view].people_px) == 2:
            np.testing.assert_allclose(found[view].people_px[inside], right[inside], atol=1e-9)


def test_what_is_hidden_is_not_reported(world):
    hidden = replace(
        world,
        joint_seen=np.full_like(world.joint_seen, Visibility.OCCLUDED),
        object_given=np.zeros_like(world.object_given),
    )
    exact = exact_views(hidden, (0.0,) * 4)
    assert all(len(v.people_px) == 0 and not v.object_class for views in seen_reports(hidden, exact) for v in views)
    by_itself = hidden.joint_seen.copy()
    by_itself[3, 0, 1] = Visibility.SELF_OCCLUDED
    (first, *_) = list(seen_reports(replace(hidden, joint_seen=by_itself), exact))[3]
    assert len(first.people_px) == 1


def test_joints_that_a_network_does_not_know_are_not_reported(world):
    for views in with_joints(iter(seen(world)), (0, 5, 6, 15, 16)):
        for view in views:
            assert np.isnan(view.people_px[:, [1, 2, 3, 4, 7, 8, 9, 10, 11, 12, 13, 14]]).all()
    assert all(len(view.people_px) == 0 for views in with_joints(iter(seen(world)), (0, 1, 2)) for view in views)


def test_noise_has_its_size_and_the_same_seed_the_same_noise(world):
    exact, noisy, again = (seen(world, pixel=pixel) for pixel in (0.0, 3.0, 6.0))
    off, twice = (
        np.concatenate(
            [
                (two.people_px - one.people_px).ravel()
                for before, after in zip(exact, other, strict=True)
                for one, two in zip(before, after, strict=True)
            ]
        )
        for other in (noisy, again)
    )
    assert np.nanstd(off) == pytest.approx(3.0, rel=0.1)
    np.testing.assert_allclose(twice, 2 * off, atol=1e-9)


def observed(world, views):
    """The world as a network saw it: what it reported at each instant."""
    times = world.truth.t_ns.tolist()
    instants = [Instant(FrameSet(n, t, (None,) * 4), own) for n, (t, own) in enumerate(zip(times, views, strict=True))]
    return ObservedSequence(world.truth, world.rig, tuple(instants), Path("none.mcap"))


def drawn(world, errors, seed=0):
    return list(MeasuredDetector(errors).reports(world, exact_views(world, (0.0,) * 4), rng(seed)))


def test_a_network_without_errors_is_drawn_without_errors(world):
    exact = seen(world)
    errors = measured_errors([(world, observed(world, exact))])
    assert errors.workers.found.mean() > 0.9
    for mine, right in zip(drawn(world, errors), exact, strict=True):
        for view, other in zip(mine, right, strict=True):
            assert view.object_class == other.object_class
            np.testing.assert_allclose(view.object_xyxy, other.object_xyxy, atol=1e-6)
            if len(view.people_px) == len(other.people_px):
                np.testing.assert_allclose(view.people_px, other.people_px, atol=1e-6)


def test_errors_that_were_measured_come_back_in_their_size(world):
    noisy, exact = seen(world, pixel=4.0), exact_views(world, (0.0,) * 4)
    errors = measured_errors([(world, observed(world, noisy))])
    off = [
        (view.people_px - exact.joints_px[frame, number]) / sizes_px(exact.joints_px[frame, number])[:, None, None]
        for seed in range(3)
        for frame, views in enumerate(drawn(world, errors, seed))
        for number, view in enumerate(views)
        if len(view.people_px) == 2
    ]
    assert np.nanstd(np.concatenate(off)) == pytest.approx(np.nanstd(errors.workers.off), rel=0.1)


def test_what_a_network_misses_stays_missed_for_as_long_as_it_did(world):
    """A worker who was missed in the first half is missed half of the time, in a few long stretches."""
    half = [view if n >= FRAMES // 2 else _nobody(view) for n, view in enumerate(seen(world))]
    errors = measured_errors([(world, observed(world, half))])
    found = np.array([[len(view.people_px) for view in views] for views in drawn(world, errors, 1)])
    there = (world.worker_share > 0).sum(axis=-1)
    assert found.sum() / there.sum() == pytest.approx(0.5, abs=0.2)
    assert np.abs(np.diff(found, axis=0)).sum(axis=0).max() <= 5


def _nobody(views):
    return tuple(replace(view, people_px=np.zeros((0, 17, 2)), people_score=np.zeros((0, 17))) for view in views)


def test_what_was_reported_of_nothing_is_replayed_where_it_was(world):
    ghost = np.array([[3.0, 3.0, 30.0, 40.0]])
    views = [
        tuple(
            replace(view, object_class=("cone",), object_xyxy=ghost, object_score=np.ones(1),
                    object_keypoints_px=np.full((1, 4, 2), np.nan))
            for view in own
        )
        for own in seen(world)
    ]  # fmt: skip
    errors = measured_errors([(world, observed(world, views))])
    for own in drawn(world, errors):
        for view in own:
            assert view.object_class.count("cone") == 1
            np.testing.assert_array_equal(view.object_xyxy[view.object_class.index("cone")], ghost[0])


def test_how_much_shows_has_borders_and_what_does_not_show_is_not_there():
    assert shows_of(np.array([0.0, 0.1, 0.3, 0.6, 1.0])).tolist() == [0, 1, 2, 3, 4]


def centres(rig):
    return np.array([entry.cam_from_rig.inverse().translation_m for entry in rig.cameras])


@pytest.mark.parametrize("axis", ["position", "orbit"])
def test_displaced_cameras_are_off_by_the_level_and_the_reference_by_nothing(world, axis):
    off = np.array([centres(misplaced(axis, 40.0, world, rng(n))) - centres(world.rig) for n in range(300)])
    assert np.sqrt((off**2).sum(axis=-1).mean(axis=0))[1:] == pytest.approx(0.04, rel=0.1)
    assert np.abs(off[:, 0]).max() == 0


def test_a_camera_displaced_about_the_scene_still_looks_at_its_middle(world):
    middle = world.rig.world_from_rig.inverse().apply(world.middle_m)
    moved = misplaced("orbit", 100.0, world, rng())
    for true, wrong in zip(world.rig.cameras, moved.cameras, strict=True):
        one, two = true.cam_from_rig.apply(middle), wrong.cam_from_rig.apply(middle)
        np.testing.assert_allclose(one / np.linalg.norm(one), two / np.linalg.norm(two), atol=1e-9)
    assert scene_error_m(moved, world) < 1e-9 < 0.01 < scene_error_m(misplaced("position", 100.0, world, rng()), world)


def test_turned_cameras_stay_where_they_are(world):
    turned = [misplaced("rotation", 0.5, world, rng(n)) for n in range(300)]
    assert np.abs(np.array([centres(rig) for rig in turned]) - centres(world.rig)).max() < 1e-9
    angles = [
        (a.cam_from_rig @ b.cam_from_rig.inverse()).angle_rad
        for rig in turned
        for a, b in list(zip(rig.cameras, world.rig.cameras, strict=True))[1:]
    ]
    assert np.rad2deg(np.sqrt(np.mean(np.square(angles)))) == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize(("axis", "level"), [("position", 1.0), ("orbit", 1.0), ("rotation", 0.01)])
def test_the_stated_covariance_is_that_of_the_errors(world, axis, level):
    draws, entry = [], world.rig.cameras[1]
    for n in range(600):
        wrong = misplaced(axis, level, world, rng(n)).cameras[1]
        turn = (wrong.cam_from_rig @ entry.cam_from_rig.inverse()).rvec_rad
        shift = wrong.cam_from_rig.translation_m - entry.cam_from_rig.translation_m
        draws.append(np.concatenate([turn, shift]))
    stated, found = wrong.pose_covariance, np.cov(np.array(draws).T)
    assert np.abs(found - stated).max() < 0.15 * np.abs(stated).max()


def test_an_exact_rig_has_no_scene_error(world):
    assert scene_error_m(world.rig, world) < 1e-9


def test_no_error_changes_nothing(world):
    for axis, about in AXES.items():
        wrong = injected(axis, about.levels[0], world, rng())
        assert not wrong.late_s.any()
        assert wrong.joints == EVERY
        np.testing.assert_array_equal(centres(wrong.rig), centres(world.rig))
        assert (wrong.pixel, wrong.joint_m) == (0.0, 0.0)


def test_sets_of_joints_have_as_many_as_they_say(world):
    for level in AXES["joints"].levels:
        known = injected("joints", level, world, rng()).joints
        assert len(set(known)) == level
        assert JOINTS.index("left_wrist") in known


def test_joints_are_moved_by_so_much_in_the_mean():
    still = Scene(0, 0, (WorkerTrack(1, np.zeros((17, 3)), np.full(17, 4), np.zeros(4)),), ())
    for is_held in (True, False):
        wrong = Injected(semicircle_rig(), np.zeros(4), EVERY, joint_m=0.05, joint_held=is_held)
        moved = np.array([s.workers[0].joints_m for s in jittered(iter([still] * 400), wrong, rng())])
        assert np.linalg.norm(moved, axis=-1).mean() == pytest.approx(0.05, rel=0.02 if not is_held else 0.3)
        assert (np.ptp(moved, axis=0) == 0).all() == is_held


def test_a_trial_gives_the_same_decisions_again(world):
    site = load_rules(ROOT / "rig_configs" / "site.rules.toml")
    trial, own = (
        Trial("position", 20.0, "open", 1),
        MeasuredDetector(measured_errors([(world, observed(world, seen(world)))])),
    )
    first, second = (decided(world, trial, own, site) for _ in range(2))
    np.testing.assert_array_equal(first.violated, second.violated)
    assert first.violated.shape == first.unknown.shape == (FRAMES, 4)
    assert not (first.violated & first.unknown).any()


def test_a_tally_counts_decisions_what_is_unknown_and_false_alarms():
    known = truth({"no_hat": [Stretch(2.0, 4.0)]}, frames=30)
    violated = np.zeros((30, 4), dtype=bool)
    violated[12:18, 0], violated[25:27, 0], violated[3:5, 3] = True, True, True
    unknown = np.zeros((30, 4), dtype=bool)
    unknown[:, 1] = True
    found = tally(known, Decided(violated, unknown))
    assert found.counts[0].tolist() == [5, 2, 0, 13]
    assert found.unknown.tolist() == [0, 30, 0, 0]
    assert found.false_alarms.tolist() == [1, 0, 0, 1]
    assert found.safe_s == pytest.approx([4.0, 6.0, 6.0, 6.0])


def line(level, sequence, right, wrong, *, seed=0, **more):
    """So many instants of each violation right and wrong, half of them violations."""
    counts = [[right, wrong, wrong, right]] * len(KINDS)
    own = {"axis": "position", "level": level, "detector": "open", "seed": seed, "sequence": sequence}
    counted = {"counts": counts, "unknown": [right, 0, 0, 0], "false_alarms": [0] * 4, "safe_s": [40.0] * 4}
    return {"rules": "r", "method": "m", **own, **counted, "about": {"scene_mm": level / 2}} | more


def test_curves_pool_sequences_and_say_what_an_error_costs():
    lines = [
        line(level, name, right, 100 - right) for name in "ab" for level, right in ((0.0, 95), (5.0, 95), (20.0, 90))
    ]
    (curve,) = curves_of(lines)
    np.testing.assert_allclose(curve.mean, [0.95, 0.95, 0.90])
    np.testing.assert_allclose(curve.cost[:, 0], [0, 0, 0.05], atol=1e-12)
    np.testing.assert_allclose(curve.about["scene_mm"], [0, 2.5, 10])
    np.testing.assert_allclose(curve.unknown[0], [95 / 200, 0, 0, 0])
    assert curve.decisions.tolist() == [[200, 200]] * 4
    assert curve.bearable == (5.0, 20.0)
    assert curve.trials == 2
    assert COST < 0.05


def test_levels_are_compared_on_what_all_were_tried_on():
    lines = [line(0.0, "a", 90, 10), line(5.0, "a", 80, 20), line(0.0, "b", 50, 50)]
    (curve,) = curves_of(lines)
    np.testing.assert_allclose(curve.mean, [0.9, 0.8])
    assert list(curves_of([line(0.0, "a", 90, 10), line(5.0, "b", 80, 20)])) == []


def test_a_line_that_was_cut_off_is_tried_again_and_other_studies_are_left_out(tmp_path):
    path = tmp_path / "study.jsonl"
    assert read_lines(path) == []
    old, new = line(0.0, "a", 1, 1, method="old"), line(0.0, "a", 1, 1)
    path.write_text(f"{json.dumps(old)}\n{json.dumps(new)}\n{json.dumps(new)[:40]}")
    assert read_lines(path) == [old, new]
    assert newest(read_lines(path)) == [new]
    assert newest([]) == []
    assert key_of(old) != key_of(new)


def test_the_picture_has_a_line_for_each_violation_and_for_their_mean_the_gate_and_what_is_likely():
    lines = [line(level, name, 90, 10) for name in "ab" for level in (0.0, 5.0, 20.0)]
    tree = ET.fromstring(study_plot(list(curves_of(lines)), AXES))
    assert len(tree.findall("{*}polyline")) == len(KINDS) + 1
    assert len(tree.findall("{*}polygon")) == 1
    assert "cameras displaced" in "".join(tree.itertext())
    assert sum(path.get("stroke-dasharray") is not None for path in tree.findall("{*}path")) == 2


def test_bit_rates_stand_below_their_levels():
    lines = [line(level, "a", 90, 10, about={"kbit_per_s": rate}) for level, rate in ((0.0, 7000.0), (5.0, 900.0))]
    text = "".join(ET.fromstring(study_plot(list(curves_of(lines)), AXES)).itertext())
    assert "7 Mb/s" in text
    assert "0.9 Mb/s" in text


def test_gates_are_held_against_what_an_error_costs():
    costs = {0.0: 95, 5.0: 95, 20.0: 95, 40.0: 95, 80.0: 90}
    said = list(
        gate_sentences(list(curves_of([line(level, "a", right, 100 - right) for level, right in costs.items()])), AXES)
    )
    assert said == [
        "position_sigma_m, 20 mm (cameras displaced, by an exact detector): costs +0.0 points there, 80 mm costs 2 "
        "points of balanced accuracy: it stays, 4.0 times below.",
        "scene_sigma_m, 20 mm (the scene's middle misplaced, by cameras displaced or turned, by an exact detector): "
        "costs +0.0 points there, 40 mm costs 2 points of balanced accuracy: it stays, 2.0 times below.",
    ]
    worse = [line(level, "a", right, 100 - right) for level, right in ((0.0, 95), (20.0, 80), (40.0, 70))]
    assert next(gate_sentences(list(curves_of(worse)), AXES)).endswith("it should be tighter.")
    free = [line(level, "a", 95, 5) for level in (0.0, 20.0, 40.0)]
    assert "no level up to 40 mm costs" in next(gate_sentences(list(curves_of(free)), AXES))


def test_false_alarms_are_counted_per_hour_with_an_interval_over_scenes():
    each = [
        line(17.0, name, 1, 1, detector="seen", false_alarms=[count, 0, 0, 1], safe_s=[60.0] * 4)
        for name, count in (("a", 0), ("b", 2))
    ]
    (found,) = false_alarms_of(each)
    assert found.whole[0] == pytest.approx(4 / (2 / 60))
    assert found.whole[1:] == pytest.approx((60.0, 180.0))
    np.testing.assert_allclose(found.per_hour, [60, 0, 0, 60])
    assert told(found) == (
        "seen: 120.0 an hour (60.0 to 180.0) in 2 min, 2 scenes; no_hat 60.0, ladder 0.0, window 0.0, platform 60.0"
    )


def test_safe_work_holds_no_violation():
    number, scene = next(safe_scenes())
    assert (number, scene.story, scene.seed) == (0, "hat+ladder", 260_000)
    assert scene.violations == ()
    assert scene.split == "validation"


def test_a_camera_with_fewer_pixels_sees_the_same_at_the_same_place():
    names = {
        "fx": 900.0,
        "fy": 910.0,
        "cx": 640.0,
        "cy": 350.0,
        "k1": -0.2,
        "k2": 0.05,
        "p1": 0.0,
        "p2": 0.0,
        "k3": 0.0,
    }
    camera = SceneCamera(
        id="a", size_wh=(1280, 720), coefficients=names, quat_wxyz=(1, 0, 0, 0), translation_m=(0, 0, 0), fps=5.0
    )
    small = _shrunk(camera, 4)
    assert small.size_wh == (320, 180)
    point = np.array([[0.3, -0.2, 2.0]])
    large_px, small_px = (
        Camera("opencv5", own.size_wh, np.array(list(own.coefficients.values()))).project(point)
        for own in (camera, small)
    )
    np.testing.assert_allclose((small_px + 0.5) * 4 - 0.5, large_px, atol=1e-9)


def test_compression_keeps_the_pictures_number_and_size_and_takes_fewer_bits(tmp_path):
    scene = read_scene(next((SCENES / "validation").glob("*.scene.json")))
    camera = scene.cameras[0].model_copy(update={"size_wh": (64, 48)})
    own = tmp_path / "a"
    own.mkdir()
    write_scene(scene.model_copy(update={"cameras": (camera,)}), own / "scene.json")
    for name in ("true.rig.json", "timestamps.csv", "truth.npz", "truth.json"):
        (own / name).write_text(name)
    video = Video(own / f"{camera.id}.mp4", camera, 10)
    for number in range(6):
        video.add(rng(number).integers(0, 255, (48, 64, 3), dtype=np.uint8))
    video.close()
    assert compressed(own, AS_IT_IS, tmp_path / "kept") == own
    made = compressed(own, 46.0, tmp_path / "kept")
    with av.open(str(made / f"{camera.id}.mp4")) as file:
        shapes = [frame.to_ndarray(format="bgr24").shape for frame in file.decode(video=0)]
    assert shapes == [(48, 64, 3)] * 6
    assert kbit_per_s(made) < kbit_per_s(own) / 3
    assert {path.name for path in made.iterdir()} == {path.name for path in own.iterdir()}


def test_the_evaluations_page_shows_the_curves_and_what_they_say(tmp_path):
    own = truth({"no_hat": [Stretch(2.0, 4.0)]})
    rows = [RowResult(row, (np.repeat(own.active[None], len(row.uses), axis=0),)) for row in rows_of((True,) * 4)]
    found = document_of(ViolationEvaluation((own,), rules(), tuple(rows)), ("cam0", "cam1", "cam2", "cam3"))
    found |= {"split": "validation", "networks": [], "views": ["cam0", "cam1", "cam2", "cam3"], "recordings": {}}
    (tmp_path / "study.svg").write_text(study_plot(list(curves_of([line(0.0, "a", 9, 1), line(5.0, "a", 9, 1)])), AXES))
    (tmp_path / "study.txt").write_text("a gate < 20 mm stays\n")
    write_page(found, [], tmp_path / "index.html", study=read_study(tmp_path))
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "cameras displaced</text>" in page
    assert "a gate &lt; 20 mm stays" in page
    write_page(found, [], tmp_path / "index.html")
    assert "<svg xmlns" not in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_a_truth_becomes_a_walk_whose_steps_end_before_the_next_border():
    violations = [
        {"kind": kind, "start_s": a, "end_s": b} for kind, a, b in (("ladder", 3.0, 8.0), ("no_hat", 5.0, 8.4))
    ]
    walk = walk_of("x", {"instants_s": [0.0, 0.2, 12.0], "violations": violations})
    assert [(step.violates, step.prepare_s, step.seconds) for step in walk.steps] == [
        ((), 0.0, 2.5),
        (("ladder",), 0.5, 1.5),
        (("no_hat", "ladder"), 0.5, 2.5),
        ((), pytest.approx(0.9), pytest.approx(3.6)),
    ]
    assert all(step.about == ("no_hat", "ladder") for step in walk.steps)
