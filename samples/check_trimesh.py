#!/usr/bin/env python3
"""Does trimesh see in a baked file what its source holds?  check_trimesh.py SOURCE BAKED [BAKED ...]"""

import numpy as np
import trimesh

from judge import judge


def load(path):
    """Corners [N, 3, 3] and stored colours [N, 3, 3] in [0, 1] of all nodes of a file."""
    scene = trimesh.load_scene(path, process=False, maintain_order=True)
    corners, rgb = [], []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        corners.append(trimesh.transform_points(mesh.vertices, transform)[mesh.faces])
        rgb.append(colors(mesh))
    return np.concatenate(corners), np.concatenate(rgb)


def colors(mesh):
    if mesh.visual.kind == "face":
        return np.repeat(mesh.visual.face_colors[:, None, :3] / 255.0, 3, 1)
    # With a material trimesh keeps colours as stored, in one of two attributes; integers are not normalised.
    places = [getattr(mesh.visual, "vertex_attributes", {}), mesh.vertex_attributes]
    stored = next((place["color"] for place in places if "color" in place), None)
    stored = mesh.visual.vertex_colors if stored is None else stored
    largest = np.iinfo(stored.dtype).max if stored.dtype.kind == "u" else 1.0
    return stored[:, :3][mesh.faces] / largest


if __name__ == "__main__":
    judge("trimesh", load)
