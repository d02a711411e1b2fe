"""File > Import > Trisplat: trained scenes and Gaussian splats become meshes in their own colours.

The work is done by the program trisplat, which is on the PATH or where the preferences of this add-on say.
"""

import os
import subprocess
import tempfile
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

EXTENSIONS = (".ply", ".pt", ".splat", ".spz", ".sog", ".off")


class TrisplatPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__ or __name__

    program: StringProperty(name="Program", subtype="FILE_PATH", default="trisplat", description="The program trisplat")

    def draw(self, _context):
        self.layout.prop(self, "program")


def program():
    """The program's path; None if it is not there. A name alone is sought on the PATH, never in the current folder."""
    addon = bpy.context.preferences.addons.get(TrisplatPreferences.bl_idname)
    return found(bpy.path.abspath(addon.preferences.program) if addon else "trisplat")


def found(name):
    """An absolute path, or a file of that name in an absolute folder of the PATH."""
    folders = [""] if os.path.isabs(name) else os.environ.get("PATH", "").split(os.pathsep)
    if os.path.dirname(name) and not os.path.isabs(name):
        return None
    endings = ["", ".exe"] if os.name == "nt" else [""]
    paths = (os.path.join(folder, name + ending) for folder in folders for ending in endings)
    return next((path for path in paths if os.path.isabs(path) and os.path.isfile(path) and os.access(path, os.X_OK)), None)


class IMPORT_SCENE_OT_trisplat(bpy.types.Operator, ImportHelper):
    """Bake a trained scene or Gaussian splats, and import the mesh"""

    bl_idname = "import_scene.trisplat"
    bl_label = "Import Trisplat"
    bl_options = {"UNDO", "PRESET"}

    filename_ext = ".ply"
    filter_glob: StringProperty(default=";".join(f"*{end}" for end in EXTENSIONS), options={"HIDDEN"})
    quality: EnumProperty(
        name="Quality",
        items=[
            ("default", "Default", "Colours and triangles are fitted to the scene"),
            ("fast", "Fast", "Seconds, without fitting"),
        ],
    )
    harden: BoolProperty(name="Harden", description="Train a soft scene opaque first: minutes, and much closer to it")
    max_triangles: IntProperty(name="Maximum Triangles", min=0, description="0: all that the scene needs")
    collision: BoolProperty(name="Collision", description="Also import a surface of few triangles, hidden")
    backdrop: BoolProperty(name="Backdrop", default=True, description="Surroundings far behind the scene")
    scale: FloatProperty(name="Scale", default=1.0, min=1e-6, description="Metres to one unit of the scene")

    def flags(self):
        """The flags of `trisplat bake` for these options."""
        made = ["--target", "blender", "--preset", self.quality, "--set", f"place.scale={self.scale:g}"]
        if self.harden:
            made.append("--harden")
        if self.max_triangles:
            made += ["--max-triangles", str(self.max_triangles)]
        if self.collision:
            made.append("--collision")
        if not self.backdrop:
            made += ["--backdrop", "off"]
        return made

    def execute(self, context):
        path = program()
        if not path:
            self.report({"ERROR"}, "The program trisplat was not found: Preferences > Add-ons > Trisplat")
            return {"CANCELLED"}
        with tempfile.TemporaryDirectory() as folder:
            glb = Path(folder) / (Path(self.filepath).stem + ".glb")
            bake = [path, "bake", self.filepath, "--output", str(glb), "--quiet", *self.flags()]
            done = subprocess.run(bake, capture_output=True, text=True, stdin=subprocess.DEVNULL)
            if done.returncode:
                self.report({"ERROR"}, done.stderr.strip() or f"trisplat ended with {done.returncode}")
                return {"CANCELLED"}
            before = set(context.scene.objects)
            # The collision surface has a file of its own.
            for file in (glb, glb.with_suffix(".collision.glb")):
                if file.exists():
                    bpy.ops.import_scene.gltf(filepath=str(file))
        arrange([thing for thing in context.scene.objects if thing not in before], context)
        return {"FINISHED"}


def arrange(things, context):
    """Shows what was imported in its own colours, and hides what is not to be seen."""
    meshes = [thing for thing in things if thing.type == "MESH"]
    for thing in meshes:
        for material in thing.data.materials:
            if material.name.startswith(("backdrop", "trisplat_front")):
                # One sees its front only; Blender draws both sides by default.
                material.use_backface_culling = True
        if thing.name.startswith("collision"):
            thing.hide_set(True)
            thing.hide_render = True
    cameras = [thing for thing in things if thing.type == "CAMERA"]
    if cameras and context.scene.camera is None:
        context.scene.camera = cameras[0]
    # Colours as they are: the default, AgX, is a film's.
    context.scene.view_settings.view_transform = "Standard"
    size = max((max(thing.dimensions) for thing in meshes), default=1.0)
    for screen in bpy.data.screens:
        for area in (area for area in screen.areas if area.type == "VIEW_3D"):
            view = area.spaces.active
            view.shading.type = "MATERIAL"
            view.clip_start, view.clip_end = size / 1000, size * 100


class IO_FH_trisplat(bpy.types.FileHandler):
    """Files that are dropped into the viewport."""

    bl_idname = "IO_FH_trisplat"
    bl_label = "Trisplat"
    bl_import_operator = "import_scene.trisplat"
    bl_file_extensions = ";".join(EXTENSIONS)

    @classmethod
    def poll_drop(cls, context):
        return context.area and context.area.type == "VIEW_3D"


def menu(self, _context):
    self.layout.operator(IMPORT_SCENE_OT_trisplat.bl_idname, text="Trisplat (.ply, .pt, .spz, .sog, .splat)")


CLASSES = (TrisplatPreferences, IMPORT_SCENE_OT_trisplat, IO_FH_trisplat)


def register():
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.TOPBAR_MT_file_import.append(menu)


def unregister():
    bpy.types.TOPBAR_MT_file_import.remove(menu)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
