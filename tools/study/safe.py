"""Hours of safe work: what is raised for nothing, which a few minutes of evaluation sequences cannot tell.

Scenes are those of the generator's stories whose acts hold no violation: two of a spare hat in the hand, a ladder that
is held or that nobody climbs, a window that two carry, and a platform with one on it and one beside; with others who
walk and work about. Everything in them looks like a violation and is none, so that there are more false alarms here
than in an hour of ordinary work. Nobody renders them: what a detector reports is simulated
(:mod:`tools.study.measured`) of truth that is looked at once a second; each scene is seen with several seeds of its
errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, count
from pathlib import Path

import numpy as np

from recognition.evaluation.violations import KINDS
from rigcal.geometry import Floats
from tools.sicsg.dataset import FIRST_SEED, LIGHTS
from tools.sicsg.planning import SIZE_WH, sequence_cameras
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.scene import Scene
from tools.sicsg.story import Plot, StageFullError, write_story
from tools.study.figures import Line
from tools.study.unrendered import write_unrendered

SAFE = "safe"
"""Axis of the lines of safe work."""
SCENE_S, FPS = 30.0, 5.0
_FIRST_SEED = FIRST_SEED["validation"] + 60_000
"""Beyond those of the evaluation sequences."""
_PAIRS = tuple(combinations(("hat", "ladder", "window", "platform"), 2))
_SHRINK, _EVERY = 4, 5
"""The truth's passes are of 320 x 180 pixels, once a second."""


def safe_scenes() -> Iterator[tuple[int, Scene]]:
    """Scenes without a violation, and their numbers: always the same ones; without end."""
    for number in count():
        acts = tuple((name, 0.0) for name in _PAIRS[number % len(_PAIRS)])
        cameras = sequence_cameras(FPS, SIZE_WH["gl"])
        plot = Plot("validation", acts, LIGHTS[number % len(LIGHTS)], cameras, duration_s=SCENE_S)
        try:
            scene = write_story(_FIRST_SEED + number, plot)
        except StageFullError:
            continue
        if not scene.violations:
            yield number, scene


def make_safe(folder: Path, minutes: float) -> tuple[Path, ...]:
    """Folders of so much safe work, as sequences without pictures; made where they are not there yet."""
    wanted, made = round(minutes * 60 / SCENE_S), sorted(path.parent for path in folder.glob("*/truth.json"))
    if len(made) < wanted:
        made = []
        with GlRenderer() as passes:
            for number, scene in safe_scenes():
                made.append(folder / f"{number:04d}-{scene.story}")
                write_unrendered(scene, made[-1], passes, shrink=_SHRINK, every=_EVERY)
                if len(made) == wanted:
                    break
    return tuple(made[:wanted])


@dataclass(frozen=True, slots=True, eq=False)
class FalseAlarms:
    """What was raised for nothing in hours of safe work."""

    detector: str
    hours: float
    scenes: int
    """Different ones, each with all seeds."""
    per_hour: Floats
    """(K,)"""
    whole: tuple[float, float, float]
    """Of all violations together per hour, and its 95 % interval over scenes (percentile bootstrap)."""


_DRAWS = 10_000


def false_alarms_of(lines: Sequence[Line]) -> Iterator[FalseAlarms]:
    """False alarms per hour of safe work, of each detector."""
    for detector in dict.fromkeys(line["detector"] for line in lines):
        own = [line for line in lines if line["detector"] == detector]
        names = sorted({line["sequence"] for line in own})
        alarms = np.array([np.sum([o["false_alarms"] for o in own if o["sequence"] == n], axis=0) for n in names])
        hours = np.array([sum(o["safe_s"][0] for o in own if o["sequence"] == n) / 3600 for n in names])
        often = np.random.default_rng(0).multinomial(len(names), [1 / len(names)] * len(names), size=_DRAWS)
        rates = (often @ alarms.sum(axis=1)) / (often @ hours)
        low, high = np.percentile(rates, [2.5, 97.5]).tolist()
        whole = (float(alarms.sum() / hours.sum()), low, high)
        yield FalseAlarms(detector, float(hours.sum()), len(names), alarms.sum(axis=0) / hours.sum(), whole)


def told(found: FalseAlarms) -> str:
    """A line for the report."""
    each = ", ".join(f"{kind} {rate:.1f}" for kind, rate in zip(KINDS, found.per_hour.tolist(), strict=True))
    rate, low, high = found.whole
    return (
        f"{found.detector}: {rate:.1f} an hour ({low:.1f} to {high:.1f}) in {60 * found.hours:.0f} min, "
        f"{found.scenes} scenes; {each}"
    )
