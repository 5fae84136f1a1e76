"""A pinhole camera as Blender's: K becomes lens, shift and pixel aspect."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

SENSOR_MM = 36.0
NEAR_M, FAR_M = 0.02, 500.0


def set_camera(
    scene: bpy.types.Scene, size_wh: tuple[int, int], matrix: NDArray[np.float64], cam_from_world: NDArray[np.float64]
) -> None:
    """Make the scene's camera and resolution those of a view.

    Args:
        scene: has a camera already.
        size_wh: width and height in pixels.
        matrix: (3, 3) K in pixels, pixel (0, 0) the centre of the top-left one.
        cam_from_world: (4, 4), axes x right, y down, z forward.
    """
    (width, height), (fx, fy) = size_wh, (matrix[0, 0], matrix[1, 1])
    render, lens = scene.render, scene.camera.data
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, fy / fx), max(1.0, fx / fy)
    lens.sensor_fit, lens.sensor_width = "HORIZONTAL", SENSOR_MM
    lens.lens = fx * SENSOR_MM / width
    lens.clip_start, lens.clip_end = NEAR_M, FAR_M
    lens.shift_x = ((width - 1) / 2 - matrix[0, 2]) / width
    lens.shift_y = (matrix[1, 2] - (height - 1) / 2) * (fx / fy) / width
    world_from_cam = np.linalg.inv(cam_from_world)
    world_from_cam[:, 1:3] *= -1.0  # Blender's camera looks along -z with y up
    scene.camera.matrix_world = world_from_cam.T.tolist()
