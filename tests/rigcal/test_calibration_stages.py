"""Lenses, pairs, chain and joint solve on rigs whose truth is known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigcal.board import Charuco, Checkerboard
from rigcal.boardpose import board_poses
from rigcal.camera import MODELS
from rigcal.detections import BoardView
from rigcal.errors import CalibrationError, ImageSizeError, NotConnectedError, OptionError, TooFewViewsError
from rigcal.geometry import Pose
from rigcal.graph import chain_to_reference
from rigcal.intrinsics import IntrinsicsOptions, calibrate_camera, choose_model, hold_camera
from rigcal.order import corner_orders, reordered
from rigcal.pairwise import PairPose, Pairs, PairwiseOptions, solve_pair
from rigcal.pipeline import CalibrateOptions, calibrate_lenses, calibrate_site
from rigcal.refine import RefineOptions, refine_rig
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig, board_poses_for_camera, board_poses_for_pair, exact_detections, with_noise

BOARD = Checkerboard(9, 6, 0.06)


def capture(cameras=3, *, board=BOARD, model="opencv5", shared=8, single=6, noise_px=0.2, seed=0):
    """A rig on an arc and the detections of boards that only neighbours share."""
    rig = arc_rig(cameras, model=model, arc_deg=45.0 * (cameras - 1), seed=seed)
    ids = rig.camera_ids
    poses, seen = [], []
    for index, (one, two) in enumerate(pairwise(ids)):
        poses += board_poses_for_pair(rig, one, two, board, shared, distance_m=(1.5, 5), seed=seed + index)
        seen += [(one, two)] * shared
    for index, one in enumerate(ids):
        poses += board_poses_for_camera(rig, one, board, single, distance_m=(0.7, 2.2), seed=seed + 50 + index)
        seen += [(one,)] * single
    exact = exact_detections(rig, board, poses, seen_by=seen)
    return rig, with_noise(exact, noise_px, seed=seed + 99)


def assert_pose_close(found: Pose, expected: Pose, *, max_deg: float, max_m: float):
    gap = found @ expected.inverse()
    assert np.rad2deg(gap.angle_rad) <= max_deg
    assert np.linalg.norm(found.inverse().translation_m - expected.inverse().translation_m) <= max_m


def spoiled(detections, camera, frame_idx, change):
    """The detections with one view changed."""
    cameras = list(detections.cameras)
    views = tuple(change(v) if v.frame_idx == frame_idx else v for v in cameras[camera].views)
    cameras[camera] = replace(cameras[camera], views=views)
    return replace(detections, cameras=tuple(cameras))


# --- one camera -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_a_lens_is_found_without_a_guess(model):
    """Within 0.5 % of the focal length from 14 views with 0.2 px noise (measured: 0.11 % at the most)."""
    rig, detections = capture(2, model=model)
    result = calibrate_camera(detections.cameras[0], BOARD, IntrinsicsOptions(model))
    true = rig.cameras[0].camera
    assert np.abs(result.camera.params[:2] / true.params[:2] - 1).max() < 0.005
    assert 0.2 < result.rmse_px < 0.32
    assert (result.sigma > 0).all()


@pytest.mark.parametrize("model", MODELS)
def test_a_lens_is_exact_without_noise(model):
    rig, detections = capture(2, model=model, noise_px=0.0)
    result = calibrate_camera(detections.cameras[0], BOARD, IntrinsicsOptions(model))
    pixels = np.array([[300.0, 200.0], [1500.0, 900.0], [960.0, 540.0]])
    assert np.abs(result.camera.undistort(pixels) - rig.cameras[0].camera.undistort(pixels)).max() < 1e-6


@pytest.mark.parametrize(
    ("model", "chosen"), [("opencv4", "opencv5"), ("opencv8", "opencv5"), ("fisheye4", "fisheye4")]
)
def test_the_model_is_chosen_by_views_kept_out(model, chosen):
    _, detections = capture(2, model=model)
    assert choose_model(detections.cameras[0], BOARD, IntrinsicsOptions()) == chosen


def test_with_few_views_the_ordinary_model_is_kept():
    _, detections = capture(2, model="fisheye4")
    few = replace(detections.cameras[0], views=detections.cameras[0].views[:4])
    assert choose_model(few, BOARD, IntrinsicsOptions()) == "opencv5"


def test_a_bad_view_is_named_and_does_not_harm_the_lens():
    _, detections = capture(2)
    clean = calibrate_camera(detections.cameras[0], BOARD, IntrinsicsOptions())
    rng = np.random.default_rng(0)
    victim = detections.cameras[0].views[4].frame_idx
    bad = spoiled(
        detections, 0, victim, lambda v: replace(v, corners_px=v.corners_px + rng.normal(0, 8, v.corners_px.shape))
    )
    result = calibrate_camera(bad.cameras[0], BOARD, IntrinsicsOptions())
    assert [(f.frame, f.action) for f in result.findings] == [(f"{victim:06d}", "dropped")]
    assert np.abs(result.camera.params[:2] - clean.camera.params[:2]).max() < 4 * result.sigma[:2].max()
    assert len(result.views) == len(clean.views) - 1


def test_too_few_views_are_refused_with_what_to_do():
    _, detections = capture(2)
    camera = replace(detections.cameras[0], views=detections.cameras[0].views[:2])
    with pytest.raises(TooFewViewsError) as caught:
        calibrate_camera(camera, BOARD, IntrinsicsOptions())
    message = str(caught.value)
    assert "camera cam0 has too few board views" in message
    assert "got:      2 usable views" in message
    assert "do next:  show the board to cam0 at several distances" in message


def test_options_outside_their_range_are_refused():
    with pytest.raises(OptionError, match="option model is out of range"):
        IntrinsicsOptions("pinhole")
    with pytest.raises(OptionError, match="option min_corners is out of range"):
        IntrinsicsOptions(min_corners=3)
    with pytest.raises(OptionError, match="option model is out of range"):
        CalibrateOptions("pinhole")


def test_a_lens_of_another_image_size_is_refused():
    rig, detections = capture(2)
    camera = replace(detections.cameras[0], size_wh=(1280, 720))
    with pytest.raises(ImageSizeError) as caught:
        hold_camera(camera, BOARD, rig.cameras[0].camera, 0.2, IntrinsicsOptions())
    assert "camera cam0 has images of another size" in str(caught.value)
    assert "1920x1080 px" in str(caught.value)
    assert "1280x720 px" in str(caught.value)


def test_the_planar_ambiguity_gives_both_poses_best_first():
    rig, detections = capture(2, noise_px=0.0)
    view = detections.cameras[0].views[0]
    found = board_poses(rig.cameras[0].camera, BOARD.corners_in_board, view)
    assert 1 <= len(found) <= 2
    assert found[0].rmse_px < 1e-6
    assert [c.rmse_px for c in found] == sorted(c.rmse_px for c in found)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("tilt_deg", [(0, 0, 0), (35, 0, 0), (0, 35, 0), (-20, 10, 150)])
def test_a_board_is_placed_exactly_from_its_front_and_from_its_back(tilt_deg, side):
    camera = arc_rig(1).cameras[0].camera
    turn = Rotation.from_euler("xyz", tilt_deg, degrees=True).as_matrix() @ np.diag([side, 1.0, side])
    true = Pose(turn, np.array([0.1, -0.1, 2.0]))
    view = BoardView(0, np.arange(54), camera.project(true.apply(BOARD.corners_in_board)))
    best = board_poses(camera, BOARD.corners_in_board, view)[0]
    assert_pose_close(best.cam_from_board, true, max_deg=1e-5, max_m=1e-6)


def test_collinear_corners_have_no_pose():
    rig, detections = capture(2, noise_px=0.0)
    view = detections.cameras[0].views[0]
    row = BoardView(view.frame_idx, view.corner_ids[:9], view.corners_px[:9])
    assert all(c.rmse_px < 1 for c in board_poses(rig.cameras[0].camera, BOARD.corners_in_board, row))
    assert (
        board_poses(
            rig.cameras[0].camera, BOARD.corners_in_board, replace(view, corner_ids=[0, 1], corners_px=np.zeros((2, 2)))
        )
        == ()
    )


@pytest.mark.parametrize(("wrong", "named"), [([], []), ([2, 4], ["000002", "000004"]), ([2, 4, 5], [])])
def test_a_few_views_that_bend_the_lens_are_named_and_many_are_the_lens_model(wrong, named):
    """Shifted views whose boards no other camera saw: a pose explains each of them, at the lens's expense."""
    rig = arc_rig(1, model="opencv4")
    poses = board_poses_for_camera(rig, "cam0", BOARD, 40, distance_m=(0.7, 2.2), seed=3)
    detections = with_noise(exact_detections(rig, BOARD, poses), 0.2, seed=4)
    for frame in wrong:
        detections = spoiled(detections, 0, frame, lambda v: replace(v, corners_px=v.corners_px + [25.0, -20.0]))
    result = calibrate_camera(detections.cameras[0], BOARD, IntrinsicsOptions("opencv4"))
    assert [finding.frame for finding in result.findings] == named
    assert all("pulls at the cameras" in finding.reason for finding in result.findings)


