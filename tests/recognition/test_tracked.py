"""The tracked method as a whole: simulated sites through the placer, where it is known who is where."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recognition.feeds import instants_of_detections
from recognition.metrics import Truth, score
from recognition.observations import FrameSet, Instant, Scene, ViewDetections
from recognition.observed import DetectorModel
from recognition.observed import observe as observe_views
from recognition.optics import Optics
from recognition.placing import Placer, PlacingOptions, place_smoothed
from recognition.poses import Poses
from recognition.sources.detections_file import read_detections
from recognition.synthetic import Site, semicircle_rig, simulate
from recognition.synthetic_crowds import crowd
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from recognition.tracking.options import FollowOptions
from recognition.tracking.population import Population
from recognition.tracking.things import Heads, Things, find
from rigcal.camera import Camera
from rigcal.errors import OptionError
from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig, RigCamera

RIG = semicircle_rig(4)
CAPTURE = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "recognition" / "pose2sim_multi"
NOISE = DetectorNoise(pixel_sigma=3.0, missing_joint=0.1)


def views_of(site: Site, frame: int, noise: DetectorNoise = NOISE) -> list[ViewDetections]:
    return [v.detections for v in with_noise(observe(site, frame), site.rig, noise, seed=[3, frame])]


def without_people(view: ViewDetections, people=()) -> ViewDetections:
    """The view with some of its people only."""
    rows = list(people)
    return replace(view, people_px=view.people_px[rows], people_score=view.people_score[rows])


def without_objects(view: ViewDetections) -> ViewDetections:
    return ViewDetections(view.people_px, view.people_score, (), np.zeros((0, 4)), np.zeros(0))


def instants(views, step_s=1 / 30, **times) -> list[Instant]:
    """Instants of (F, V) views."""
    return [
        Instant(FrameSet(f, round((f + 1) * step_s * 1e9), (None,) * len(v), **times), tuple(v))
        for f, v in enumerate(views)
    ]


def placed(rig, run, **options) -> list[Scene]:
    placer = Placer(rig, PlacingOptions(follow=FollowOptions(**options)))
    return [scene for instant in run if (scene := placer.place(instant))]


def ids(scenes):
    return [[worker.track_id for worker in scene.workers] for scene in scenes]


def errors_m(site: Site, scene: Scene, frame: int):
    """Mean distance of each worker from the nearest true one."""
    truth = site.rig.world_from_rig.inverse().apply(site.joints_in_world_m[frame])
    return [np.nanmean(np.linalg.norm(truth - w.joints_m, axis=-1), axis=1).min() for w in scene.workers]


@pytest.fixture(scope="module")
def walk():
    """A worker for six seconds, as noisy views."""
    site = simulate(RIG, workers=1, frames=150, fps=25.0, seed=4)
    return site, [[without_objects(v) for v in views_of(site, f)] for f in range(150)]


def test_workers_are_placed_and_keep_their_identities():
    site = simulate(RIG, workers=3, frames=30, seed=1)
    scenes = placed(RIG, instants([views_of(site, f) for f in range(30)]))
    assert ids(scenes)[2:] == [[1, 2, 3]] * 28
    for frame, scene in enumerate(scenes):
        assert max(errors_m(site, scene, frame), default=0) < 0.04
        for worker in scene.workers:
            assert worker.members.min() >= 0


def test_covariances_are_stated_where_joints_are_and_hold_most_errors(walk):
    site, views = walk
    scene = placed(RIG, instants(views[:40], 1 / 25))[-1]
    (worker,) = scene.workers
    known = np.isfinite(worker.joints_m[:, 0])
    assert (np.isfinite(worker.covariance_m2).all(axis=(1, 2)) == known).all()
    off = worker.joints_m - RIG.world_from_rig.inverse().apply(site.joints_in_world_m[39, 0])
    square = np.einsum("ji,jik,jk->j", off[known], np.linalg.inv(worker.covariance_m2[known]), off[known])
    assert np.median(square) < 6.0  # three degrees of freedom: half are below 2.4, 89 of 100 below 6


def test_same_instants_give_the_same_scenes_to_the_last_bit():
    made = crowd(4, seconds=1.0, seed=2)
    first, second = (placed(made.site.rig, made.instants) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        assert ids([one]) == ids([other])
        for a, b in zip((*one.workers, *one.objects), (*other.workers, *other.objects), strict=True):
            assert a.members.tobytes() == b.members.tobytes()
            assert a.covariance_m2.tobytes() == b.covariance_m2.tobytes()
        assert [w.joints_m.tobytes() for w in one.workers] == [w.joints_m.tobytes() for w in other.workers]


def test_an_identity_outlives_an_occlusion_of_two_seconds(walk):
    _, views = walk
    hidden = [[without_people(v) for v in row] if 50 <= f < 100 else row for f, row in enumerate(views)]
    scenes = placed(RIG, instants(hidden, 1 / 25))
    assert ids(scenes)[40] == ids(scenes)[-1] == [1]
    assert ids(scenes)[75] == []


def test_after_three_seconds_somebody_new_comes(walk):
    _, views = walk
    hidden = [[without_people(v) for v in row] if 50 <= f < 130 else row for f, row in enumerate(views)]
    assert ids(placed(RIG, instants(hidden, 1 / 25)))[-1] == [2]


def test_what_is_not_seen_is_carried_for_a_short_time_with_growing_covariance(walk):
    _, views = walk
    hidden = [[without_people(v) for v in row] if f >= 50 else row for f, row in enumerate(views)]
    scenes = placed(RIG, instants(hidden, 1 / 25))
    carried = [scene.workers[0] for scene in scenes[50:56]]
    assert all((worker.views == 0).all() and (worker.members == -1).all() for worker in carried)
    spread = [np.nanmean(np.trace(worker.covariance_m2, axis1=1, axis2=2)) for worker in carried]
    assert (np.diff(spread) > 0).all()
    assert ids(scenes)[50 + 14] == []  # more than half a second


def test_a_wrist_that_is_hidden_for_a_while_stays_at_its_elbow(walk):
    site, views = walk

    def hide(view):
        px, score_ = view.people_px.copy(), view.people_score.copy()
        px[:, 9], score_[:, 9] = np.nan, 0.0
        return replace(view, people_px=px, people_score=score_)

    hidden = [[hide(v) for v in row] if f >= 60 else row for f, row in enumerate(views)]
    scenes = placed(RIG, instants(hidden, 1 / 25))
    for frame in range(60, 70):
        (worker,) = scenes[frame].workers
        true = np.linalg.norm(site.joints_in_world_m[frame, 0, 9] - site.joints_in_world_m[frame, 0, 7])
        assert worker.views[9] == 0
        assert np.linalg.norm(worker.joints_m[9] - worker.joints_m[7]) == pytest.approx(true, abs=0.08)
    assert np.isnan(scenes[80].workers[0].joints_m[9]).all()


def test_one_camera_alone_keeps_an_identity_but_tells_nobody_for_long(walk):
    _, views = walk
    alone = [[v if i == 1 else without_people(v) for i, v in enumerate(row)] if 50 <= f < 90 else row
             for f, row in enumerate(views)]  # fmt: skip
    scenes = placed(RIG, instants(alone, 1 / 25))
    assert ids(scenes)[80] == []
    assert ids(scenes)[-1] == [1]


def test_somebody_beside_a_worker_is_found_although_that_worker_might_be_meant():
    """Two cameras see somebody come; from one of them the worker 0.6 m away is hidden, so that its track would claim
    the newcomer there at every instant, and leave the other view alone."""
    both = simulate(RIG, workers=2, frames=20, fps=5.0, seed=0)
    first = both.joints_in_world_m[:, :1]
    site = replace(both, joints_in_world_m=np.concatenate([first, first + [0.0, 0.6, 0.0]], axis=1))
    seen_in = {0: [0, 1], 1: [0], 2: [0], 3: [1]}
    views = []
    for frame in range(20):
        labelled = with_noise(observe(site, frame), RIG, NOISE, seed=[3, frame])
        shown = [seen_in[n] if frame >= 10 else [0] for n in range(4)]
        views.append([
            without_people(without_objects(v.detections), np.flatnonzero(np.isin(v.worker_idx, who)))
            for v, who in zip(labelled, shown, strict=True)
        ])  # fmt: skip
    scenes = placed(RIG, instants(views, 1 / 5))
    assert ids(scenes)[1:] == [[1]] * 11 + [[1, 2]] * 8
    assert max(errors_m(site, scenes[-1], 19)) < 0.06
    assert [int(member >= 0) for member in scenes[-1].workers[1].members] == [1, 0, 0, 1]


def hinted(row, sure=()):
    """The views of an instant with everybody a hint, but in some of them."""
    return [v if n in sure else replace(v, hints=np.arange(len(v.people_px))) for n, v in enumerate(row)]


def test_whom_one_camera_sees_for_sure_is_placed_with_the_hints_of_others(walk):
    site, views = walk
    weak = [hinted(row, sure=[f // 40 % 4]) for f, row in enumerate(views)]
    scenes = placed(RIG, instants(weak, 1 / 25))
    assert ids(scenes)[1:] == [[1]] * 149
    assert max(errors_m(site, scenes[-1], 149)) < 0.04
    assert scenes[-1].workers[0].members.tolist() == [0, 0, 0, 0]


def test_hints_alone_are_nobody(walk):
    _, views = walk
    scenes = placed(RIG, instants([hinted(row) for row in views], 1 / 25))
    assert not any(ids(scenes))


def test_hints_alone_keep_an_identity_but_tell_nobody_for_long(walk):
    _, views = walk
    weak = [hinted(row) if 50 <= f < 90 else row for f, row in enumerate(views)]
    scenes = placed(RIG, instants(weak, 1 / 25))
    assert ids(scenes)[60] == [1]
    assert ids(scenes)[80] == []
    assert ids(scenes)[-1] == [1]


def test_false_people_of_single_views_are_nobody():
    site = simulate(RIG, workers=1, frames=40, seed=3)
    noise = replace(NOISE, false_per_view=1.0)
    scenes = placed(RIG, instants([views_of(site, f, noise) for f in range(40)]))
    assert {i for row in ids(scenes) for i in row} == {1}


def test_two_cameras_are_enough():
    pair = Rig(RIG.site, RIG.cameras[:2], "cam0", "PASS", world_from_rig=RIG.world_from_rig)
    site = simulate(pair, workers=2, frames=30, seed=6)
    scenes = placed(pair, instants([views_of(site, f) for f in range(30)]))
    assert ids(scenes)[-1] == [1, 2]
    assert max(errors_m(site, scenes[-1], 29)) < 0.08


def test_a_rig_without_a_world_places_the_same(walk):
    _, views = walk
    run = instants(views[:20], 1 / 25)
    free = placed(replace(RIG, world_from_rig=None), run)
    for one, other in zip(placed(RIG, run)[3:], free[3:], strict=True):
        np.testing.assert_array_equal(one.workers[0].joints_m, other.workers[0].joints_m)


def test_fisheye_cameras_are_followed_as_others_are():
    lens = Camera("fisheye4", (1600, 1200), np.array([620.0, 620.0, 799.5, 599.5, 0.02, -0.01, 0.003, -0.001]))
    rig = replace(RIG, cameras=tuple(replace(mounted, camera=lens) for mounted in RIG.cameras))
    site = simulate(rig, workers=2, frames=15, seed=6)
    scenes = placed(rig, instants([views_of(site, f) for f in range(15)]))
    assert ids(scenes)[-1] == [1, 2]
    assert max(errors_m(site, scenes[-1], 14)) < 0.08


@pytest.mark.parametrize("fps", [5.0, 60.0])
def test_slow_and_fast_cameras_are_followed_by_the_same_options(fps):
    site = simulate(RIG, workers=3, frames=40, fps=fps, seed=5, crossing=True)
    scenes = placed(RIG, instants([views_of(site, f) for f in range(40)], 1 / fps))
    assert {i for row in ids(scenes) for i in row} == {1, 2, 3}


def test_cameras_that_are_not_triggered_together_are_placed_at_the_common_time():
    fine = simulate(RIG, workers=1, frames=400, fps=400.0, seed=8)
    late, error = (0, 5, -4, 3), {}
    for told in (True, False):
        run = []
        for number, frame in enumerate(range(20, 380, 16)):
            seen = [without_objects(views_of(fine, frame + late[v], DetectorNoise())[v]) for v in range(4)]
            t_ns = int(fine.t_ns[frame])
            times = tuple(int(fine.t_ns[frame + late[v]]) for v in range(4)) if told else ()
            run.append(Instant(FrameSet(number, t_ns, (None,) * 4, times), tuple(seen)))
        scene = placed(RIG, run)[-1]
        error[told] = errors_m(fine, scene, 20 + 16 * (len(run) - 1))[0]
    assert error[True] < 0.6 * error[False]


def test_a_camera_without_exact_clock_makes_moving_joints_less_certain(walk):
    _, views = walk
    clock = ClockModel(0.0, 0.0, "2026-11-22T00:00:00+00:00", 0.02, 0.0, "probe")
    doubtful = replace(RIG, cameras=tuple(replace(c, clock=clock) for c in RIG.cameras))
    run = instants(views[:40], 1 / 25)
    exact, late = placed(RIG, run)[-1].workers[0], placed(doubtful, run)[-1].workers[0]
    np.testing.assert_array_equal(exact.joints_m, late.joints_m)
    known = np.isfinite(exact.joints_m[:, 0])
    grown = np.trace((late.covariance_m2 - exact.covariance_m2)[known], axis1=1, axis2=2)
    assert (grown > 0).all()
    assert 0.002 < np.sqrt(np.median(grown)) < 0.03  # some 1 m/s for 20 ms


def test_hats_keep_the_identity_of_their_wearers():
    site = simulate(RIG, workers=3, frames=60, seed=7, crossing=True)
    scenes = placed(RIG, instants([views_of(site, f) for f in range(60)]))
    true = RIG.world_from_rig.inverse().apply(site.object_centre_in_world_m)
    worn: dict[int, set[int]] = {}
    for frame, scene in enumerate(scenes[5:], 5):
        hats = [thing for thing in scene.objects if thing.object_class == "hard_hat"]
        assert len(hats) == 3
        for hat in hats:
            away = np.linalg.norm(true[frame, :3] - hat.centre_m, axis=1)
            assert away.min() < 0.1
            worn.setdefault(hat.track_id, set()).add(int(away.argmin()))
    assert sorted(map(len, worn.values())) == [1, 1, 1]


def bare(view):
    """The view without its hats."""
    kept = [k for k, name in enumerate(view.object_class) if name != "hard_hat"]
    return replace(
        view, object_class=tuple(view.object_class[k] for k in kept), object_xyxy=view.object_xyxy[kept],
        object_score=view.object_score[kept], object_keypoints_px=view.object_keypoints_px[kept],
    )  # fmt: skip


def scored(view: ViewDetections, score: float) -> ViewDetections:
    """The view, its objects as sure as this."""
    return replace(view, object_score=np.full(len(view.object_class), score))


@pytest.mark.parametrize(
    ("cameras", "with_hat", "score", "told"),
    [
        (4, 2, 0.6, [2]), (3, 2, 0.6, [2]), (2, 2, 0.6, [2]), (2, 1, 0.6, [1]), (3, 1, 0.69, []), (4, 1, 0.69, []),
        (3, 1, 0.71, [1]), (4, 1, 0.71, [1]),
    ],
)  # fmt: skip
def test_a_hat_is_told_soon_unless_cameras_that_see_the_head_outvote_one_that_is_not_sure(
    cameras, with_hat, score, told
):
    site = simulate(RIG, workers=1, frames=34, seed=7)
    views = [
        [
            ViewDetections.empty() if v >= cameras else bare(view) if f < 30 or v >= with_hat else scored(view, score)
            for v, view in enumerate(views_of(site, f))
        ]
        for f in range(34)
    ]
    scenes = placed(RIG, instants(views))
    hats = [[thing.views for thing in scene.objects if thing.object_class == "hard_hat"] for scene in scenes]
    assert hats[29] == []
    assert hats[33] == told


def test_a_hat_that_is_not_detected_goes_with_its_head():
    site = simulate(RIG, workers=1, frames=60, seed=7)
    views = [[bare(v) if 20 <= f < 50 else v for v in views_of(site, f)] for f in range(60)]
    scenes = placed(RIG, instants(views))
    hats = [[t for t in scene.objects if t.object_class == "hard_hat"] for scene in scenes]
    assert hats[30][0].views == 0
    assert hats[15][0].track_id == hats[30][0].track_id == hats[-1][0].track_id
    true = RIG.world_from_rig.inverse().apply(site.object_centre_in_world_m[30, 0])
    assert np.linalg.norm(hats[30][0].centre_m - true) < 0.08


@pytest.mark.parametrize(("placed_ns", "claims"), [((2, 1), False), ((2, 2), True)])
def test_a_second_hat_of_a_head_claims_nothing_once_it_is_placed_no_more(placed_ns, claims):
    """It goes where the head goes, and the box that it would claim is the hat of whoever stands behind."""
    optics, hat_m, second_m = Optics.of(RIG), np.array([0.0, 0.0, 1.72]), np.array([1.0, 0.0, 1.72])
    box = np.array([-12.0, -8.0, 12.0, 8.0]) + np.tile(RIG.cameras[0].camera.project(
        RIG.cameras[0].cam_from_rig.apply(RIG.world_from_rig.inverse().apply(second_m[None])))[0], 2)  # fmt: skip
    nobody = np.zeros((0, 17, 2)), np.zeros((0, 17))
    views = [ViewDetections(*nobody, ("hard_hat",), box[None], np.array([0.9]))] + [ViewDetections.empty()] * 3
    boxes = observe_views(optics, views, {"hard_hat": 0}, DetectorModel(), keypoints=False)[1]
    in_rig = RIG.world_from_rig.inverse().apply(np.stack([hat_m, second_m]))
    hats = Population.at(in_rig[:, None], np.zeros(2, dtype=np.int64))
    hats = replace(hats, track_id=np.array([3, 5]), placed_ns=np.array(placed_ns))
    hats.motion.variance[:] = 1e-4
    things = replace(Things.new(hats), owner=np.array([7, 7]))
    head = Heads(
        np.array([7]), in_rig[:1], in_rig[:1], np.array([1e-4]), np.array([0]), np.ones((1, 1, 17)) / 17, np.array([4])
    )
    _, members = find(optics, things, head, boxes, np.array([0]), FollowOptions(), 3)
    assert members.tolist() == [[-1] * 4, [0 if claims else -1, -1, -1, -1]]


def test_several_objects_of_a_class_are_told_apart_and_have_sizes():
    site = simulate(RIG, workers=1, frames=10, seed=2)
    scene = placed(RIG, instants([views_of(site, f) for f in range(10)]))[-1]
    windows = [thing for thing in scene.objects if thing.object_class == "small_window"]
    assert len(windows) == site.object_class.count("small_window")
    bucket = next(thing for thing in scene.objects if thing.object_class == "bucket")
    assert bucket.size_m[1] == pytest.approx(0.35, abs=0.15)
    assert np.isnan(bucket.keypoints_m).all()


def test_keypoints_give_the_extent_of_an_object():
    corners = np.array([[-0.2, 1.0, 0.0], [0.3, 1.0, 0.0], [0.3, 1.0, 2.0], [-0.2, 1.0, 2.0]])
    in_rig = RIG.world_from_rig.inverse().apply(corners)
    views = []
    for mounted in RIG.cameras:
        px = mounted.camera.project(mounted.cam_from_rig.apply(in_rig))
        box = np.concatenate([px.min(axis=0), px.max(axis=0)])[None]
        views.append(ViewDetections(np.zeros((0, 17, 2)), np.zeros((0, 17)), ("ladder",), box, np.ones(1), px[None]))
    blind = [replace(view, object_keypoints_px=np.full((1, 4, 2), np.nan)) for view in views]
    scenes = placed(RIG, instants([blind] * 3 + [views] * 6 + [blind] * 3))
    (ladder,) = scenes[8].objects
    np.testing.assert_allclose(ladder.keypoints_m, in_rig, atol=0.02)
    (before,), (after,) = scenes[2].objects, scenes[-1].objects
    assert np.isnan(before.keypoints_m).all()
    np.testing.assert_allclose(after.keypoints_m, in_rig, atol=0.03)
    assert before.track_id == after.track_id


def test_crowds_are_followed_as_if_the_association_were_given():
    """Bars of the crowd bench, on less of it."""
    made = crowd(4, seconds=2.0, seed=5)
    poses = Poses.of(placed(made.site.rig, made.instants), made.site.rig.world_from_rig)
    result = score(made.truth, poses, period_s=1 / 30)
    given = [Poses.of(placed(made.site.rig, made.alone(w)), made.site.rig.world_from_rig) for w in range(4)]
    whole = [np.concatenate([getattr(p, name) for p in given]) for name in ("frame", "t_ns", "joints_m", "views")]
    own = np.concatenate([np.full(len(p.frame), w) for w, p in enumerate(given)])
    best = score(made.truth, Poses(whole[0], whole[1], own, *whole[2:]), period_s=1 / 30)
    assert result.pcp3d >= best.pcp3d - 0.01
    assert result.switches == 0
    assert result.idf1 >= 0.95


def test_smoothing_closes_gaps_and_comes_nearer_to_the_truth(walk):
    site, views = walk
    hidden = [[without_people(v) for v in row] if 60 <= f < 75 else row for f, row in enumerate(views)]
    run = instants(hidden, 1 / 25)
    plain, smooth = placed(RIG, run), list(place_smoothed(RIG, run))
    assert [scene.index for scene in smooth] == [scene.index for scene in plain]
    assert all(worker.track_id == 1 for scene in smooth for worker in scene.workers)
    assert all(scene.workers for scene in smooth[2:])
    errors = {}
    for name, scenes in (("plain", plain), ("smooth", smooth)):
        poses = Poses.of(scenes, RIG.world_from_rig)
        errors[name] = score(Truth.of(site.joints_in_world_m), poses, period_s=1 / 25).mpjpe_m
    assert errors["smooth"] < 0.85 * errors["plain"]
    (worker,) = smooth[67].workers
    assert (worker.views == 0).all()
    assert errors_m(site, smooth[67], 67)[0] < 0.15


def test_smoothing_a_long_run_piece_by_piece_changes_nothing_that_matters(walk):
    _, views = walk
    run = instants((views * 2)[:250], 1 / 25)
    whole = list(place_smoothed(RIG, run))
    assert [scene.index for scene in whole] == list(range(250))
    short = list(place_smoothed(RIG, run[:110]))
    np.testing.assert_allclose(whole[10].workers[0].joints_m, short[10].workers[0].joints_m, atol=1e-6)


def test_the_method_of_the_paper_is_not_smoothed(walk):
    with pytest.raises(OptionError, match="method"):
        place_smoothed(RIG, instants(walk[1][:3]), PlacingOptions("paper"))


def test_instants_of_one_camera_or_of_the_past_place_nothing(walk):
    _, views = walk
    placer = Placer(RIG)
    alone = Instant(FrameSet(0, 10, (None,) * 4, (10, None, None, None)), tuple(views[0]))
    assert placer.place(alone) is None
    both = Instant(FrameSet(1, 20, (None,) * 4, (20, 20, None, None)), tuple(views[0]))
    assert placer.place(both) is not None
    assert placer.place(both) is None


@pytest.mark.parametrize("name", ["claim_sigmas", "keep_s", "start_worker"])
def test_options_outside_their_range_are_refused(name):
    with pytest.raises(OptionError, match=name):
        FollowOptions(**{name: -1})


@pytest.fixture(scope="module")
def capture():
    """The rig and the instants of the shared multi-person capture."""
    if not CAPTURE.exists():
        pytest.skip("the shared capture pose2sim_multi is not here")
    import json

    document = json.loads((CAPTURE / "dataset.json").read_text())
    mounted = [
        (c["name"], Camera.from_matrix("opencv5", tuple(c["image_size"]), c["K"], c["dist"]),
         Pose(np.array(c["R"]), np.array(c["t"]))) for c in document["cameras"]
    ]  # fmt: skip
    rig_from_world = mounted[0][2]
    cameras = tuple(
        RigCamera(name, lens, Pose.identity() if i == 0 else pose @ rig_from_world.inverse())
        for i, (name, lens, pose) in enumerate(mounted)
    )
    rig = Rig("pose2sim", cameras, cameras[0].id, "IMPORTED", world_from_rig=rig_from_world.inverse())
    return rig, list(instants_of_detections(read_detections(CAPTURE / "data.npz", rig), fps=60, use=[True] * 4))


def test_real_people_are_tracked_with_one_identity_each_and_steady_limbs(capture):
    rig, run = capture
    scenes = placed(rig, run)
    several = {}
    for scene in scenes:
        for worker in scene.workers:
            several.setdefault(worker.track_id, []).append(worker)
    assert len(several) == 3
    by_two = sorted(sum((w.members >= 0).sum() >= 2 for w in seen) for seen in several.values())
    assert by_two[0] >= 80  # the bystander, whom two cameras see
    assert by_two[1] >= 98  # measured: 95, 99, 100
    for seen in several.values():
        joints = np.array([worker.joints_m for worker in seen])
        for left, right in (((5, 7), (6, 8)), ((7, 9), (8, 10)), ((11, 13), (12, 14)), ((13, 15), (14, 16))):
            lengths = [np.linalg.norm(joints[:, a] - joints[:, b], axis=1) for a, b in (left, right)]
            lengths = [length[np.isfinite(length)] for length in lengths]
            middle = [np.median(length) for length in lengths if len(length)]
            assert all(np.median(np.abs(x - np.median(x))) < 0.015 for x in lengths if len(x))
            assert len(middle) < 2 or abs(middle[0] - middle[1]) < 0.1 * max(middle)
