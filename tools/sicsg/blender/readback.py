"""A render as an array.

Blender gives no access to the pixels of a render in the background other than a file. Of what it can write, an OpenEXR
file without compression in memory is the quickest.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

sys.path.append(bpy.utils.resource_path("LOCAL") + "/python/lib/python3.11/site-packages")
import OpenImageIO  # comes with bpy, outside Python's search path


def render_exr(scene: bpy.types.Scene, path: Path) -> dict[str, NDArray[np.float32]]:
    """Render a scene through a file that is removed again: (H, W) by channel name, row 0 on top."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(scene=scene.name, write_still=True)
    source = OpenImageIO.ImageInput.open(str(path))
    if source is None:
        raise OSError(f"{path}: {OpenImageIO.geterror()}")
    pixels = source.read_image(OpenImageIO.FLOAT)
    names = source.spec().channelnames
    source.close()
    path.unlink()
    return {name: pixels[..., place] for place, name in enumerate(names)}
