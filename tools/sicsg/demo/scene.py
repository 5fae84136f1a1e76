"""The demo's scene: the story of the shift, seen by four cameras triggered together whose clocks are off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.board import Checkerboard
from tools.sicsg.cameras import Sensors, semicircle
from tools.sicsg.scene import Room, Scene, SceneCamera
from tools.sicsg.story.shift import write_shift

SEED = 4
SIZE_WH, FPS = (1920, 1080), 10.0
SENSORS = Sensors(exposure_s=(0.008, 0.008), gain=(0.2, 0.2), ev=(0.0, 0.0), quality=(90, 90))
"""All alike; little noise, as cameras that average over frames have it, which keeps the videos small."""
BOARD = Checkerboard(9, 6, 0.1)
THICKNESS_M = 0.005
"""Of the plate that the board is printed on."""


@dataclass(frozen=True, slots=True)
class Clock:
    """How a camera's stamps come about: its host's clock, and how long after mid-exposure a frame is stamped."""

    host_offset_s: float
    """What to add to the host's clock at the start of work to have true time."""
    drift_ppm: float
    latency_s: float

    @property
    def stamp_offset_s(self) -> float:
        """What to add to the camera's stamps at the start of work to have the true time of mid-exposure."""
        return self.host_offset_s - self.latency_s


CLOCKS = (
    Clock(0.0113, 3.1, 0.0082),
    Clock(-0.0274, -11.6, 0.0078),
    Clock(0.0462, 7.4, 0.0083),
    Clock(-0.0187, 18.9, 0.0079),
)
"""Of the cameras in order. The site file declares latencies of 8 ms, within half a millisecond."""


def demo_scene() -> Scene:
    """The scene of the work sequence."""
    return write_shift(SEED, "indoor", _cameras)


def empty(scene: Scene) -> Scene:
    """The same room before work begins: nobody there and nothing but what belongs to the room."""
    return scene.model_copy(update={"workers": (), "things": (), "violations": ()})


def _cameras(rng: np.random.Generator, room: Room) -> tuple[SceneCamera, ...]:
    cameras = semicircle(rng, SIZE_WH, room, count=len(CLOCKS), fps=FPS, sensors=SENSORS)
    return tuple(
        camera.model_copy(update={"clock_offset_s": clock.stamp_offset_s, "clock_drift_ppm": clock.drift_ppm})
        for camera, clock in zip(cameras, CLOCKS, strict=True)
    )
