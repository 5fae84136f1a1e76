"""Live grouping: the rule of captures on disk, decided early, with waits that are bounded."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recognition.grouping import Grouper, GroupingOptions
from rigcal.errors import OptionError
from rigcal.instants import group_by_time

MS = 1_000_000
PERIOD = 40 * MS
OPTIONS = GroupingOptions(wait_s=0.1, silent_s=0.5, fps=25.0)


class Site:
    """Feeds a grouper; frames are named by camera and time in milliseconds."""

    def __init__(self, cameras, options=OPTIONS):
        self.grouper = Grouper(cameras, options)
        self.left = []

    def frame(self, camera, t_ms, at_ms):
        """A frame of a time, arriving at another; whether it came in time."""
        in_time = self.grouper.add(camera, round(t_ms * MS), f"{camera}:{t_ms}", round(at_ms * MS))
        self.at(at_ms)
        return in_time

    def at(self, at_ms):
        for group in self.grouper.groups(round(at_ms * MS)):
            self.left.append((group.frames, at_ms))

    @property
    def groups(self):
        return [frames for frames, _ in self.left]


def test_a_set_leaves_when_its_last_frame_arrives():
    site = Site(3)
    for n in range(3):
        for camera, late in enumerate((5, 9, 14)):
            site.frame(camera, 40 * n, 40 * n + late)
    assert site.left == [((f"0:{40 * n}", f"1:{40 * n}", f"2:{40 * n}"), 40 * n + 14) for n in range(3)]


def test_the_time_of_a_set_is_the_mean_of_its_frames():
    grouper = Grouper(2, OPTIONS)
    grouper.add(0, 1_795_364_532_626_091_077, "a", 0)
    grouper.add(1, 1_795_364_532_626_091_080, "b", 0)
    [group] = grouper.groups(0)
    assert group.t_ns == 1_795_364_532_626_091_079  # of half a nanosecond
    assert group.times_ns == (1_795_364_532_626_091_077, 1_795_364_532_626_091_080)
    assert group.cameras == 2


def test_a_late_camera_is_waited_for_no_longer_than_stated():
    site = Site(2)
    site.frame(0, 0, 5), site.frame(1, 0, 6)
    site.frame(0, 40, 45)
    assert site.grouper.due_ns() == 145 * MS
    site.at(144)
    assert len(site.left) == 1
    site.at(145)
    assert site.left[1:] == [(("0:40", None), 145)]
    assert site.frame(1, 40, 150)  # that one was alone: nothing was decided about the other
    site.at(250)
    assert site.groups[2:] == [(None, "1:40")]


def test_a_frame_that_comes_after_its_set_is_refused():
    site = Site(3)
    for camera in range(3):
        site.frame(camera, 0, 5)
    site.frame(0, 40, 45), site.frame(1, 40, 46)
    site.at(200)
    assert site.groups[1:] == [("0:40", "1:40", None)]
    assert not site.frame(2, 40, 201)
    assert site.frame(2, 80, 202)


def test_a_camera_that_has_gone_on_is_not_waited_for():
    """cam1 drops a frame: the set leaves without it as soon as its next frame is there."""
    site = Site(2)
    site.frame(0, 0, 5), site.frame(1, 0, 5)
    site.frame(0, 40, 45)
    site.frame(1, 80, 85)
    assert site.left[1:] == [(("0:40", None), 85)]


def test_a_lost_camera_is_not_waited_for_until_it_is_back():
    site = Site(2)
    site.frame(0, 0, 5), site.frame(1, 0, 5)
    site.grouper.lose(1)
    site.frame(0, 40, 45)
    assert site.left[1:] == [(("0:40", None), 45)]
    site.frame(1, 80, 83)
    assert len(site.left) == 2
    site.frame(0, 80, 85)
    assert site.left[2:] == [(("0:80", "1:80"), 85)]


def test_a_silent_camera_is_not_waited_for():
    site = Site(2)
    site.frame(0, 0, 5), site.frame(1, 0, 5)
    for n in range(1, 13):
        site.frame(0, 40 * n, 40 * n + 5)
    site.frame(0, 520, 525)
    assert site.left[-1] == (("0:520", None), 525)


def test_at_the_start_the_others_are_waited_for():
    site = Site(2)
    site.frame(0, 0, 5)
    assert site.left == []
    site.frame(1, 0, 30)
    assert site.left == [(("0:0", "1:0"), 30)]


def test_the_rest_leaves_at_the_end():
    site = Site(2)
    site.frame(0, 0, 5), site.frame(1, 0, 5)
    site.frame(0, 40, 45)
    assert [group.frames for group in site.grouper.rest()] == [("0:40", None)]
    assert site.grouper.due_ns() is None


def test_a_frame_that_is_alone_long_before_the_others_closes_nothing():
    """A camera whose clock is ahead does not make the others' frames late."""
    site = Site(3)
    site.frame(2, 900_000, 1)
    site.at(200)
    assert site.groups == [(None, None, "2:900000")]
    assert site.frame(0, 0, 205)
    assert site.frame(1, 0, 206)
    assert site.groups[1:] == [("0:0", "1:0", None)]


