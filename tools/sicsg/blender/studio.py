"""The jobs: what each message of ``worker.py`` does."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from tools.sicsg.blender.camera import set_camera
from tools.sicsg.blender.engine import pass_scene, pick_device, picture_scene
from tools.sicsg.blender.readback import render_exr
from tools.sicsg.blender.stage import Stage
from tools.sicsg.blender.wire import Arrays

NOTHING_M = 1e9
"""Depths beyond it are Cycles' number for no surface at all."""


class Studio:
    """A stage, a camera and the two ways to look through it."""

    def __init__(self, folder: Path) -> None:
        self.device = pick_device()
        self._file = folder / "render.exr"
        self._stage = Stage()
        camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self._stage.collection.objects.link(camera)
        self._picture = picture_scene(self.device, self._stage.collection, camera)
        self._picture.world = self._stage.sky.world
        self._passes = pass_scene(self.device, self._stage.collection, camera)

    def do(self, job: dict[str, Any], arrays: Arrays) -> Arrays | None:
        """Do a job; what to answer, if anything."""
        match job["do"]:
            case "texture":
                self._stage.add_texture(job["name"], arrays["srgb"])
            case "mesh":
                self._stage.add_mesh(job["key"], job["materials"], arrays)
            case "vertices":
                self._stage.move_vertices(job["key"], arrays["vertices_m"])
            case "drop":
                self._stage.drop_mesh(job["key"])
            case "render":
                return self._render(job, arrays)
            case "passes":
                return self._look(job, arrays)
        return None

    def _render(self, job: dict[str, Any], arrays: Arrays) -> Arrays:
        """One picture per view, ``"0"``, ``"1"``, ...: (H, W, 3) linear radiance."""
        self._stage.place(job["keys"], job["entities"], arrays["world_from_mesh"])
        self._stage.light(job["light"])
        self._picture.cycles.samples = job["samples"]
        pictures: Arrays = {}
        for place, size in enumerate(job["sizes_wh"]):
            matrix, cam_from_world = arrays["matrix"][place], arrays["cam_from_world"][place]
            # noise that differs between cameras and times, and is the same each time that a view is rendered
            self._picture.cycles.seed = zlib.crc32(cam_from_world.tobytes() + arrays["world_from_mesh"].tobytes()) >> 1
            set_camera(self._picture, size, matrix, cam_from_world)
            # a new scene is taken over afresh: what Cycles has kept is in another order, which changes the noise
            self._picture.render.use_persistent_data = not self._stage.is_new
            self._stage.is_new = False
            channels = render_exr(self._picture, self._file)
            pictures[str(place)] = np.stack([channels[name] for name in "RGB"], axis=-1)
        return pictures

    def _look(self, job: dict[str, Any], arrays: Arrays) -> Arrays:
        """``ids`` (H, W) int32 and ``depth_m`` (H, W), infinite where there is nothing."""
        self._stage.place(job["keys"], job["entities"], arrays["world_from_mesh"])
        set_camera(self._passes, job["size_wh"], arrays["matrix"], arrays["cam_from_world"])
        channels = {name.partition(".")[2]: array for name, array in render_exr(self._passes, self._file).items()}
        depth = channels["Depth.Z"]
        ids = channels["Object Index.X"].astype(np.int32)
        return {"ids": ids, "depth_m": np.where(depth < NOTHING_M, depth, np.float32(np.inf))}
