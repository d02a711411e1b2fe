"""What the script for Unreal uses of its editor, by its documentation: it only writes down what it is told, and prints it at the end as JSON."""

import atexit
import json
import os

said = {"imported": [], "levels": [], "sizes": None, "saved": None, "log": []}
atexit.register(lambda: print(json.dumps(said)))


class Properties:
    def set_editor_property(self, key, value):
        setattr(self, key, value)

    def get_editor_property(self, key):
        return getattr(self, key)


class AssetImportTask(Properties):
    pass


class InterchangeGenericAssetsPipeline(Properties):
    def __init__(self):
        self.mesh_pipeline = Properties()


class InterchangePipelineStackOverride(Properties):
    def __init__(self):
        self.pipelines = []

    def add_pipeline(self, pipeline):
        self.pipelines.append(pipeline)


class StaticMesh(Properties):
    def __init__(self, path):
        self.path = path

    def get_path_name(self):
        return self.path


class AssetTools:
    def import_asset_tasks(self, tasks):
        for task in tasks:
            [pipeline] = task.options.pipelines
            meshes = vars(pipeline.mesh_pipeline)
            assert os.path.isfile(task.filename) and task.automated and task.replace_existing
            assert meshes == {"combine_static_meshes": True, "build_nanite": False}, meshes
            name = os.path.splitext(os.path.basename(task.filename))[0]
            task.imported_object_paths = [f"{task.destination_path}/{kind}" for kind in ("trisplat", name)]
            said["imported"].append(task.filename)


class AssetToolsHelpers:
    @staticmethod
    def get_asset_tools():
        return AssetTools()


class EditorAssetLibrary:
    @staticmethod
    def save_loaded_asset(asset):
        said["saved"] = asset.path
        return True


class StaticMeshEditorSubsystem:
    def set_lod_from_static_mesh(self, mesh, index, source, source_index, reuse_existing_material_slots):
        said["levels"].append([mesh.path, index, source.path, source_index])
        return index

    def set_lod_screen_sizes(self, mesh, sizes):
        said["sizes"] = sizes
        return True


def get_editor_subsystem(kind):
    return kind()


def load_asset(path):
    """The first thing in each file is a material."""
    return Properties() if path.endswith("trisplat") else StaticMesh(path)


def log(text):
    said["log"].append(text)
