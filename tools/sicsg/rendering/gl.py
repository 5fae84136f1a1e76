"""The fast path: instances to linear radiance, ids and depth by OpenGL without a window.

A rasteriser instead of a path tracer, for bulk data on CPUs: rectangular lamps and windows of which three have soft
shadows, sun with a shadow map, a uniform surround with screen-space ambient occlusion in place of further bounces.
Glass is drawn last; in the id and depth passes it is opaque. Pictures are drawn with the image's first row in the
framebuffer's first row: nothing is flipped.

On llvmpipe shading is what costs, and samples along edges are nearly free. So the light is found at half size, and
surfaces are drawn under it at full size with four samples along edges: 0.40 s of CPU at 1280x720 (48,000 triangles, ten
lamps and windows) where light at full size took 1.0 s; 0.77 s at 1920x1080; 0.1 s more when something has moved and
shadow maps are made again; 0.03 s for the passes. The first picture with a new number of lamps and windows takes one to
three seconds more, for compiling. Against the path tracer, on one view of each of four scenes, the logarithm of
radiance correlates by 0.96 (indoor), 0.75 (back-lit), 0.86 (over-exposed) and 0.92 (dusk): least where daylight
comes by many windows, of which one throws shadows.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, TypeVar

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Instance, View
from tools.sicsg.rendering.gl_draw import columns, drawn_near_first, in_view, start
from tools.sicsg.rendering.gl_meshes import MeshStore, Tiles, TileStore
from tools.sicsg.rendering.gl_shaders import assign, compiled
from tools.sicsg.rendering.gl_shading import Shading, clip_from_world
from tools.sicsg.rendering.gl_shadows import Shadows
from tools.sicsg.rendering.gl_targets import PassesTarget, Radiance
from tools.sicsg.scene import Light
from tools.sicsg.textures import texture

KEPT_TARGETS = 6
"""Sizes of pictures for which memory is kept: 100 bytes a pixel each."""
Target = TypeVar("Target", Radiance, PassesTarget)


class GlUnavailableError(RuntimeError):
    """OpenGL without a window cannot be had here."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"no OpenGL context through EGL: {reason}. The fast path needs OpenGL 4.5; on machines without a GPU "
            "Mesa's llvmpipe gives it (Debian and Ubuntu: libegl1 libgl1-mesa-dri); or render with the path tracer"
        )


class GlRenderer:
    """Draws instances; a context manager. Meshes that come back as the same objects are uploaded once.

    Args:
        tiles: (512, 512, 3) uint8 sRGB image of a texture's name.

    Raises:
        GlUnavailableError: when there is no EGL or its OpenGL is older than 4.5.
    """

    def __init__(self, tiles: Tiles = texture) -> None:
        try:
            self._context = moderngl.create_context(standalone=True, require=450, backend="egl")
        except (ImportError, OSError, RuntimeError, ValueError) as error:
            raise GlUnavailableError(str(error)) from error
        with self._context:
            self._prepare(tiles)

    def _prepare(self, tiles: Tiles) -> None:
        self._tiles = TileStore(self._context, tiles)
        self._meshes = MeshStore(self._context, self._tiles)
        self._shadows = Shadows(self._context)
        self._shading = Shading(self._context, self._shadows)
        self._passes = compiled(self._context, "plain", "passes")
        self._radiance: OrderedDict[tuple[int, int], Radiance] = OrderedDict()
        self._passed: OrderedDict[tuple[int, int], PassesTarget] = OrderedDict()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._context.release()

    def render(
        self, instances: Sequence[Instance], light: Light, view: View, *, supersample: float = 1.0
    ) -> NDArray[np.float32]:
        """(H, W, 3) linear radiance, RGB; 1.0 is a white wall under normal room light.

        Args:
            instances: what there is.
            light: the light rig.
            view: the camera.
            supersample: shaded pixels per pixel along each axis; edges have four samples a pixel anyway.

        Raises:
            ValueError: for more lamps, windows or textures than the renderer takes.
        """
        width, height = (max(1, round(n * supersample)) for n in view.size_wh)
        with self._context:
            target = self._kept(self._radiance, Radiance.new, (width, height))
            things = drawn_near_first(instances, view, self._meshes)
            lit = self._shadows.cast(things, light)
            shown = in_view(things, clip_from_world(view))
            self._shading.light(shown, lit, view, target)
            self._shading.surfaces(shown, lit, view, target, self._tiles.ready())
            self._context.copy_framebuffer(target.resolved, target.drawn)
            pixels = np.frombuffer(target.resolved.read(components=4, dtype="f2"), np.float16)
        image = pixels.reshape(height, width, 4)[:, :, :3].astype(np.float32)
        if (width, height) != tuple(view.size_wh):
            image = np.asarray(cv2.resize(image, view.size_wh, interpolation=cv2.INTER_AREA), dtype=np.float32)
        return image

    def render_many(
        self, instances: Sequence[Instance], light: Light, views: Sequence[View]
    ) -> list[NDArray[np.float32]]:
        """:meth:`render` of each view; they share the shadow maps."""
        return [self.render(instances, light, view) for view in views]

    def passes(self, instances: Sequence[Instance], view: View) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Entity (H, W) and z-depth (H, W) in metres (inf where there is nothing) at the pixels' centres.

        Glass is opaque here.
        """
        width, height = view.size_wh
        with self._context:
            target = self._kept(self._passed, PassesTarget.new, (width, height)).drawn
            start(self._context, target)
            target.clear(color=(0.0, 0.0, 0.0, 0.0))
            clip = clip_from_world(view)
            assign(self._passes, depth_row=tuple(view.cam_from_world[2]), clip_from_world=columns(clip))
            for thing in in_view(drawn_near_first(instances, view, self._meshes), clip):
                assign(self._passes, entity=thing.instance.entity)
                thing.draw(self._context, self._passes, thing.whole)
            read = [target.read(components=1, attachment=i, dtype=kind) for i, kind in enumerate(("i4", "f4"))]
        ids = np.frombuffer(read[0], np.int32).reshape(height, width)
        depth = np.frombuffer(read[1], np.float32).reshape(height, width)
        return ids.copy(), np.where(depth > 0, depth, np.float32(np.inf))

    def _kept(
        self,
        kept: OrderedDict[tuple[int, int], Target],
        new: Callable[[moderngl.Context, tuple[int, int]], Target],
        size_wh: tuple[int, int],
    ) -> Target:
        """The pictures of this size, the least recently used ones given back."""
        if size_wh not in kept:
            kept[size_wh] = new(self._context, size_wh)
            if len(kept) > KEPT_TARGETS:
                kept.popitem(last=False)[1].release()
        kept.move_to_end(size_wh)
        return kept[size_wh]
