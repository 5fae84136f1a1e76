"""Cameras that are not there: streams with the protocol of recognition.sources.stream, and detectors, for live runs."""

import threading
import time
from fractions import Fraction

import av
import cv2
import numpy as np

from recognition.errors import StreamError
from recognition.observations import ViewDetections
from recognition.sources.decoding import Decoder
from recognition.sources.stream import ClockStep, Interruption, Packet

SIZE_WH = (64, 48)
FPS = 100.0
"""So that tests take a third of the time."""
DELAY_NS = 20_000_000
"""From capture to arrival."""
_HUNG_UP = StreamError("the camera hung up", got="connection reset", do_next="look at its cable")


def jpeg_of(number):
    image = np.full((SIZE_WH[1], SIZE_WH[0], 3), number % 256, np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()


def h264_units(frames, *, key_every=10):
    """Access units of a moving square; keys every ``key_every`` frames."""
    context = av.CodecContext.create("libx264", "w")
    context.width, context.height = SIZE_WH
    context.pix_fmt, context.time_base, context.framerate = "yuv420p", Fraction(1, 30), Fraction(30)
    context.options = {"preset": "ultrafast", "g": str(key_every), "bf": "0", "x264-params": "repeat-headers=1"}
    units = []
    for number in [*range(frames), None]:
        picture = None
        if number is not None:
            image = np.full((SIZE_WH[1], SIZE_WH[0], 3), 60, np.uint8)
            image[10:20, number % 40 : number % 40 + 10] = 200
            picture = av.VideoFrame.from_ndarray(image, format="rgb24")
            picture.pts = number
        units += [(bytes(packet), packet.is_keyframe) for packet in context.encode(picture)]
    return units


class Conductor:
    """Lets cameras send a frame when the one before was placed, so that what happens does not depend on the machine."""

    def __init__(self):
        self._changed = threading.Condition()
        self._placed = 0

    def placed(self, _scene):
        with self._changed:
            self._placed += 1
            self._changed.notify_all()

    def wait_for(self, number, closing):
        with self._changed:
            while self._placed < number and not closing.is_set():
                self._changed.wait(0.05)


class FakeCamera:
    """A live camera that sends at 100 frames a second, or as a conductor lets it, what it is told to.

    Args:
        camera: Index in the rig.
        start_ns: Rig time of the first frame.
        frames: How many it sends.
        conductor: None: it sends at its own pace.
        units: H.264 access units with whether they are key frames; JPEG images without.
        shift_s: Per frame, how far its stamps are off from that frame on.
        lost: Frames from, up to: the camera is interrupted meanwhile.
        steps: Frames before which the source reports a step of so many seconds.
        live: Whether packets bear a time of arrival.
    """

    def __init__(
        self, camera, start_ns, frames, conductor=None, *, units=None, shift_s=None, lost=None, steps=None, live=True
    ):
        self.camera, self._start_ns, self._frames, self._units = camera, start_ns, frames, units
        self._conductor, self._shift_s, self._lost, self._steps = conductor, shift_s or {}, lost, steps or {}
        self._live, self._closing = live, threading.Event()
        self.sent = 0

    def time_ns(self, number):
        """When a frame is taken."""
        return self._start_ns + round(number * 1e9 / FPS)

    def packets(self):
        shift_ns = 0
        for number in range(self._frames):
            self._wait_for(number)
            if self._closing.is_set():
                return
            t_ns = self.time_ns(number)
            if number in self._steps:
                yield ClockStep(self.camera, t_ns, f"cam{self.camera}", self._steps[number])
            shift_ns += round(1e9 * self._shift_s.get(number, 0.0))
            if self._lost and self._lost[0] <= number < self._lost[1]:
                if number == self._lost[0]:
                    yield Interruption(self.camera, t_ns, _HUNG_UP)
                continue
            content, is_key = self._units[number] if self._units else (jpeg_of(number), True)
            encoding = "h264" if self._units else "jpeg"
            receive_ns = t_ns + DELAY_NS if self._live else None
            self.sent += 1
            yield Packet(self.camera, number, t_ns + shift_ns, receive_ns, content, encoding, is_key)

    def _wait_for(self, number):
        if self._conductor:
            self._conductor.wait_for(number, self._closing)
        else:
            self._closing.wait(max(self.time_ns(number) + DELAY_NS - time.time_ns(), 0) * 1e-9)

    def decoder(self):
        return Decoder(f"cam{self.camera}", SIZE_WH)

    def close(self):
        self._closing.set()


class Buckets:
    """Finds a bucket in every image; takes ``seconds`` for it."""

    model_info = ()

    def __init__(self, seconds=0.0):
        self._seconds = seconds
        self.images = 0

    def detect(self, image_bgr):
        assert image_bgr.shape == (SIZE_WH[1], SIZE_WH[0], 3)
        time.sleep(self._seconds)
        self.images += 1
        return ViewDetections(np.zeros((0, 17, 2)), np.zeros((0, 17)), ("bucket",), [[10, 10, 30, 30]], np.ones(1))
