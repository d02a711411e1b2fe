"""Draws a GLB from its first viewpoint in Cycles, with the view-dependent colours of samples/engines/blender.

    python view_colors.py SAMPLES SCENE.glb PICTURE.png WIDTH HEIGHT      in a Python with bpy
"""

import sys

import bpy

samples, scene, picture, width, height = sys.argv[1:]
sys.path.insert(0, samples)
import view_colors  # noqa: E402

bpy.ops.wm.read_factory_settings(use_empty=True)
view_colors.load(scene)
for material in bpy.data.materials:
    if material.name.startswith(("backdrop", "trisplat_front")):
        material.use_backface_culling = True
shown = bpy.context.scene
shown.camera = next(thing for thing in shown.objects if thing.type == "CAMERA")
shown.camera.data.sensor_fit = "VERTICAL"
shown.view_settings.view_transform = "Standard"
shown.render.resolution_x, shown.render.resolution_y = int(width), int(height)
shown.render.engine = "CYCLES"
shown.cycles.samples = 8
shown.cycles.use_denoising = False
shown.cycles.pixel_filter_type = "BOX"
shown.render.filter_size = 1.0
shown.render.image_settings.file_format = "PNG"
shown.render.image_settings.color_mode = "RGB"
shown.render.filepath = picture
bpy.ops.render.render(write_still=True)