# --- pairs ----------------------------------------------------------------------------------------------------------


def shared_views(detections, first, second):
    """(instant, view, view) where both cameras see the board; instants are frame numbers here."""
    at = [{view.frame_idx: view for view in detections.cameras[c].views} for c in (first, second)]
    return [(frame, at[0][frame], at[1][frame]) for frame in sorted(at[0].keys() & at[1].keys())]


def pair_of(rig, detections, *, options=None):
    lenses = (rig.cameras[0].camera, rig.cameras[1].camera)
    return solve_pair(detections.board, lenses, shared_views(detections, 0, 1), (0, 1), options or PairwiseOptions())


def test_a_pair_is_exact_without_noise():
    rig, detections = capture(2, noise_px=0.0)
    pair = pair_of(rig, detections)
    assert_pose_close(pair.second_from_first, rig.cameras[1].cam_from_rig, max_deg=1e-5, max_m=1e-6)
    assert pair.views == 8


def test_a_pair_and_its_inverse_say_the_same():
    rig, detections = capture(2)
    pair = pair_of(rig, detections)
    back = pair.inverse().inverse()
    assert np.allclose(back.second_from_first.matrix, pair.second_from_first.matrix)
    assert np.allclose(back.covariance, pair.covariance)
    assert (pair.inverse().first, pair.inverse().second) == (1, 0)


