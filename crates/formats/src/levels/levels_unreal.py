"""Written by {generator}: makes one static mesh of a scene and its levels of detail, in Unreal's editor.

Leave it beside the files and run it: Tools > Execute Python Script. The mesh is the one in /Game/trisplat/{class}/lod0.
"""

import os

import unreal

NAME = {name}
# The scene, then its levels, finest first.
FILES = [{files}]
# Size of the scene on the screen below which each level is drawn: its triangles are then 2 px wide on a screen of 1080 px, with a camera of
# 90 degrees.
SCREEN_SIZES = [{sizes}]
FOLDER = "/Game/trisplat/{class}"


def options():
    """The scene comes in chunks: they are to be one mesh, and no Nanite mesh, which makes levels of its own."""
    pipeline = unreal.InterchangeGenericAssetsPipeline()
    meshes = pipeline.mesh_pipeline
    if hasattr(unreal, "InterchangeCombineStaticMeshesBehavior"):
        # Recent editors have it in place of the other.
        every = unreal.InterchangeCombineStaticMeshesBehavior.ALL
        meshes.set_editor_property("combine_static_meshes_behavior", every)
    else:
        meshes.set_editor_property("combine_static_meshes", True)
    meshes.set_editor_property("build_nanite", False)
    stack = unreal.InterchangePipelineStackOverride()
    stack.add_pipeline(pipeline)
    return stack


def imported(path, folder):
    """The static mesh of a file."""
    task = unreal.AssetImportTask()
    values = {
        "filename": path,
        "destination_path": folder,
        "automated": True,
        "replace_existing": True,
        "save": True,
        "options": options(),
    }
    for key, value in values.items():
        task.set_editor_property(key, value)
    unreal.AssetToolsHelpers.get_asset_tools().import_asset_tasks([task])
    assets = [unreal.load_asset(str(name)) for name in task.get_editor_property("imported_object_paths")]
    meshes = [asset for asset in assets if isinstance(asset, unreal.StaticMesh)]
    if len(meshes) != 1:
        raise RuntimeError(f"{path}: {len(meshes)} static meshes were imported, wanted 1")
    return meshes[0]


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    levels = [imported(os.path.join(here, name), f"{FOLDER}/lod{i}") for i, name in enumerate(FILES)]
    editor = unreal.get_editor_subsystem(unreal.StaticMeshEditorSubsystem)
    mesh = levels[0]
    for i, level in enumerate(levels[1:], 1):
        if editor.set_lod_from_static_mesh(mesh, i, level, 0, True) != i:
            raise RuntimeError(f"{FILES[i]} could not be made level {i} of {NAME}")
    if not editor.set_lod_screen_sizes(mesh, SCREEN_SIZES):
        raise RuntimeError(f"the screen sizes of {NAME} could not be set")
    unreal.EditorAssetLibrary.save_loaded_asset(mesh)
    unreal.log(f"{NAME}: {len(levels)} levels in {mesh.get_path_name()}")


main()
