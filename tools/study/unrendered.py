"""Sequences without pictures: the truth of a scene file as a rendered sequence has it, of id and depth passes alone.

What the study asks of a sequence is where everything is and what hides it, of no pixel its colour. So a scene file is
enough: for evaluation sequences that nobody rendered, and for hours of safe work that nobody would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Floats
from tools.sicsg.mesh import Instance, View
from tools.sicsg.moment import Moment, moment
from tools.sicsg.photograph import Photographer, Picture
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.scene import Light, Scene, SceneCamera, write_scene
from tools.sicsg.sequences import arrays_of, facts_of, frame_times, write_truth
from tools.sicsg.truth import PersonTruth, ThingTruth, project


class _Dark:
    """A renderer of black pictures."""

    def render_many(self, drawn: Sequence[Instance], light: Light, views: Sequence[View]) -> list[NDArray[np.float32]]:
        """(H, W, 3) zeros of each view."""
        del drawn, light
        return [np.zeros((view.size_wh[1], view.size_wh[0], 3), dtype=np.float32) for view in views]


def write_unrendered(scene: Scene, folder: Path, passes: GlRenderer, *, shrink: int = 1, every: int = 1) -> None:
    """Write a sequence's folder without its videos, where it is not there yet.

    Args:
        scene: The scene, whose cameras take their pictures together.
        folder: Of the sequence.
        passes: Makes the id and depth passes.
        shrink: The passes are of pictures so many times smaller along each side; the truth is in full pixels.
        every: What hides what is looked at at every so many instants, and holds until the next look; boxes move on
            with what they bound.

    Raises:
        ValueError: where the cameras take their pictures at different times.
    """
    if (folder / "truth.json").exists():
        return
    times = {camera.id: frame_times(scene, camera) for camera in scene.cameras}
    t_s = times[scene.cameras[0].id]
    if any(not np.array_equal(t_s, own) for own in times.values()):
        raise ValueError(f"{folder.name}: its cameras take their pictures at different times; render it")
    small = scene.model_copy(update={"cameras": tuple(_shrunk(camera, shrink) for camera in scene.cameras)})
    photographer = Photographer(small, _Dark(), passes)
    taken: list[list[Picture]] = []
    then = moment(scene, float(t_s[0]))
    for number, at_s in enumerate(t_s.tolist()):
        now = moment(scene, at_s)
        if number % every == 0:
            looked = photographer.take(small.cameras, at_s, hidden_parts=True)
            taken.append([_grown(p, c, shrink) for p, c in zip(looked, scene.cameras, strict=True)])
        else:
            taken.append([_moved(picture, then, now) for picture in taken[-1]])
        then = now
    folder.mkdir(parents=True, exist_ok=True)
    write_scene(scene, folder / "scene.json")
    write_truth(folder, scene, folder.name, times, facts_of(scene, taken), arrays_of(scene, taken))


def _shrunk(camera: SceneCamera, by: int) -> SceneCamera:
    """The camera with so many times fewer pixels along each side."""
    scaled = {
        name: {"f": value / by, "c": (value + 0.5) / by - 0.5}.get(name[0], value) if len(name) == 2 else value
        for name, value in camera.coefficients.items()
    }
    size_wh = (camera.size_wh[0] // by, camera.size_wh[1] // by)
    return camera.model_copy(update={"size_wh": size_wh, "coefficients": scaled})


def _grown(picture: Picture, camera: SceneCamera, by: int) -> Picture:
    """The picture's truth in the pixels of a camera that has so many times more."""
    people = [
        replace(p, joints_px=_full(p.joints_px, by), box=_box(p.box, by), pixels=p.pixels * by**2)
        for p in picture.people
    ]
    things = [
        replace(t, keypoints_px=_full(t.keypoints_px, by), box=_box(t.box, by), pixels=t.pixels * by**2)
        for t in picture.things
    ]
    full = {name: count * by**2 for name, count in picture.full_pixels.items()}
    return replace(picture, camera=camera, people=people, things=things, full_pixels=full)


def _full(points_px: Floats, by: int) -> Floats:
    return np.asarray((points_px + 0.5) * by - 0.5)


def _box(box: Floats | None, by: int) -> Floats | None:
    return None if box is None else _full(box, by)


def _moved(picture: Picture, then: Moment, now: Moment) -> Picture:
    """The picture a little later, as if what hides what had not changed."""

    def shift(before_m: Floats, after_m: Floats) -> Floats:
        (before, after), _ = project(picture.camera, np.array([before_m, after_m]))
        return np.asarray(np.tile(after - before, 2))

    def person(one: PersonTruth) -> PersonTruth:
        before_m, after_m = then.workers[one.id].joints_m, now.workers[one.id].joints_m
        by, joints_px = shift(before_m.mean(axis=0), after_m.mean(axis=0)), project(picture.camera, after_m)[0]
        return replace(one, joints_px=joints_px, box=None if one.box is None else one.box + by)

    def thing(one: ThingTruth) -> ThingTruth:
        by = shift(then.poses[one.id][:3, 3], now.poses[one.id][:3, 3])
        return replace(one, keypoints_px=one.keypoints_px + by[:2], box=None if one.box is None else one.box + by)

    people, things = [person(one) for one in picture.people], [thing(one) for one in picture.things]
    return replace(picture, t_s=now.t_s, people=people, things=things)