@pytest.mark.parametrize("board", [BOARD, Checkerboard(8, 6, 0.06)])
def test_turned_corner_orders_are_found_by_consensus(board):
    rig, detections = capture(2, board=board)
    victims = [view.frame_idx for view in detections.cameras[1].views[:2]]
    for victim in victims:
        detections = spoiled(detections, 1, victim, lambda v: reordered(v, corner_orders(board)[1]))
    pair = pair_of(rig, detections)
    assert sorted(pair.turned) == sorted(victims)
    assert pair.rmse_px < 0.35
    assert_pose_close(pair.second_from_first, rig.cameras[1].cam_from_rig, max_deg=0.5, max_m=0.05)


def test_one_shared_view_is_no_pair():
    rig, detections = capture(2)
    one = shared_views(detections, 0, 1)[:1]
    assert solve_pair(BOARD, (rig.cameras[0].camera, rig.cameras[1].camera), one, (0, 1), PairwiseOptions()) is None


def test_partial_charuco_boards_are_shared_by_corner():
    board = Charuco(7, 5, 0.08)
    rig, detections = capture(2, board=board, noise_px=0.0)
    for frame, keep in ((0, slice(0, 16)), (1, slice(8, 24))):
        detections = spoiled(
            detections, 1, frame, lambda v, k=keep: BoardView(v.frame_idx, v.corner_ids[k], v.corners_px[k])
        )
    pair = pair_of(rig, detections)
    assert_pose_close(pair.second_from_first, rig.cameras[1].cam_from_rig, max_deg=1e-5, max_m=1e-6)


# --- chain ----------------------------------------------------------------------------------------------------------


def made_pair(first, second, x_m, sigma):
    pose = Pose(np.eye(3), np.array([x_m, 0.0, 0.0]))
    return PairPose(first, second, pose, np.eye(6) * sigma**2, 3.0, 8, 0.3, ())


def test_the_chain_prefers_the_path_of_least_variance():
    pairs = [made_pair(0, 1, 1.0, 1e-3), made_pair(1, 2, 1.0, 1e-3), made_pair(0, 2, 2.5, 1e-2)]
    chain = chain_to_reference(["a", "b", "c"], Pairs(tuple(pairs), {}), needed_views=4)
    assert chain.paths == ((0,), (0, 1), (0, 1, 2))
    assert np.allclose(chain.cam_from_rig[2].translation_m, [2.0, 0, 0])
    assert chain.links[0] is None
    assert (chain.links[2].first, chain.links[2].second) == (1, 2)


