"""Views of one board that disagree: who is wrong, how it is known, and what is said of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigcal.agreement import Names
from rigcal.board import Checkerboard
from rigcal.boardpose import board_poses
from rigcal.bundle import Freedom, State
from rigcal.corners import Observations
from rigcal.detections import BoardView, Instants
from rigcal.geometry import Pose
from rigcal.intrinsics import IntrinsicsOptions, hold_camera
from rigcal.motion import corner_speeds_px_s
from rigcal.order import corner_orders, quarter_turns, reordered
from rigcal.outliers import RejectionRule
from rigcal.placing import groups_of_views, place_boards
from rigcal.robust import solve_robustly
from rigcal.synthetic import arc_rig, board_poses_for_pair, exact_detections, with_noise

BOARD = Checkerboard(9, 6, 0.06)
NOISE_PX = 0.2


def smooth_path(rig, cameras, frames):
    """A board carried slowly through the middle of what the cameras see: at most 12 px from frame to frame."""
    start = board_poses_for_pair(rig, cameras[0], cameras[-1], BOARD, 1, distance_m=(3.5, 4.0), seed=3)[0]
    swing = np.linspace(-1, 1, frames)[:, None] * [0.15, 0.1, 0.05]
    turn = Rotation.from_euler("xyz", np.linspace(-8, 8, frames)[:, None] * [1, 0.5, 0.3], degrees=True)
    return [Pose(start.rotation @ r.as_matrix(), start.translation_m + s) for r, s in zip(turn, swing, strict=True)]


def scattered(rig, cameras, frames):
    return board_poses_for_pair(rig, cameras[0], cameras[-1], BOARD, frames, distance_m=(2.5, 4.5), seed=5)


def capture(cameras, path, frames=20):
    rig = arc_rig(cameras, arc_deg=20 * (cameras - 1), radius_m=4.5, model="opencv4", seed=1)
    exact = exact_detections(rig, BOARD, path(rig, rig.camera_ids, frames))
    assert all(len(camera.views) == frames for camera in exact.cameras)
    return rig, with_noise(exact, NOISE_PX, seed=2)


def spoiled(detections, camera, frame, change):
    cameras = list(detections.cameras)
    views = tuple(change(v) if v.frame_idx == frame else v for v in cameras[camera].views)
    cameras[camera] = replace(cameras[camera], views=views)
    return replace(detections, cameras=tuple(cameras))


def shifted(view):
    return replace(view, corners_px=view.corners_px + [6.0, -4.0])


def thrown(view):
    rng = np.random.default_rng(9)
    return replace(view, corners_px=view.corners_px + rng.normal(0, 8, view.corners_px.shape))


def solved(rig, detections):
    """Cameras' poses solved with true lenses, from the truth; returns the findings by (camera, frame)."""
    cameras = tuple(camera.camera for camera in rig.cameras)
    entries = [(c, v.frame_idx, v) for c, camera in enumerate(detections.cameras) for v in camera.views]
    boards = []
    for index in range(len(detections.instants.frame_idx)):
        view = next(v for v in detections.cameras[-1].views if v.frame_idx == index)
        pose = board_poses(cameras[-1], BOARD.corners_in_board, view)[0].cam_from_board
        boards.append(rig.cameras[-1].cam_from_rig.inverse() @ pose)
    freedom = Freedom(tuple(np.zeros(8, dtype=bool) for _ in cameras), np.arange(len(cameras)) > 0)
    names = Names(detections.camera_ids, tuple(camera.frames for camera in detections.cameras))
    start = State(cameras, tuple(camera.cam_from_rig for camera in rig.cameras), tuple(boards))
    result = solve_robustly(Observations.of(BOARD.corners_in_board, entries), start, freedom, names, RejectionRule())
    for found, true in zip(result.solution.state.cam_from_rig, rig.cameras, strict=True):
        apart = found.inverse().translation_m - true.cam_from_rig.inverse().translation_m
        assert np.linalg.norm(apart) < 0.01  # measured 7.2 mm at most, of 20 boards in one place
    return {(camera, finding.frame): finding for camera, finding in result.findings}


