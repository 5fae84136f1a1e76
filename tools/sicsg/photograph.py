"""Pictures of a scene with their truth: render, distort, expose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Instance, View
from tools.sicsg.moment import Moment, entities, instances, moment
from tools.sicsg.rendering.cycles import CyclesRenderer
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.rendering.lens import LensMap
from tools.sicsg.rendering.sensor import expose, metered_exposure
from tools.sicsg.scene import Light, Scene, SceneCamera, Thing
from tools.sicsg.truth import Passes, PersonTruth, ThingTruth, truth_of_view

_SMALL = 4
"""Silhouettes that measure how much of something is hidden are drawn at this fraction of the resolution."""
_STILL_S = 1 / 60
"""An exposure longer than it is the mean of several pictures, none of which stands for more."""


class Renderer(Protocol):
    """Draws the same instances for several cameras."""

    def render_many(self, drawn: Sequence[Instance], light: Light, views: Sequence[View]) -> list[NDArray[np.float32]]:
        """Linear radiance (H, W, 3) of each view."""
        ...


@contextmanager
def renderer_of(name: str, passes: GlRenderer, *, samples: int = 4) -> Iterator[Renderer]:
    """``gl``: the fast path, which is ``passes`` itself; ``cycles``: the path tracer with so many samples a pixel."""
    if name == "gl":
        yield passes
        return
    with CyclesRenderer(samples=samples) as cycles:
        yield cycles


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A camera's picture with what is true of it."""

    camera: SceneCamera
    t_s: float
    image_bgr: NDArray[np.uint8]
    people: list[PersonTruth]
    things: list[ThingTruth]
    full_pixels: dict[str, int]
    """About how many pixels each worker (hat included) and thing would have, were nothing before it; by id."""


class Photographer:
    """Takes pictures of one scene, each camera with one exposure throughout.

    Args:
        scene: the scene.
        renderer: makes the pictures.
        passes: makes the id and depth passes.
    """

    def __init__(self, scene: Scene, renderer: Renderer, passes: GlRenderer) -> None:
        self.scene, self._renderer, self._passes = scene, renderer, passes
        self._lenses = {camera.id: LensMap(camera) for camera in scene.cameras}
        self._exposure: dict[str, float] = {}

    def take(self, cameras: Sequence[SceneCamera], t_s: float, *, hidden_parts: bool = False) -> list[Picture]:
        """What these cameras see at one time.

        Args:
            cameras: some of the scene's cameras.
            t_s: true time of mid-exposure.
            hidden_parts: whether to fill ``Picture.full_pixels``.
        """
        now = moment(self.scene, t_s)
        drawn = instances(self.scene, now)
        radiance = self._blurred(cameras, t_s, drawn)
        return [
            self._picture(camera, now, drawn, light, hidden_parts)
            for camera, light in zip(cameras, radiance, strict=True)
        ]

    def truth(self, camera: SceneCamera, t_s: float) -> tuple[list[PersonTruth], list[ThingTruth]]:
        """What is true of a picture, without the picture."""
        now = moment(self.scene, t_s)
        return truth_of_view(self.scene, now, camera, self._seen(camera, instances(self.scene, now)))

    def _blurred(self, cameras: Sequence[SceneCamera], t_s: float, drawn: list[Instance]) -> list[NDArray[np.float32]]:
        views = [self._lenses[camera.id].view for camera in cameras]
        longest = max(camera.exposure_s for camera in cameras)
        if longest <= _STILL_S:
            return self._renderer.render_many(drawn, self.scene.light, views)
        count = int(np.ceil(longest / _STILL_S))
        total: list[NDArray[np.float32]] | None = None
        for step in range(count):
            shift = ((step + 0.5) / count - 0.5) * longest
            moved = instances(self.scene, moment(self.scene, t_s + shift))
            part = self._renderer.render_many(moved, self.scene.light, views)
            total = part if total is None else [one + two for one, two in zip(total, part, strict=True)]
        return [image / np.float32(count) for image in total or []]

    def _picture(
        self, camera: SceneCamera, now: Moment, drawn: list[Instance], radiance: NDArray[np.float32], hidden_parts: bool
    ) -> Picture:
        light = self._lenses[camera.id].distort(radiance)
        if camera.id not in self._exposure:
            self._exposure[camera.id] = metered_exposure(light, self.scene.light, camera)
        # One seed for scene, camera and instant, so that a picture is the same whenever and wherever it is taken.
        rng = np.random.default_rng((self.scene.seed, self.scene.cameras.index(camera), round(now.t_s * 1e6)))
        image = expose(light, self.scene.light, camera, rng, exposure=self._exposure[camera.id])
        people, things = truth_of_view(self.scene, now, camera, self._seen(camera, drawn))
        full = self._full_pixels(camera, now, drawn) if hidden_parts else {}
        return Picture(camera, now.t_s, image, people, things, full)

    def _seen(self, camera: SceneCamera, drawn: list[Instance]) -> Passes:
        lens = self._lenses[camera.id]
        ids, depth = self._passes.passes(drawn, lens.view)
        return Passes(lens.distort_nearest(ids), lens.distort_nearest(depth))

    def _full_pixels(self, camera: SceneCamera, now: Moment, drawn: list[Instance]) -> dict[str, int]:
        view = self._lenses[camera.id].view
        matrix = view.matrix.copy()
        matrix[:2, 2] += 0.5
        matrix[:2] /= _SMALL
        matrix[:2, 2] -= 0.5
        small = View((view.size_wh[0] // _SMALL, view.size_wh[1] // _SMALL), matrix, view.cam_from_world)
        number = entities(self.scene)
        by_entity = {instance.entity: instance for instance in drawn if instance.entity}
        # The oversized render has other pixels than the picture: sizes are compared within the render.
        scale = _SMALL**2 * (camera.size_wh[0] * camera.size_wh[1]) / (view.size_wh[0] * view.size_wh[1])
        alone = {}
        for name, entity in number.items():
            parts = [by_entity[entity]]
            parts += [by_entity[number[t.id]] for t in self.scene.things if _worn_by(t, now.t_s) == name]
            ids, _ = self._passes.passes(parts, small)
            alone[name] = int(np.count_nonzero(ids) * scale)
        return alone


def _worn_by(thing: Thing, t_s: float) -> str | None:
    holder = thing.holder(t_s)
    return holder.worker if holder is not None and holder.bone == "head" else None