def test_the_chain_runs_pairs_backwards_where_it_must():
    chain = chain_to_reference(["a", "b"], Pairs((made_pair(1, 0, 1.0, 1e-3),), {}), needed_views=4)
    assert np.allclose(chain.cam_from_rig[1].translation_m, [-1.0, 0, 0])


def test_unconnected_cameras_are_named_with_the_capture_that_would_join_them():
    pairs = Pairs((made_pair(0, 1, 1, 1e-3), made_pair(2, 3, 1, 1e-3)), {})
    with pytest.raises(NotConnectedError) as caught:
        chain_to_reference(["a", "b", "c", "d"], pairs, needed_views=4)
    message = str(caught.value)
    assert "cameras are not connected to a: no shared board views join 2 groups" in message
    assert "groups {a, b}; {c, d}" in message
    assert "do next:  show the board to b and c at the same time in 4 or more positions" in message


def test_a_pair_that_contradicts_its_loops_carries_nothing_though_it_seems_the_most_certain():
    pairs = [made_pair(a, b, float(b - a), 1e-3) for a in range(4) for b in range(a + 1, 4) if (a, b) != (0, 2)]
    wrong = made_pair(0, 2, 2.4, 1e-4)
    chain = chain_to_reference(["a", "b", "c", "d"], Pairs((*pairs, wrong), {}), needed_views=4)
    assert chain.doubted == (wrong,)
    assert np.allclose([pose.translation_m[0] for pose in chain.cam_from_rig], [0, 1, 2, 3])
    assert max(loop.gap_m for loop in chain.loops) < 1e-12


def test_of_a_single_open_loop_the_least_certain_pair_is_doubted():
    pairs = [made_pair(0, 1, 1, 1e-3), made_pair(1, 2, 1, 3e-3), made_pair(2, 3, 1, 1e-3), made_pair(0, 3, 3.5, 2e-3)]
    chain = chain_to_reference(["a", "b", "c", "d"], Pairs(tuple(pairs), {}), needed_views=4)
    assert chain.doubted == (pairs[1],)
    assert chain.loops == ()


def test_loops_say_how_far_the_pairs_are_from_closing_and_the_weakest_link_is_known():
    pairs = [made_pair(0, 1, 1, 1e-3), made_pair(1, 2, 1, 2e-3), made_pair(0, 2, 2.03, 5e-3)]
    chain = chain_to_reference(["a", "b", "c"], Pairs(tuple(pairs), {}), needed_views=4)
    (loop,) = chain.loops
    assert (loop.first, loop.second, loop.path) == (0, 2, (0, 1, 2))
    assert loop.gap_m == pytest.approx(0.03)
    assert loop.gap_share == pytest.approx(0.01)
    assert (chain.weakest.first, chain.weakest.second) == (1, 2)
    assert chain.doubted == ()


def test_shared_views_that_no_pose_explains_are_not_called_missing():
    with pytest.raises(NotConnectedError) as caught:
        chain_to_reference(["a", "b", "c"], Pairs((made_pair(0, 1, 1, 1e-3),), {(1, 2): 12}), needed_views=4)
    message = str(caught.value)
    assert "got:      b and c share 12 views, but no place of the cameras explains them" in message
    assert "do next:  check that no camera mirrors its image, that images of equal number or time were taken" in message


# --- joint solve ----------------------------------------------------------------------------------------------------


def joint_of(detections, lenses, chain, **options):
    frames = [camera.frames for camera in detections.cameras]
    return refine_rig(
        detections.board, lenses, frames, detections.instants, chain.cam_from_rig, RefineOptions(**options)
    )


@pytest.mark.parametrize("model", ["opencv5", "fisheye4"])
def test_the_whole_path_is_exact_without_noise(model):
    rig, detections = capture(3, model=model, noise_px=0.0)
    options = CalibrateOptions(model)
    result = calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, options), options)
    for found, true in zip(result.joint.cam_from_rig, rig.cameras, strict=True):
        assert_pose_close(found, true.cam_from_rig, max_deg=1e-4, max_m=1e-5)


