"""Chooses the evaluation sequences: which acts, lights and seeds; the scene files it writes are committed.

Of several seeds for each place in the plan one is taken whose violations last as asked for; for every second place the
one in which the front camera sees least of what decides, so that one view cannot be enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from tools.sicsg.assets import Split
from tools.sicsg.cameras import Sensors, semicircle
from tools.sicsg.dataset import FIRST_SEED, LIGHTS
from tools.sicsg.photograph import Photographer
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.scene import LightKind, Scene, SceneCamera, Violation, write_scene
from tools.sicsg.sequences import SCENES
from tools.sicsg.skeleton import JOINTS
from tools.sicsg.story import Plot, StageFullError, write_story
from tools.sicsg.truth import Visibility

FRONT = 0
"""The camera in front, which the paper's single-view baseline uses."""
CRITICAL = {
    "no_hat": ("nose", "left_ear", "right_ear"),
    "ladder": ("left_ankle", "right_ankle"),
    "window": ("left_wrist", "right_wrist"),
    "platform": ("left_ankle", "right_ankle"),
}
"""Joints of the workers concerned that decide about a violation."""
_SENSORS = Sensors(exposure_s=(1 / 250, 1 / 60))
_PAIRS = tuple(combinations(("hat", "ladder", "window", "platform"), 2))
_SHARES = (0.35, 0.65)
_CANDIDATES = 10
SIZE_WH = {"gl": (1280, 720), "cycles": (768, 432)}
"""Size of the pictures by renderer; a path traced picture costs ten times as much."""
_LOOKS = 10
"""Instants at which a candidate's front view is looked at."""


@dataclass(frozen=True, slots=True)
class Place:
    """A place in the plan."""

    number: int
    acts: tuple[tuple[str, float], ...]
    light: LightKind
    hidden: bool
    """Whether to take the candidate whose front view is the poorest."""

    @property
    def renderer(self) -> str:
        """Every third sequence is made by the path tracer."""
        return "cycles" if self.number % 3 == 0 else "gl"


def plan(count: int, seed: int) -> tuple[Place, ...]:
    """The places of a half: all pairs of vignettes, all lights; in a quarter of them one vignette is a negative."""
    rng = np.random.default_rng(seed)
    places = []
    for number in range(count):
        pair = _PAIRS[number % len(_PAIRS)]
        shares = [float(rng.uniform(0.42, 0.58)) for _ in pair]
        if number % 4 == 3:
            shares[int(rng.integers(2))] = 0.0
        light = LIGHTS[(number + number // len(LIGHTS)) % len(LIGHTS)]
        places.append(Place(number, tuple(zip(pair, shares, strict=True)), light, number % 2 == 0))
    return tuple(places)


def sequence_cameras(
    fps: float, size_wh: tuple[int, int]
) -> Callable[[np.random.Generator, Any], tuple[SceneCamera, ...]]:
    """Four cameras as the paper has them, triggered together but for their clocks."""

    def cameras(rng: np.random.Generator, room: Any) -> tuple[SceneCamera, ...]:
        return semicircle(rng, size_wh, room, count=4, fps=fps, clocks=True, sensors=_SENSORS)

    return cameras


def choose(
    place: Place, split: Split, passes: GlRenderer, *, fps: float, size_wh: tuple[int, int], tries: int
) -> Scene:
    """The scene for a place: of ``tries`` seeds one that keeps to what the plan asks for.

    Raises:
        StageFullError: where none does.
    """
    best: tuple[float, Scene] | None = None
    for candidate in range(tries):
        seed = FIRST_SEED[split] + 50_000 + place.number * 100 + candidate
        try:
            scene = write_story(seed, Plot(split, place.acts, place.light, sequence_cameras(fps, size_wh)))
        except StageFullError:
            continue
        if not keeps_to(place, scene):
            continue
        hidden = hidden_share(scene, passes)
        if best is None or (place.hidden and hidden > best[0]):
            best = hidden, scene
        if not place.hidden:
            break
    if best is None:
        raise StageFullError
    return best[1]


_KIND = {"hat": "no_hat", "ladder": "ladder", "window": "window", "platform": "platform"}


def keeps_to(place: Place, scene: Scene) -> bool:
    """Whether the violations that come of the story are those of the plan, for as long as it asks."""
    wanted = {_KIND[name] for name, share in place.acts if share > 0}
    if {violation.kind for violation in scene.violations} != wanted:
        return False
    return all(_SHARES[0] <= share_of(scene, kind) <= _SHARES[1] for kind in wanted)


def share_of(scene: Scene, kind: str) -> float:
    """Part of the scene's time in which there is a violation of a kind."""
    times = np.linspace(0, scene.duration_s, 400, endpoint=False)
    found = [any(v.kind == kind and v.start_s <= t < v.end_s for v in scene.violations) for t in times]
    return float(np.mean(found))


def hidden_share(scene: Scene, passes: GlRenderer) -> float:
    """Part of the violating instants at which the front camera sees none of what decides about a violation."""
    times = np.linspace(0, scene.duration_s, _LOOKS, endpoint=False)
    busy = [(t, [v for v in scene.violations if v.start_s <= t < v.end_s]) for t in times.tolist()]
    photographer = Photographer(scene, passes, passes)
    hidden = [is_hidden(scene, photographer, t, open_now) for t, open_now in busy if open_now]
    return float(np.mean(hidden)) if hidden else 0.0


def is_hidden(scene: Scene, photographer: Photographer, t_s: float, violations: list[Violation]) -> bool:
    """Whether the front camera sees none of the deciding joints of some violation."""
    people, _ = photographer.truth(scene.cameras[FRONT], t_s)
    seen = {person.id: person.visibility == Visibility.VISIBLE for person in people}
    for violation in violations:
        joints = [JOINTS.index(name) for name in CRITICAL[violation.kind]]
        if not any(seen[worker][joints].any() for worker in violation.workers):
            return True
    return False


def write_plan(split: Split, count: int, *, fps: float = 5.0) -> list[Path]:
    """Choose and write the scene files of a half that are not there yet; name: number, acts, renderer."""
    folder = SCENES / split
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with GlRenderer() as passes:
        for place in plan(count, FIRST_SEED[split]):
            name = f"{place.number:02d}-{'-'.join(name for name, _ in place.acts)}-{place.light}-{place.renderer}"
            path = folder / f"{name}.scene.json"
            if not path.exists():
                write_scene(
                    choose(place, split, passes, fps=fps, size_wh=SIZE_WH[place.renderer], tries=_CANDIDATES), path
                )
            written.append(path)
    return written
