"""Installs the extension of editors/blender into Blender as a user does, imports a scene by it, and says what came in.

    python import.py EXTENSION.zip PROGRAM SCENE DUMP

Writes a record for every corner of what is drawn to DUMP: position as three floats, Y up, colour as three bytes. Prints a line of JSON.
"""

import json
import struct
import sys

import bpy


def corners(thing):
    """Positions and colours of the corners of a mesh."""
    mesh = thing.data
    colors = mesh.color_attributes[0].data
    for corner, vertex in enumerate(loop.vertex_index for loop in mesh.loops):
        x, y, z = thing.matrix_world @ mesh.vertices[vertex].co
        at = corner if mesh.color_attributes[0].domain == "CORNER" else vertex
        codes = [round(255 * channel) for channel in colors[at].color_srgb[:3]]
        yield struct.pack("<3f3B", x, z, -y, *codes)


def main(extension, program, scene, dump):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(filepath=extension, repo="user_default", enable_on_install=True)
    addon = next(addon for addon in bpy.context.preferences.addons if addon.module.endswith("trisplat"))
    addon.preferences.program = program
    failed = ""
    try:
        bpy.ops.import_scene.trisplat(filepath=scene + ".missing")
    except RuntimeError as error:
        failed = str(error)
    done = bpy.ops.import_scene.trisplat(filepath=scene, collision=True, max_triangles=2000)
    meshes = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    drawn = [thing for thing in meshes if not thing.hide_render and not thing.name.startswith("backdrop")]
    with open(dump, "wb") as out:
        for thing in drawn:
            out.writelines(corners(thing))
    print(
        json.dumps(
            {
                "failed": failed,
                "done": sorted(done),
                "drawn": sum(len(thing.data.polygons) for thing in drawn),
                "hidden": {thing.name: len(thing.data.polygons) for thing in meshes if thing.hide_render},
                "camera": bpy.context.scene.camera is not None,
                "colors": bpy.context.scene.view_settings.view_transform,
            }
        )
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
