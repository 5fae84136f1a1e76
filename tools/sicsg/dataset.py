"""Training and validation images in bulk: made from seeds, resumable, one process per core.

``FOLDER/scenes/SEED.json`` is the scene file, ``FOLDER/images/SEED_CAMERA_K.jpg`` its pictures,
``FOLDER/annotations/SEED.json`` its part of the annotations, written last: a scene that has it is finished.
``FOLDER/coco_SPLIT.json`` joins them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np

from tools.sicsg.assets import Split
from tools.sicsg.cameras import Sensors, anywhere, semicircle
from tools.sicsg.coco import annotations, categories
from tools.sicsg.photograph import Photographer, Renderer, renderer_of
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.scene import LightKind, Scene, SceneCamera, write_scene
from tools.sicsg.story import Plot, write_story
from tools.sicsg.story.write import VIGNETTES

LIGHTS: tuple[LightKind, ...] = get_args(LightKind)
_SENSORS = Sensors(exposure_s=(1 / 250, 1 / 60))
"""Longer exposures cost a picture each; training blurs what it is shown by itself."""
_HATLESS = 0.35
FIRST_SEED = {"train": 100_000, "validation": 200_000, "test": 300_000}


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a data set consists of."""

    split: Split
    scenes: int
    renderer: str
    """``gl`` or ``cycles``."""
    size_wh: tuple[int, int] = (960, 540)
    cameras: int = 4
    moments: int = 3
    """Times at which each camera takes a picture."""
    first: int = 0
    """Number of the first scene, so that parts can be made by different renderers."""
    samples: int = 4
    """Samples a pixel of the path tracer."""

    def seed(self, index: int) -> int:
        """Seed of a scene of this data set."""
        return FIRST_SEED[self.split] + self.first + index


def training_scene(recipe: Recipe, index: int) -> Scene:
    """The scene of a number: acts, light and cameras drawn at random."""
    seed = recipe.seed(index)
    rng = np.random.default_rng((seed, 1))
    names = list(VIGNETTES)
    rng.shuffle(names)
    acts, crew = [], 0
    for name in names[: int(rng.integers(1, 3))]:
        if crew + VIGNETTES[name][1] <= 4:
            acts.append((name, float(rng.choice([0.0, 0.5, 0.6]))))
            crew += VIGNETTES[name][1]

    def cameras(draw: np.random.Generator, room: Any) -> tuple[SceneCamera, ...]:
        make = semicircle if index % 2 == 0 else anywhere
        return make(draw, recipe.size_wh, room, count=recipe.cameras, sensors=_SENSORS)

    crowd, clutter = int(rng.integers(2, 5)), int(rng.integers(9, 15))
    light = LIGHTS[index % len(LIGHTS)]
    plot = Plot(recipe.split, tuple(acts), light, cameras, workers=crowd, things=clutter, hatless=_HATLESS)
    return write_story(seed, plot)


def make_scene(recipe: Recipe, index: int, folder: Path, renderer: Renderer, passes: GlRenderer) -> None:
    """Write scene, pictures and annotations of a number."""
    seed = recipe.seed(index)
    done = folder / "annotations" / f"{seed}.json"
    if done.exists():
        return
    scene = training_scene(recipe, index)
    write_scene(scene, folder / "scenes" / f"{seed}.json")
    rng = np.random.default_rng((seed, 2))
    photographer = Photographer(scene, renderer, passes)
    images, notes = [], []
    for number, t_s in enumerate(np.sort(rng.uniform(0.0, scene.duration_s, recipe.moments))):
        for picture in photographer.take(scene.cameras, float(t_s), hidden_parts=True):
            name = f"{seed}_{picture.camera.id}_{number}.jpg"
            quality = [cv2.IMWRITE_JPEG_QUALITY, picture.camera.quality]
            cv2.imwrite(str(folder / "images" / name), picture.image_bgr, quality)
            width, height = picture.camera.size_wh
            images.append(
                {
                    "file_name": name, "width": width, "height": height, "scene": str(seed), "t_s": float(t_s),
                    "camera": picture.camera.id, "light": scene.light.kind, "renderer": recipe.renderer,
                }
            )  # fmt: skip
            notes.append(annotations(picture))
    done.write_text(json.dumps({"images": images, "annotations": notes}))


def make_dataset(recipe: Recipe, folder: Path, *, jobs: int, say: Callable[[str], None]) -> Path:
    """Make what is still missing of a data set and join the annotations; returns the COCO file."""
    for part in ("scenes", "images", "annotations"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    missing = [k for k in range(recipe.scenes) if not (folder / "annotations" / f"{recipe.seed(k)}.json").exists()]
    with ProcessPoolExecutor(jobs) as pool:
        parts = [pool.submit(_make_part, recipe, missing[k::jobs], folder) for k in range(jobs)]
        for part in parts:
            part.result()
    say(f"{recipe.scenes} scenes, of which {len(missing)} are new")
    return join_parts(folder, recipe.split)


def _make_part(recipe: Recipe, indices: list[int], folder: Path) -> None:
    cv2.setNumThreads(1)
    with GlRenderer() as passes, renderer_of(recipe.renderer, passes, samples=recipe.samples) as renderer:
        for index in indices:
            make_scene(recipe, index, folder, renderer, passes)


def join_parts(folder: Path, split: Split) -> Path:
    """Join the annotations of all finished scenes of a split into one COCO file."""
    images: list[dict[str, Any]] = []
    notes: list[dict[str, Any]] = []
    first, end = FIRST_SEED[split], FIRST_SEED[split] + 100_000
    for part in sorted((folder / "annotations").glob("*.json")):
        if not first <= int(part.stem) < end:
            continue
        content = json.loads(part.read_text())
        for image, found in zip(content["images"], content["annotations"], strict=True):
            start = len(notes)
            images.append(image | {"id": len(images)})
            for note in found:
                worn_by = None if note["worn_by"] is None else note["worn_by"] + start
                notes.append(note | {"id": start + note["id"], "image_id": images[-1]["id"], "worn_by": worn_by})
    path = folder / f"coco_{split}.json"
    path.write_text(json.dumps({"images": images, "annotations": notes, "categories": categories()}))
    return path