def test_frames_are_not_grouped_beyond_half_a_period():
    site = Site(2)
    for n in range(4):
        site.frame(0, 40 * n, 40 * n + 5)
        site.frame(1, 40 * n + 19, 40 * n + 24)
    assert site.groups == [(f"0:{40 * n}", f"1:{40 * n + 19}") for n in range(4)]


@settings(max_examples=60, deadline=None)
@given(
    phases=st.lists(st.floats(-0.45, 0.45), min_size=1, max_size=3),
    drops=st.sets(st.tuples(st.integers(1, 3), st.integers(2, 17)), max_size=6),
    delays=st.lists(st.integers(0, 60), min_size=80, max_size=80),
)
def test_free_running_cameras_are_grouped_as_on_disk(phases, drops, delays):
    """However the frames arrive, within the wait: the same instants as of the whole capture, of two cameras or more."""
    times_ms = [[40.0 * n for n in range(20)]]
    for camera, phase in enumerate(phases, start=1):
        times_ms.append([40.0 * (n + phase) for n in range(20) if (camera, n) not in drops])
    arrivals, delay = [], iter(delays)
    for camera, times in enumerate(times_ms):
        at_ms = 0.0
        for t_ms in times:
            at_ms = max(at_ms, t_ms + 100 + next(delay))
            arrivals.append((at_ms, camera, t_ms))
    site = Site(len(times_ms))
    for at_ms, camera, t_ms in sorted(arrivals):
        assert site.frame(camera, t_ms, at_ms)
    site.left += [(group.frames, None) for group in site.grouper.rest()]
    found = group_by_time([np.array(times) * 1e-3 for times in times_ms], rule="file times", fps=[25.0])
    expected = [
        tuple(None if frame < 0 else f"{camera}:{times_ms[camera][frame]}" for camera, frame in enumerate(row))
        for row in found.frame_idx.tolist()
    ]
    shared = [row for row in expected if sum(frame is not None for frame in row) > 1]
    assert [row for row in site.groups if sum(frame is not None for frame in row) > 1] == shared


def test_what_waits_is_bounded():
    site = Site(2)
    site.frame(1, 0, 0)
    for n in range(1, 500):
        site.grouper.add(0, 40 * MS * n, "frame", 40 * MS * n)
        list(site.grouper.groups(40 * MS * n))
        assert sum(len(camera.waiting) for camera in site.grouper._cameras) <= 4


@pytest.mark.parametrize("name", ["wait_s", "silent_s", "fps"])
def test_options_out_of_range_are_refused(name):
    with pytest.raises(OptionError, match=name):
        GroupingOptions(**{name: 0.0})
