"""From a seed to a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tools.sicsg.assets import Split, draw
from tools.sicsg.lighting import light
from tools.sicsg.rooms import room
from tools.sicsg.scene import Light, LightKind, Room, Scene, SceneCamera
from tools.sicsg.story.fillers import busy, lying_about
from tools.sicsg.story.stage import Stage, StageFullError
from tools.sicsg.story.vignettes import hat, ladder, platform, window
from tools.sicsg.violations import timeline

VIGNETTES: dict[str, tuple[Callable[[Stage, float], None], int]] = {
    "hat": (hat, 1),
    "ladder": (ladder, 2),
    "window": (window, 2),
    "platform": (platform, 2),
}
"""Vignettes with the number of their workers."""
MAX_WORKERS, MAX_THINGS = 4, 14

_TRIES = 60
Cameras = Callable[[np.random.Generator, Room], tuple[SceneCamera, ...]]


def room_of(split: Split, rng: np.random.Generator) -> Room:
    """A room that the split may use."""
    return room(draw("room", split, rng), split)


def light_of(split: Split, rng: np.random.Generator, place: Room, kind: LightKind) -> Light:
    """A light rig for a room that the split may use."""
    return light(draw("light", split, rng), place, kind)


@dataclass(frozen=True, slots=True)
class Plot:
    """What a story is to hold; the seed gives everything that it leaves open."""

    split: Split
    """Which assets may be used."""
    acts: tuple[tuple[str, float], ...]
    """Vignettes with the share of the time that their violation takes; 0: a boundary negative."""
    light: LightKind
    cameras: Cameras
    """Makes the cameras, of random numbers and the room."""
    duration_s: float = 8.0
    workers: int = MAX_WORKERS
    """At most so many; those that the acts leave over do harmless things."""
    things: int = MAX_THINGS
    """At most so many objects, hats included."""
    hatless: float = 0.0
    """Chance that a worker who does harmless things wears no hat (for training; it makes a violation)."""


def write_story(seed: int, plot: Plot) -> Scene:
    """Write the scene of a seed.

    Raises:
        StageFullError: where its acts do not fit on any of many stages.
    """
    for attempt in range(_TRIES):
        rng = np.random.default_rng((seed, attempt))
        try:
            return _written(rng, seed, plot)
        except StageFullError:
            continue
    raise StageFullError(f"seed {seed}: no room holds {plot.acts}")


def _written(rng: np.random.Generator, seed: int, plot: Plot) -> Scene:
    place = room_of(plot.split, rng)
    stage = Stage(rng, plot.split, place, plot.duration_s)
    for name, share in plot.acts:
        VIGNETTES[name][0](stage, share)
    while len(stage.workers) < plot.workers and len(stage.things) < plot.things:
        busy(stage, hatted=rng.random() >= plot.hatless)
    lying_about(stage, plot.things - len(stage.things))
    if len(stage.workers) > MAX_WORKERS or len(stage.things) > MAX_THINGS:
        raise StageFullError
    scene = Scene(
        seed=seed,
        split=plot.split,
        story="+".join(name for name, _ in plot.acts) or "work",
        duration_s=plot.duration_s,
        room=place,
        light=light_of(plot.split, rng, place, plot.light),
        things=tuple(stage.things),
        workers=tuple(stage.workers),
        cameras=plot.cameras(rng, place),
        violations=(),
    )
    return scene.model_copy(update={"violations": timeline(scene)})