@pytest.mark.parametrize("path", [smooth_path, scattered])
@pytest.mark.parametrize("cameras", [2, 3])
def test_views_that_agree_are_all_kept(cameras, path):
    assert solved(*capture(cameras, path)) == {}


@pytest.mark.parametrize("victim", [0, 1, 2])
def test_a_third_camera_tells_which_view_is_wrong(victim):
    rig, detections = capture(3, scattered)
    found = solved(rig, spoiled(detections, victim, 7, shifted))
    assert list(found) == [(victim, "000007")]
    others = ", ".join(f"cam{c}" for c in range(3) if c != victim)
    finding = found[victim, "000007"]
    assert finding.action == "dropped"
    assert finding.reason.endswith(f" px off from where {others} see the board")
    assert 4 < float(finding.reason.split()[0]) < 9  # 7.2 px, less what the pose of the board takes up


@pytest.mark.parametrize("victim", [0, 1])
def test_a_view_that_no_pose_explains_is_wrong_by_itself(victim):
    rig, detections = capture(2, scattered)
    found = solved(rig, spoiled(detections, victim, 7, thrown))
    assert list(found) == [(victim, "000007")]
    assert found[victim, "000007"].reason.endswith(" px per axis in its own camera alone")


@pytest.mark.parametrize("victim", [0, 1])
def test_neighbours_in_time_tell_which_of_two_views_is_wrong(victim):
    rig, detections = capture(2, smooth_path)
    found = solved(rig, spoiled(detections, victim, 7, shifted))
    assert list(found) == [(victim, "000007")]
    reason = found[victim, "000007"].reason
    assert f"px off from where cam{1 - victim} sees the board, and 7." in reason
    assert reason.endswith("px off from where it was in the frames before and after")


def test_where_nothing_can_tell_both_views_are_named_as_a_pair():
    rig, detections = capture(2, scattered)
    found = solved(rig, spoiled(detections, 1, 7, shifted))
    assert sorted(found) == [(0, "000007"), (1, "000007")]
    reason = found[0, "000007"].reason
    assert reason.startswith("disagrees with cam1 frame 000007 by ")
    assert reason.endswith(" px, and nothing tells which of the two is wrong: both left out")


def test_three_views_of_which_no_two_agree_are_all_left_out():
    rig, detections = capture(3, scattered)
    detections = spoiled(detections, 0, 7, shifted)
    detections = spoiled(detections, 1, 7, lambda v: replace(v, corners_px=v.corners_px - [8.0, 9.0]))
    found = solved(rig, detections)
    assert sorted(found) == [(c, "000007") for c in range(3)]
    assert {f.reason for f in found.values()} == {"disagrees with the board's other views, and they with each other"}


def test_of_four_views_with_two_wrong_ones_both_are_named():
    rig, detections = capture(4, scattered)
    detections = spoiled(detections, 0, 7, shifted)
    detections = spoiled(detections, 3, 7, lambda v: replace(v, corners_px=v.corners_px - [8.0, 9.0]))
    assert sorted(solved(rig, detections)) == [(0, "000007"), (3, "000007")]


# --- corner orders --------------------------------------------------------------------------------------------------


def placed(rig, detections):
    """What place_boards makes of a capture whose lenses and poses are known."""
    lenses = tuple(
        hold_camera(d, detections.board, c.camera, 0.2, IntrinsicsOptions())
        for d, c in zip(detections.cameras, rig.cameras, strict=True)
    )
    names = Names(detections.camera_ids, tuple(camera.frames for camera in detections.cameras))
    groups = groups_of_views(lenses, detections.instants, names)
    poses = [camera.cam_from_rig for camera in rig.cameras]
    return place_boards(detections.board, [c.camera for c in rig.cameras], poses, groups.views, names, 20.0)


def turned(view, quarter=1):
    return reordered(view, corner_orders(BOARD)[quarter])


