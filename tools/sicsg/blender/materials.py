"""Surfaces as shader nodes."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

UV = "surface_m"
"""Name of the meshes' texture coordinates, in metres."""
_GLASS_F0 = 0.04
"""Reflectance of glass at normal incidence, refractive index 1.5."""


def texture_image(name: str, srgb: NDArray[np.uint8]) -> bpy.types.Image:
    """An image of Blender's from (H, W, 3) sRGB, row 0 on top."""
    height, width = srgb.shape[:2]
    image = bpy.data.images.new(name, width, height)
    image.colorspace_settings.name = "sRGB"
    set_pixels(image, srgb / np.float32(255))
    return image


def set_pixels(image: bpy.types.Image, rgb: NDArray[np.float32]) -> None:
    """Give an image of Blender's its content (H, W, 3), row 0 on top, in the image's own colour space."""
    rgba = np.ones((*rgb.shape[:2], 4), dtype=np.float32)
    rgba[..., :3] = rgb[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()


class _Nodes:
    """A material's node tree, emptied."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        self._tree = self.material.node_tree
        self._tree.nodes.clear()

    def add(self, kind: str, **inputs: Any) -> bpy.types.Node:
        """A node; an input is a value or another node's output socket, by the input's name with _ for blanks."""
        node = self._tree.nodes.new(kind)
        for name, value in inputs.items():
            self.set(node.inputs[name.replace("_", " ")], value)
        return node

    def set(self, socket: bpy.types.NodeSocket, value: Any) -> None:
        """Give an input a value or link an output to it."""
        if isinstance(value, bpy.types.NodeSocket):
            self._tree.links.new(value, socket)
        else:
            socket.default_value = value

    def mix(self, share: Any, first: bpy.types.Node, second: bpy.types.Node) -> bpy.types.Node:
        """Two shaders mixed; share 1 is the second alone."""
        node = self.add("ShaderNodeMixShader", Fac=share)
        self.set(node.inputs[1], first.outputs[0])
        self.set(node.inputs[2], second.outputs[0])
        return node

    def math(self, operation: str, *values: Any) -> bpy.types.NodeSocket:
        """The output of a calculation."""
        node = self.add("ShaderNodeMath")
        node.operation = operation
        for place, value in enumerate(values):
            self.set(node.inputs[place], value)
        return node.outputs[0]


def make_material(name: str, surface: dict[str, Any], images: dict[str, bpy.types.Image]) -> bpy.types.Material:
    """A material from the fields of ``tools.sicsg.mesh.Material``; images by texture name."""
    nodes = _Nodes(name)
    colour = _colour(nodes, surface, images)
    shader = nodes.add(
        "ShaderNodeBsdfPrincipled",
        Base_Color=colour,
        Roughness=surface["roughness"],
        Metallic=surface["metallic"],
        Emission_Color=colour,
        Emission_Strength=surface["emission"],
    )
    if surface["transmission"] > 0:
        shader = nodes.mix(surface["transmission"], shader, _glass(nodes, colour, surface["roughness"]))
    nodes.add("ShaderNodeOutputMaterial", Surface=shader.outputs[0])
    return nodes.material


def _colour(nodes: _Nodes, surface: dict[str, Any], images: dict[str, bpy.types.Image]) -> Any:
    """The albedo: a colour, or the output of the texture times the colour."""
    plain = (*surface["colour"], 1.0)
    if surface["texture"] is None:
        return plain
    place = nodes.add("ShaderNodeUVMap")
    place.uv_map = UV
    scaled = nodes.add("ShaderNodeVectorMath", Vector=place.outputs[0])
    scaled.operation = "SCALE"
    scaled.inputs["Scale"].default_value = 1.0 / surface["texture_m"]
    texture = nodes.add("ShaderNodeTexImage", Vector=scaled.outputs[0])
    texture.image = images[surface["texture"]]
    product = nodes.add("ShaderNodeVectorMath")
    product.operation = "MULTIPLY"
    nodes.set(product.inputs[0], texture.outputs["Color"])
    nodes.set(product.inputs[1], plain[:3])
    return product.outputs[0]


def _glass(nodes: _Nodes, colour: Any, roughness: float) -> bpy.types.Node:
    """Clear glass without refraction: see-through, mirroring more at grazing angles (Schlick's approximation).

    Light passes it straight, so lamps and sun shine through without caustics. Blender's own Fresnel node takes the
    back of a pane for the inside of a body and mirrors totally there.
    """
    facing = nodes.add("ShaderNodeLayerWeight", Blend=0.5).outputs["Facing"]
    grazing = nodes.math("POWER", facing, 5.0)
    share = nodes.math("MULTIPLY_ADD", grazing, 1.0 - _GLASS_F0, _GLASS_F0)
    through = nodes.add("ShaderNodeBsdfTransparent", Color=colour)
    return nodes.mix(share, through, nodes.add("ShaderNodeBsdfGlossy", Roughness=roughness))
