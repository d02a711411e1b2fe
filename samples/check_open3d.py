#!/usr/bin/env python3
"""Does Open3D see in a baked file what its source holds?  check_open3d.py SOURCE BAKED [BAKED ...]"""

import numpy as np
import open3d

from judge import judge


def load(path):
    """Corners [N, 3, 3] and stored colours [N, 3, 3] in [0, 1]. Open3D merges equal vertices."""
    mesh = open3d.io.read_triangle_mesh(str(path))
    faces = np.asarray(mesh.triangles)
    return np.asarray(mesh.vertices)[faces], np.asarray(mesh.vertex_colors)[faces]


if __name__ == "__main__":
    judge("open3d", load, inexact=[".obj"])