@pytest.mark.parametrize("victim", [0, 1, 2])
def test_the_fewer_views_are_the_turned_ones(victim):
    rig, detections = capture(3, scattered)
    result = placed(rig, spoiled(detections, victim, 7, turned))
    assert result.order_of == {(victim, 7): 1}
    ((camera, finding),) = result.findings
    others = ", ".join(f"cam{c}" for c in range(3) if c != victim)
    assert (camera, finding.frame, finding.action) == (victim, "000007", "unflipped")
    assert finding.reason == f"corner order turned by 180 degrees against {others}"


@pytest.mark.parametrize("victim", [0, 1])
def test_of_two_views_the_one_that_turns_between_its_neighbours_is_the_turned_one(victim):
    rig, detections = capture(2, smooth_path)
    assert placed(rig, spoiled(detections, victim, 7, turned)).order_of == {(victim, 7): 1}


@pytest.mark.parametrize("victim", [0, 1])
def test_turned_views_end_where_the_board_is(victim):
    rig, detections = capture(2, scattered)
    straight, result = placed(rig, detections), placed(rig, spoiled(detections, victim, 7, turned))
    turn = straight.rig_from_board[7].inverse() @ result.rig_from_board[7]
    assert min(turn.angle_rad, np.pi - turn.angle_rad) < 0.02  # the board itself, or turned as both views say
    for camera, board, view in result.entries:
        pose = rig.cameras[camera].cam_from_rig @ result.rig_from_board[board]
        gap = rig.cameras[camera].camera.project(pose.apply(BOARD.corners_in_board[view.corner_ids])) - view.corners_px
        assert np.abs(gap).max() < 15


def test_square_boards_have_four_orders_and_they_add_up():
    board = Checkerboard(6, 6, 0.05)
    orders = corner_orders(board)
    assert len(orders) == 4
    for one in range(4):
        for two in range(4):
            both = orders[one][np.argsort(orders[two])]  # two undone, then one
            assert np.array_equal(both, orders[quarter_turns(one, minus=two)])
    grid = board.corners_in_board - board.corners_in_board.mean(axis=0)
    for order in orders:
        rotation, _ = Rotation.align_vectors(grid[order], grid)
        assert np.allclose(rotation.apply(grid), grid[order], atol=1e-9)
        assert rotation.as_matrix()[2, 2] == pytest.approx(1)  # turned in its plane, never mirrored


# --- boards that move between exposures -----------------------------------------------------------------------------


def test_the_speed_of_corners_comes_from_the_views_before_and_after():
    corners = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    views = [BoardView(k, np.arange(3), corners + [3.0 * k, 4.0 * k]) for k in (0, 1, 2, 50)]
    speeds = corner_speeds_px_s(views, np.array([0.0, 0.1, 0.2, 5.0]))
    assert np.allclose(speeds, [50, 50, 50, 0])


def test_a_view_whose_board_moved_too_far_between_exposures_serves_its_lens_only():
    """12 px per frame of 1/30 s is 360 px/s: 2 ms apart is 0.4 px each way, 20 ms is 3.6 px."""
    rig, detections = capture(2, smooth_path)
    count = len(detections.instants.frame_idx)
    apart_s = np.full(count, 0.002)
    apart_s[7] = 0.04
    offset_s = np.stack([-apart_s / 2, apart_s / 2], axis=1)
    instants = Instants("timestamps.csv", detections.instants.frame_idx, np.arange(count) / 30, offset_s)
    lenses = tuple(
        hold_camera(d, BOARD, c.camera, 0.2, IntrinsicsOptions())
        for d, c in zip(detections.cameras, rig.cameras, strict=True)
    )
    names = Names(detections.camera_ids, tuple(camera.frames for camera in detections.cameras))
    groups = groups_of_views(lenses, instants, names)
    assert [sorted(group) for group in groups.views].count([0, 1]) == count - 1
    alone = {(c, group[c].frame_idx) for group in groups.views if len(group) == 1 for c in group}
    assert alone == {(0, 7), (1, 7)}
    assert {(c, f.frame) for c, f in groups.findings} == {(0, "000007"), (1, "000007")}
    reason = groups.findings[0][1].reason
    assert reason.endswith(" px between the exposures of the instant: used for its own lens only")
    moved = [px for group in groups.moved_px for px in group.values()]
    assert len(moved) == 2 * (count - 1)
    assert 0 < max(moved) < 1
