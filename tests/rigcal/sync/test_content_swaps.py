"""Exchanged videos are named; videos under their own names are left alone."""

from itertools import combinations

import numpy as np
import pytest

from rigcal.board import Checkerboard
from rigcal.geometry import Pose
from rigcal.sync.content.swaps import swapped_cameras
from rigcal.sync.content.tracks import PointTracks
from rigcal.synthetic import arc_rig

BOARD = Checkerboard(6, 4, 0.08)


def tracks_of(rig, *, shows=None, offset_s=0.0, noise_px=0.3, seed=0):
    """A board that swings through the middle of the scene; camera k holds the pictures of ``shows[k]``."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 4, 1 / 15)
    found = []
    for camera in rig.cameras:
        seen = rig.camera((shows or {}).get(camera.id, camera.id))
        late = t + (offset_s if camera.id == "cam1" else 0.0)
        pixels = []
        for s in late:
            turn = Pose.from_rvec([1.2, 0.4 * np.sin(s), 0.3], [0.8 * np.sin(1.3 * s), 0.5 * np.cos(s), 1.2])
            corners = (rig.world_from_rig.inverse() @ turn).apply(BOARD.corners_in_board)
            pixels.append(seen.camera.project(seen.cam_from_rig.apply(corners)) + rng.normal(0, noise_px, (24, 2)))
        found.append(PointTracks(camera.id, t, np.array(pixels)))
    return found


@pytest.mark.parametrize("cameras", [3, 4, 6])
def test_videos_under_their_own_names_are_left_alone(cameras):
    rig = arc_rig(cameras, seed=cameras)
    assert swapped_cameras(rig, tracks_of(rig)) == {}


def test_a_clock_that_is_off_is_no_exchange():
    rig = arc_rig(4)
    assert swapped_cameras(rig, tracks_of(rig, offset_s=0.2)) == {}


@pytest.mark.parametrize(("one", "other"), list(combinations(["cam0", "cam1", "cam2", "cam3"], 2)))
def test_two_exchanged_videos_are_named(one, other):
    rig = arc_rig(4, seed=2)
    assert swapped_cameras(rig, tracks_of(rig, shows={one: other, other: one})) == {one: other, other: one}


def test_three_videos_in_a_circle_are_named():
    rig = arc_rig(5, seed=3)
    circle = {"cam1": "cam2", "cam2": "cam4", "cam4": "cam1"}
    assert swapped_cameras(rig, tracks_of(rig, shows=circle)) == circle


def test_cameras_that_share_nothing_are_not_judged():
    rig = arc_rig(3)
    blind = [PointTracks(t.camera_id, t.t_s, np.full_like(t.points_px, np.nan)) for t in tracks_of(rig)]
    assert swapped_cameras(rig, blind) == {}