def test_the_joint_solve_beats_the_chain_at_the_same_rmse():
    """Worst camera of a four-camera arc, mean of 5 rigs: the joint solve at most 0.7 of the chain's error."""
    chained, refined = [], []
    for seed in range(5):
        rig, detections = capture(4, seed=10 * seed)
        options = CalibrateOptions()
        result = calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, options), options)

        def worst_m(poses, rig=rig):
            centres = [
                p.inverse().translation_m - c.cam_from_rig.inverse().translation_m
                for p, c in zip(poses, rig.cameras, strict=True)
            ]
            return max(np.linalg.norm(centres, axis=1))

        chained.append(worst_m(result.chain.cam_from_rig))
        refined.append(worst_m(result.joint.cam_from_rig))
        assert all(rmse.refined < 0.32 for rmse in result.rmse)
    assert np.mean(refined) < 0.7 * np.mean(chained)


def test_a_view_turned_after_the_lenses_is_turned_back_and_named():
    board = Checkerboard(8, 6, 0.06)
    rig, detections = capture(3, board=board)
    victim = detections.cameras[1].views[3].frame_idx
    turned = spoiled(detections, 1, victim, lambda v: reordered(v, corner_orders(board)[1]))
    options = CalibrateOptions()
    result = calibrate_site(turned, GateLimits(), calibrate_lenses(turned, None, options), options)
    named = {
        (camera, f.frame)
        for camera, findings in enumerate(result.findings)
        for f in findings
        if f.action == "unflipped"
    }
    assert named in ({(1, f"{victim:06d}")}, {(0, f"{victim:06d}")})
    assert max(rmse.refined for rmse in result.rmse) < 0.35
    for found, true in zip(result.joint.cam_from_rig, rig.cameras, strict=True):
        assert_pose_close(found, true.cam_from_rig, max_deg=0.5, max_m=0.05)


def test_a_rig_that_falls_apart_with_its_bad_views_is_refused():
    rig, detections = capture(2, shared=3)
    lenses = list(calibrate_lenses(detections, None, CalibrateOptions()))
    rng = np.random.default_rng(0)
    thrown = tuple(
        replace(view, corners_px=view.corners_px + rng.normal(0, 9 if view.frame_idx < 3 else 0, view.corners_px.shape))
        for view in lenses[1].views
    )
    lenses[1] = replace(lenses[1], views=thrown)
    poses = [camera.cam_from_rig for camera in rig.cameras]
    frames = [camera.frames for camera in detections.cameras]
    with pytest.raises(CalibrationError) as caught:
        refine_rig(BOARD, lenses, frames, detections.instants, poses, RefineOptions())
    message = str(caught.value)
    assert "every view that joined cam1 to cam0 was rejected" in message
    assert "3 dropped views of cam1" in message
    assert "show it, held still, to cam1 and a neighbour together in 10 or more positions" in message


def test_lenses_that_were_given_are_held():
    rig, detections = capture(2)
    lenses = tuple(
        hold_camera(d, BOARD, c.camera, 0.2, IntrinsicsOptions())
        for d, c in zip(detections.cameras, rig.cameras, strict=True)
    )
    result = calibrate_site(detections, GateLimits(), lenses, CalibrateOptions(refine=RefineOptions(free_lenses=False)))
    for found, true in zip(result.joint.cameras, rig.cameras, strict=True):
        assert np.array_equal(found.params, true.camera.params)
    assert_pose_close(result.joint.cam_from_rig[1], rig.cameras[1].cam_from_rig, max_deg=0.1, max_m=0.01)


def test_chained_error_compounds_and_refined_does_not():
    _, detections = capture(4)
    options = CalibrateOptions()
    result = calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, options), options)
    for rmse in result.rmse[1:]:
        assert rmse.refined < rmse.chained
    assert result.rmse[0].pairwise is None
    assert result.rmse[0].chained is None


def test_lenses_are_held_where_shared_views_contradict_each_other():
    """Boards that moved between the exposures of two cameras: the lens stays where its own views put it."""
    _, detections = capture(2, shared=14)
    rng = np.random.default_rng(0)
    moved = tuple(
        replace(view, corners_px=view.corners_px + (rng.normal(0, 8, 2) if view.frame_idx < 14 else 0))
        for view in detections.cameras[1].views
    )
    late = replace(detections, cameras=(detections.cameras[0], replace(detections.cameras[1], views=moved)))
    options = CalibrateOptions()
    lenses = calibrate_lenses(late, None, options)
    result = calibrate_site(late, GateLimits(), lenses, options)
    assert result.joint.noisy
    for camera in result.joint.noisy:
        assert np.array_equal(result.joint.cameras[camera].params, lenses[camera].camera.params)
    clean = calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, options), options)
    assert clean.joint.noisy == ()
