"""Imports a baked scene into Blender and shows it in its own colours.

    blender --python import_scene.py -- scene.glb [scene.blend]

With a second name the result is saved there. Run headless (`--background`) with Blender 3.4.1 as Debian packages it, whose importer wants an
older numpy: there `--python-expr "import numpy; numpy.bool = bool"` goes before `--python`.
"""

import sys

import bpy


def main(path, save=None):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path)
    meshes = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    for thing in meshes:
        if thing.name.startswith("backdrop"):
            # It is seen from inside; Blender draws both sides unless it is told otherwise.
            thing.data.materials[0].use_backface_culling = True
    # Colours as they are: the default, AgX or Filmic, is a film's.
    bpy.context.scene.view_settings.view_transform = "Standard"
    size = max((max(thing.dimensions) for thing in meshes), default=1.0)
    for screen in bpy.data.screens:
        for area in (area for area in screen.areas if area.type == "VIEW_3D"):
            view = area.spaces.active
            view.shading.type = "MATERIAL"
            view.clip_start, view.clip_end = size / 1000, size * 100
    colored = [thing for thing in meshes if thing.data.color_attributes]
    print(f"{len(meshes)} objects, {len(colored)} with colours, {sum(len(m.data.polygons) for m in meshes)} triangles")
    if save:
        bpy.ops.wm.save_as_mainfile(filepath=save)


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1 :])
