"""The networks and whoever places what they see: neither waits for the other longer than it must."""

import sys
import threading
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from live_fakes import SIZE_WH, Buckets, jpeg_of

from recognition.errors import BrokenFrameError
from recognition.grouping import GroupingOptions
from recognition.live.gathering import Gathering
from recognition.live.looking import Looking
from recognition.sources.decoding import Decoder
from recognition.sources.stream import Packet

PERIOD_NS = 100_000_000


def until(condition):
    end_s = time.monotonic() + 5.0
    while not condition() and time.monotonic() < end_s:
        time.sleep(0.005)
    assert condition()


class Watched:
    """A looker in its thread, with what it is given."""

    def __init__(self, detector):
        self.gathering = Gathering([0, 1], 2, GroupingOptions(fps=10.0))
        self.detector, self.broken, self.stopping = detector, [], threading.Event()
        self.looking = Looking(self.gathering, detector, self.stopping, lambda *what: self.broken.append(what))
        self.thread = threading.Thread(target=self.looking.run)
        self.thread.start()

    def give(self, number, *, damaged=()):
        for camera in (0, 1):
            content = b"not a picture" if camera in damaged else jpeg_of(number)
            packet = Packet(camera, number, number * PERIOD_NS, None, content, "jpeg", True)
            (frame,) = Decoder(f"cam{camera}", SIZE_WH).decode(packet)
            self.gathering.add(camera, packet.t_ns, frame)

    def end(self):
        self.gathering.end(0)
        self.gathering.end(1)


@pytest.fixture
def watched():
    made = Watched(Buckets())
    yield made
    made.stopping.set()
    made.thread.join(5.0)
    assert not made.thread.is_alive()


def test_the_next_set_is_looked_at_while_the_last_one_is_placed(watched):
    watched.give(0)
    assert watched.looking.next(5.0).taken.number == 0
    watched.give(1)
    until(lambda: watched.detector.images == 4)


def test_sets_wait_for_a_slow_caller_no_more_than_one_deep(watched):
    for number in range(8):
        watched.give(number)
        until(lambda n=number: watched.detector.images >= min(2 * n + 2, 4))
    assert watched.gathering.skipped == 5
    numbers = [watched.looking.next(5.0).taken.number for _ in range(3)]
    assert numbers == [0, 1, 7]


def test_everything_that_was_seen_is_handed_on_before_it_is_over(watched):
    watched.give(0)
    watched.end()
    until(lambda: not watched.thread.is_alive())
    assert watched.looking.is_busy
    assert not watched.looking.is_over
    assert [len(view.object_class) for view in watched.looking.next(1.0).views] == [1, 1]
    assert watched.looking.is_over
    assert watched.looking.next(0.01) is None


def test_a_picture_that_cannot_be_made_is_told_and_takes_no_part(watched):
    watched.give(0, damaged=(1,))
    seen = watched.looking.next(5.0)
    assert seen.views[0] is not None
    assert seen.views[1] is None
    ((camera, error),) = watched.broken
    assert camera == 1
    assert isinstance(error, BrokenFrameError)


def test_a_detector_that_fails_ends_the_looking():
    class Failing(Buckets):
        def detect(self, image_bgr):
            raise MemoryError

    gathering = Gathering([0, 1], 2, GroupingOptions(fps=10.0))
    looking = Looking(gathering, Failing(), threading.Event(), lambda *_what: None)
    for camera in (0, 1):
        packet = Packet(camera, 0, 0, None, jpeg_of(0), "jpeg", True)
        gathering.add(camera, 0, Decoder("cam", SIZE_WH).decode(packet)[0])
    with pytest.raises(MemoryError):
        looking.run()
    assert looking.is_over
