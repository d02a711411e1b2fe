"""What the module promises. Usage: python test_trisplat.py SAMPLES FOLDER   (tests/cli/python.rs runs it)"""

import json
import pathlib
import struct
import sys

import numpy as np

import trisplat

samples, folder = map(pathlib.Path, sys.argv[1:])


def refused(kind, needle, call, *arguments, **options):
    try:
        call(*arguments, **options)
    except kind as error:
        assert needle in str(error), (needle, str(error))
    else:
        raise AssertionError(f"{kind.__name__} {needle!r} was not raised")


# A soup as arrays.
soup = trisplat.read(samples / "soups/studio.ply")
count = len(soup["triangles"])
shapes = {key: (value.shape, value.dtype.name) for key, value in soup.items()}
k = soup["sh"].shape[1]
assert shapes == {
    "triangles": ((count, 3, 3), "float32"),
    "opacity": ((count,), "float32"),
    "sigma": ((count,), "float32"),
    "sh": ((count, k, 3), "float32"),
}, shapes

# A file and its arrays become the same mesh, and options are those of the library.
options = dict(preset="fast", up="-y", max_triangles=500)
report = trisplat.bake(str(samples / "soups/studio.ply"), folder / "a.glb", target="godot", **options)
assert report["options"]["prune"]["max_triangles"] == 500 and report["options"]["output"]["target"] == "godot"
assert report["stages"][-1]["after"]["triangles"] == 500
glb = (folder / "a.glb").read_bytes()
assert glb[:4] == b"glTF" and struct.unpack("<I", glb[8:12])[0] == len(glb)
written = trisplat.read(folder / "a.glb")
mesh = trisplat.bake(soup, **options)
assert mesh["faces"].shape == (500, 3) and mesh["faces"].dtype == np.uint32 and "opacity" not in mesh
assert np.array_equal(written["positions"], mesh["positions"])
grouped = trisplat.bake(soup, preset="fast", up="-y", prune={"max_triangles": 500})
assert all(np.array_equal(mesh[key], grouped[key]) for key in mesh)

# What is changed in the arrays is changed in the mesh; lists and doubles are arrays too; two scenes are merged.
soup["opacity"][100:] = 0
assert len(trisplat.bake(soup, preset="fast", up="-y")["faces"]) <= 100
corner = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
white = trisplat.bake({"triangles": [corner]}, preset="fast", up="y")
assert np.allclose(white["colors"], 1, atol=1e-4), white["colors"]
red = {"positions": np.array(corner, float), "colors": [[1, 0, 0]]}
both = trisplat.bake([red, white], preset="fast", up="y")
assert len(both["faces"]) == 2

# Levels and tiles as the program writes them.
trisplat.bake(samples / "soups/studio.ply", folder / "b.glb", lod=[0.5], target="godot", **options)
assert (folder / "b.lod1.glb").exists() and (folder / "b.lod.tscn").exists()
trisplat.bake(samples / "soups/studio.ply", folder / "c.tileset.json", preset="fast", up="-y")
assert json.loads((folder / "c.tileset.json").read_text())["asset"]["version"] == "1.1"

# Budgets of bytes and of time are the program's.
small = trisplat.bake(soup, folder / "d.glb", max_bytes=30_000, preset="fast", up="-y")
assert sum(file["bytes"] for file in small["outputs"]) <= 30_000
refused(ValueError, "time above 0", trisplat.bake, soup, budget=-1)
refused(ValueError, "max_bytes", trisplat.bake, soup, max_bytes=30_000)

# Errors.
refused(FileExistsError, "force=True", trisplat.bake, soup, folder / "a.glb", **options)
trisplat.bake(soup, folder / "a.glb", force=True, **options)
refused(OSError, "none.ply", trisplat.read, folder / "none.ply")
refused(ValueError, "max_triangels", trisplat.bake, soup, max_triangels=1)
refused(ValueError, "max_triangels", trisplat.bake, soup, prune={"max_triangels": 1})
refused(ValueError, "tileset_tiles", trisplat.bake, soup, tileset_tiles=1)
refused(ValueError, "(N, 3, 3)", trisplat.bake, {"triangles": [[1, 2, 3]]})
refused(ValueError, "opacities", trisplat.bake, {"triangles": [corner], "opacities": [1]})
refused(ValueError, "equally many", trisplat.bake, {"triangles": [corner], "opacity": [1, 1]})
refused(ValueError, ".glb", trisplat.bake, soup, folder / "a.txt")
print("ok")
