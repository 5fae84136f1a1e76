"""Views of long videos: different ones are kept, still ones first, and both cameras keep what they share."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.board import Checkerboard
from rigcal.detections import BoardDetections, BoardView, Instants, SiteDetections
from rigcal.errors import OptionError
from rigcal.selection import SelectionOptions, select_views

BOARD = Checkerboard(4, 3, 0.1)
GRID = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1).reshape(-1, 2)


def view(frame, centre, scale=40.0):
    return BoardView(frame, np.arange(12), GRID * scale + centre)


def site(*cameras, frames=None):
    count = frames or max(v.frame_idx for views in cameras for v in views) + 1
    names = tuple(f"{i:06d}" for i in range(count))
    detections = tuple(BoardDetections(f"cam{i}", (1920, 1080), names, tuple(v)) for i, v in enumerate(cameras))
    index = np.repeat(np.arange(count)[:, None], len(cameras), axis=1)
    return SiteDetections(BOARD, detections, Instants("frame numbers", index, np.arange(count), np.zeros(index.shape)))


def walk(count, step_px=0.2, start=(100.0, 100.0)):
    """A board that creeps along: every frame almost the same as the last."""
    return [view(i, np.array(start) + [step_px * i, 0]) for i in range(count)]


def test_short_captures_come_back_as_they_are():
    detections = site(walk(120), walk(50))
    assert select_views(detections, SelectionOptions()) is detections


def test_long_videos_keep_as_many_views_as_allowed_and_their_extremes():
    chosen = select_views(site(walk(2000)), SelectionOptions(most_views=50)).cameras[0].views
    frames = [v.frame_idx for v in chosen]
    assert len(frames) == 50
    assert frames == sorted(frames)
    assert frames[0] < 20
    assert frames[-1] > 1979
    assert np.diff(frames).max() < 100  # spread evenly: 40 apart would be perfect


def test_a_view_unlike_all_others_is_kept():
    unlike = [view(frame, np.array([1500.0, 900.0]), scale=15.0) for frame in (600, 601)]
    chosen = select_views(site([*walk(500), *unlike]), SelectionOptions(most_views=20)).cameras[0].views
    assert {600, 601} & {v.frame_idx for v in chosen}


def test_boards_held_still_come_before_moving_ones():
    still, moving = walk(300, step_px=0.5), walk(300, step_px=5.0)
    views = [*still, *[replace(v, frame_idx=v.frame_idx + 400) for v in moving]]
    chosen = select_views(site(views), SelectionOptions(most_views=100)).cameras[0].views
    assert all(v.frame_idx < 300 for v in chosen)


def test_views_that_are_shared_are_kept_by_both_cameras():
    second = [v for v in walk(1000, start=(300.0, 500.0)) if v.frame_idx >= 900]
    chosen = select_views(site(walk(1000), second), SelectionOptions(most_views=40)).cameras
    first_frames, second_frames = ({v.frame_idx for v in camera.views} for camera in chosen)
    assert len(first_frames & second_frames) >= 28  # 70 % of 40
    assert second_frames <= first_frames


def test_the_choice_is_deterministic():
    detections = site(walk(700))
    first, second = (select_views(detections, SelectionOptions()) for _ in range(2))
    assert [v.frame_idx for v in first.cameras[0].views] == [v.frame_idx for v in second.cameras[0].views]


def test_too_small_a_limit_is_refused():
    with pytest.raises(OptionError, match="option most_views is out of range"):
        SelectionOptions(most_views=5)
