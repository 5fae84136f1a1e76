"""Clocks from films of a moving board: whole path, windows that are worth a look, corners in one order."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.board import Charuco, Checkerboard
from rigcal.captures import open_capture
from rigcal.errors import ImageSizeError, OptionError, RigCaptureError, TracksError
from rigcal.order import corner_orders
from rigcal.rig import Rig
from rigcal.stamps import FrameStamps, frame_stamps
from rigcal.sync.content.board.follow import FrameBudget, board_lags, board_tracks
from rigcal.sync.content.board.orders import CameraBoards, in_one_order, middles
from rigcal.sync.content.board.windows import looking_runs, moving_windows
from rigcal.sync.content.synthetic import CameraClock, carried_board, exact_tracks
from rigcal.sync.content.synthetic_video import Shutter, write_capture
from rigcal.synthetic import arc_rig

BOARD = Checkerboard(5, 4, 0.12)
RIG = arc_rig(2, arc_deg=40, radius_m=2.4, size_wh=(320, 240))
CLOCKS = {"cam0": CameraClock(phase_s=0.01), "cam1": CameraClock(0.15, phase_s=0.02)}
FAST = Shutter(sub_exposures=2)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    folder = tmp_path_factory.mktemp("film")
    motion = carried_board(RIG, BOARD, seed=4)
    write_capture(folder, RIG, BOARD, motion, CLOCKS, seconds=7.0, shutter=FAST, epoch_s=1.75e9)
    return folder


def test_a_film_gives_its_clocks(film):
    capture, told = open_capture(film), []
    stamps = frame_stamps(capture)
    lags = board_lags(capture, BOARD, RIG, stamps, progress=lambda done, total: told.append((done, total)))
    lag = lags.camera("cam1")
    assert lags.method == "board"
    assert lag.confident, lag.reason
    assert abs(lag.offset_s - 0.15) < min(lag.bound_s, 0.5e-3)  # measured: 0.1 ms of 320x240 pixels, two cameras
    assert stamps.times_s[1][0] < lag.at_s < stamps.times_s[1][-1]
    assert told[-1][0] == told[-1][1] == sum(len(camera.frames) for camera in capture.cameras)


def test_long_films_are_searched_in_windows_within_the_budget(film):
    capture = open_capture(film)
    budget = FrameBudget(looks=60, consecutive=100)
    tracks = board_tracks(capture, BOARD, RIG, frame_stamps(capture), budget=budget)
    for track in tracks:
        assert 40 <= len(track.t_s) <= 1.2 * budget.consecutive
        assert (np.diff(track.t_s) < 0.04).mean() > 0.9
    assert np.ptp([track.t_s.mean() - CLOCKS[track.camera_id].offset_s * -1 for track in tracks]) < 0.1


def test_folders_of_images_serve_as_well(tmp_path):
    motion = carried_board(RIG, BOARD, seed=4)
    write_capture(tmp_path, RIG, BOARD, motion, CLOCKS, seconds=0.5, shutter=FAST, form="images")
    capture = open_capture(tmp_path)
    tracks = board_tracks(capture, BOARD, RIG, frame_stamps(capture))
    exact = exact_tracks(RIG, BOARD, motion, CLOCKS, seconds=0.5)
    for track, truth in zip(tracks, exact, strict=True):
        error = track.points_px - truth.points_px
        assert np.isfinite(error).mean() > 0.8
        assert np.sqrt(np.nanmean(error**2)) < 0.3


def test_a_board_that_nobody_shows_is_said(tmp_path):
    rig = replace(RIG, cameras=RIG.cameras)
    away = carried_board(rig, BOARD, seed=4)
    write_capture(
        tmp_path, rig, BOARD, lambda t: replace(away(t), translation_m=[0, 0, -9.0]), CLOCKS, seconds=0.5, shutter=FAST
    )
    capture = open_capture(tmp_path)
    lags = board_lags(capture, BOARD, rig, frame_stamps(capture))
    assert lags.camera("cam1").reason == "no points were found in its frames"


def test_corners_that_are_found_from_either_end_are_put_in_one_order():
    board = Checkerboard(6, 4, 0.1)  # alike when turned
    exact = exact_tracks(RIG, board, carried_board(RIG, board, seed=1), CLOCKS, seconds=3.0)
    orders, rng = corner_orders(board), np.random.default_rng(0)
    turned = []
    for track in exact:
        runs = np.repeat(rng.random(len(track.t_s) // 20 + 1) < 0.5, 20)[: len(track.t_s)]
        corners = np.where(runs[:, None, None], track.points_px[:, orders[1]], track.points_px)
        turned.append(CameraBoards(RIG.camera(track.camera_id), track.t_s, corners))
    first, second = in_one_order(turned, np.array([0.0, 0.1]), orders)  # the offset is 0.15
    ends = []
    for boards, track in zip((first, second), exact, strict=True):
        as_made = np.isclose(boards.corners_px, track.points_px).all(axis=(1, 2))
        assert (as_made | np.isclose(boards.corners_px, track.points_px[:, ::-1]).all(axis=(1, 2))).all()
        ends.append(as_made)
    assert len(set(ends[0].tolist())) == 1  # by continuity
    assert (ends[1] == ends[0][0]).all()  # by the rig's geometry


def test_boards_with_markers_keep_their_order():
    board = Charuco(5, 4, 0.1, 0.75, "DICT_4X4_50", False, False)
    boards = [CameraBoards(camera, np.zeros(0), np.zeros((0, 12, 2))) for camera in RIG.cameras]
    assert in_one_order(boards, np.zeros(2), corner_orders(board)) == boards


def test_the_middle_of_a_board_is_the_same_in_every_order():
    exact = exact_tracks(RIG, BOARD, carried_board(RIG, BOARD, seed=1), CLOCKS, seconds=0.3)[0].points_px
    assert middles(BOARD, exact) == pytest.approx(middles(BOARD, exact[:, ::-1]), abs=1e-6)


def test_windows_lie_where_two_cameras_see_motion_and_spread_over_the_recording():
    times = [np.arange(0, 120, 1 / 30)] * 3
    looks = np.arange(0, 120, 1 / 3)
    moving = np.where((looks % 40 < 10)[:, None], 100 * np.c_[np.sin(6 * looks), np.cos(5 * looks)], 0.0)
    seen = [(looks, moving), (looks + 1.0, moving), (looks[:0], moving[:0])]
    runs = moving_windows(times, seen, np.array([0.0, -1.0, 0.0]), 300)
    for camera, later_s in ((0, 0.0), (1, 1.0)):
        starts = np.array([times[camera][run.first] - later_s for run in runs if run.camera == camera])
        assert len(starts) == 6
        assert ((starts + 0.75) % 40 < 12).all()
        assert set((starts + 0.75) // 40) == {0.0, 1.0, 2.0}
    assert sum(len(run.frames) for run in runs if run.camera == 0) < 1.2 * 300


def test_looks_of_long_recordings_are_stretches_of_their_beginning_middle_and_end():
    minute, hour = np.arange(0, 60, 1 / 30), np.arange(0, 3600, 1 / 30)
    assert [(run.first, run.stop, run.stride) for run in looking_runs([minute], 180)] == [(0, 1800, 10)]
    runs = looking_runs([hour], 180)
    assert len(runs) == 3
    assert sum(len(run.frames) for run in runs) == 180
    assert (runs[0].first, runs[-1].stop) == (0, len(hour))


def test_cameras_that_the_rig_does_not_have_are_named(film):
    rig = Rig("other", RIG.cameras[:1], "cam0", "PASS")
    with pytest.raises(RigCaptureError, match="the rig has no camera cam1"):
        board_lags(open_capture(film), BOARD, rig, FrameStamps("timestamps.csv", (np.zeros(1), np.zeros(1))))


def test_images_of_another_size_than_the_rigs_are_named(film):
    rig = arc_rig(2, size_wh=(640, 480))
    with pytest.raises(ImageSizeError, match="640x480 px, as in the rig file"):
        board_lags(open_capture(film), BOARD, rig, frame_stamps(open_capture(film)))


def test_a_capture_of_one_camera_is_refused(tmp_path):
    one = {"cam0": CLOCKS["cam0"]}
    write_capture(tmp_path, RIG, BOARD, carried_board(RIG, BOARD, seed=4), one, seconds=0.2, shutter=FAST)
    capture = open_capture(tmp_path)
    with pytest.raises(TracksError, match="clocks are compared between cameras"):
        board_lags(capture, BOARD, RIG, frame_stamps(capture))


def test_a_budget_of_a_second_is_refused():
    with pytest.raises(OptionError, match="at least 60 looks and 60 consecutive frames"):
        FrameBudget(looks=30)
