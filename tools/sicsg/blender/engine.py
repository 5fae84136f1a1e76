"""Settings of Cycles: a scene for pictures and one for passes, both of the same objects."""

from __future__ import annotations

import bpy

SAMPLE_CLAMP = 6.0
"""Largest radiance of one indirect sample; keeps single bright paths from becoming blotches when denoised."""
FILTER_PX = 1.2
MAX_BOUNCES = 3
TRANSPARENT_BOUNCES = 12
"""Panes of glass that a ray passes, two surfaces each; a ray that has passed them all is black."""
CENTRE_ONLY_PX = 0.01
"""Filter width of the passes: a sample at each pixel's centre."""


def pick_device() -> str:
    """Use the graphics card where there is one: ``"OPTIX"``, ``"CUDA"`` or ``"CPU"``."""
    preferences = bpy.context.preferences.addons["cycles"].preferences
    kinds = [kind for kind, *_ in preferences.get_device_types(bpy.context)]
    for kind in ("OPTIX", "CUDA"):
        if kind in kinds and preferences.get_devices_for_type(kind):
            preferences.compute_device_type = kind
            for device in preferences.get_devices_for_type(kind):
                device.use = device.type == kind
            return kind
    return "CPU"


def _scene(name: str, device: str, objects: bpy.types.Collection, camera: bpy.types.Object) -> bpy.types.Scene:
    scene = bpy.data.scenes.new(name)
    scene.collection.children.link(objects)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU" if device == "CPU" else "GPU"
    scene.render.use_persistent_data = True
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.use_file_extension = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_auto_tile = False
    scene.view_settings.view_transform = "Raw"
    return scene


def _write_exr(settings: bpy.types.ImageFormatSettings, *, layers: bool) -> None:
    settings.media_type = "MULTI_LAYER_IMAGE" if layers else "IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER" if layers else "OPEN_EXR"
    settings.color_depth, settings.exr_codec = "32", "NONE"
    settings.use_exr_interleave = True  # one part with all channels


def picture_scene(device: str, objects: bpy.types.Collection, camera: bpy.types.Object) -> bpy.types.Scene:
    """Path traced, three bounces, denoised."""
    scene = _scene("picture", device, objects, camera)
    cycles = scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = MAX_BOUNCES
    cycles.transparent_max_bounces = TRANSPARENT_BOUNCES
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = SAMPLE_CLAMP
    cycles.use_light_tree = True
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", FILTER_PX
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    cycles.denoising_prefilter, cycles.denoising_quality = "FAST", "FAST"
    cycles.denoising_use_gpu = device != "CPU"
    _write_exr(scene.render.image_settings, layers=False)
    scene.render.image_settings.color_mode = "RGB"
    return scene


def pass_scene(device: str, objects: bpy.types.Collection, camera: bpy.types.Object) -> bpy.types.Scene:
    """Object index and depth at the pixels' centres; one opaque material for everything, so glass hides too.

    Through transparent glass Cycles' index pass is dithered: each pixel has the pane or what is behind it, by chance.
    """
    scene = _scene("passes", device, objects, camera)
    cycles = scene.cycles
    cycles.samples, cycles.max_bounces = 1, 0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", CENTRE_ONLY_PX
    cycles.use_denoising = False
    layer = scene.view_layers[0]
    layer.material_override = bpy.data.materials.new("opaque")
    layer.use_pass_combined, layer.use_pass_object_index, layer.use_pass_z = False, True, True
    _write_exr(scene.render.image_settings, layers=True)
    return scene
