#!/usr/bin/env python3
"""Photographs a glossy head on a patterned floor with Blender: the data set of docs/images/shine.sh.

    python3 docs/images/shine.py FOLDER   (with Blender as a Python module: pip install bpy)
"""

import json
import math
import random
import sys
from pathlib import Path

import bpy
from mathutils import Vector

SIZE = [480, 360]
PHOTOS = 30
HELD_OUT = 10


def material(name, roughness, low, high, scale):
    """A glossy material whose colour is noise between two colours."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    noise, colors = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeValToRGB")
    noise.inputs["Scale"].default_value = scale
    noise.inputs["Detail"].default_value = 8
    colors.color_ramp.elements[0].position, colors.color_ramp.elements[1].position = 0.4, 0.6
    colors.color_ramp.elements[0].color, colors.color_ramp.elements[1].color = (*low, 1), (*high, 1)
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Object"], noise.inputs["Vector"])
    links.new(noise.outputs["Fac"], colors.inputs["Fac"])
    surface = nodes["Principled BSDF"]
    links.new(colors.outputs["Color"], surface.inputs["Base Color"])
    surface.inputs["Roughness"].default_value = roughness
    return made


def light(place, size, power):
    """A square lamp that looks at the middle."""
    bpy.ops.object.light_add(type="AREA", location=place)
    lamp = bpy.context.object
    lamp.data.size, lamp.data.energy = size, power
    lamp.rotation_euler = (-Vector(place)).to_track_quat("-Z", "Y").to_euler()


def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.context.object.data.materials.append(material("floor", 0.7, (0.05, 0.09, 0.12), (0.5, 0.45, 0.38), 6))
    bpy.ops.mesh.primitive_monkey_add(size=2, location=(0, 0, 0.98))
    head = bpy.context.object
    head.modifiers.new("smooth", "SUBSURF").render_levels = 2
    bpy.ops.object.shade_smooth()
    head.data.materials.append(material("paint", 0.42, (0.3, 0.015, 0.01), (0.55, 0.05, 0.02), 9))
    light((3, -2, 4), 1.2, 350)
    light((-4, 1, 3), 1.5, 250)
    light((1, 4, 3), 1.0, 150)
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.2, 0.22, 0.25, 1)
    setup = bpy.context.scene
    setup.world = world
    setup.render.engine = "CYCLES"
    setup.cycles.samples = 10
    setup.cycles.use_denoising = True
    setup.render.resolution_x, setup.render.resolution_y = SIZE
    setup.view_settings.view_transform = "Standard"
    setup.render.image_settings.file_format = "JPEG"
    setup.render.image_settings.quality = 95
    bpy.ops.object.camera_add()
    setup.camera = bpy.context.object
    setup.camera.data.angle_x = 0.8
    return setup


def main(folder):
    (folder / "images").mkdir(parents=True, exist_ok=True)
    setup = scene()
    camera = setup.camera
    frames = []
    around = random.Random(0)
    for i in range(PHOTOS):
        # Three rings in front of the head, of 120 degrees.
        turn = math.radians(-150 + 120 * (i // 3) / (PHOTOS // 3 - 1))
        height = math.radians([18, 34, 52][i % 3] + around.uniform(-4, 4))
        distance = 4.6 + around.uniform(-0.3, 0.3)
        middle = Vector((0, 0, 0.8))
        camera.location = middle + distance * Vector((math.cos(height) * math.cos(turn), math.cos(height) * math.sin(turn), math.sin(height)))
        camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
        name = f"{i:03}.jpg"
        setup.render.filepath = str(folder / "images" / name)
        bpy.ops.render.render(write_still=True)
        frames.append({"file_path": f"images/{name}", "transform_matrix": [list(row) for row in camera.matrix_world]})
    (folder / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.8, "w": SIZE[0], "h": SIZE[1], "frames": frames}, indent=1))
    (folder / "test.txt").write_text("".join(f"{i:03}.jpg\n" for i in range(0, PHOTOS, HELD_OUT)))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
