"""What the module promises. Usage: python test_trisplat.py SAMPLES FOLDER   (tests/cli/python.rs runs it)"""

import ast
import inspect
import json
import pathlib
import signal
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
options = dict(preset="fast", up="-y", backdrop="off", max_triangles=500)
report = trisplat.bake(str(samples / "soups/studio.ply"), folder / "a.glb", target="godot", **options)
assert report["options"]["prune"]["max_triangles"] == 500 and report["options"]["output"]["target"] == "godot"
assert report["stages"][-1]["after"]["triangles"] == 500
glb = (folder / "a.glb").read_bytes()
assert glb[:4] == b"glTF" and struct.unpack("<I", glb[8:12])[0] == len(glb)
written = trisplat.read(folder / "a.glb")
mesh = trisplat.bake(soup, **options)
assert mesh["faces"].shape == (500, 3) and mesh["faces"].dtype == np.uint32 and "opacity" not in mesh
assert np.array_equal(written["positions"], mesh["positions"])
grouped = trisplat.bake(soup, preset="fast", up="-y", backdrop="off", prune={"max_triangles": 500})
assert all(np.array_equal(mesh[key], grouped[key]) for key in mesh)

# What is changed in the arrays is changed in the mesh; lists and doubles are arrays too; two scenes are merged.
soup["opacity"][100:] = 0
assert len(trisplat.bake(soup, preset="fast", up="-y", backdrop="off")["faces"]) <= 100
corner = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
white = trisplat.bake({"triangles": [corner]}, preset="fast", up="y")
assert np.allclose(white["colors"], 1, atol=1e-4), white["colors"]
red = {"positions": np.array(corner, float), "colors": [[1, 0, 0]]}
both = trisplat.bake([red, white], preset="fast", up="y")
assert len(both["faces"]) == 2

# Nothing is copied on reading: arrays own their memory, or are views of one that does, and can be written.
for array in (*trisplat.read(samples / "soups/studio.ply").values(), *mesh.values()):
    assert array.flags.writeable and array.flags.c_contiguous and array.base is not None
# Objects of other packages, in the colours that eyes see.
import open3d
import trimesh

for source in (mesh, folder / "a.glb"):
    triangles = mesh["positions"][mesh["faces"]]
    other = trisplat.to_trimesh(source)
    assert isinstance(other, trimesh.Trimesh) and np.array_equal(np.asarray(other.triangles, np.float32), triangles)
    third = trisplat.to_open3d(source)
    assert isinstance(third, open3d.geometry.TriangleMesh)
    assert np.array_equal(np.asarray(third.vertices, np.float32)[np.asarray(third.triangles)], triangles)
    linear = mesh["colors"].repeat(3, axis=0) if len(mesh["colors"]) == 500 else mesh["colors"]
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)
    assert np.allclose(np.asarray(third.vertex_colors), srgb, atol=1 / 255)
    seen = other.visual.face_colors if other.visual.kind == "face" else other.visual.vertex_colors
    assert np.abs(seen[:, :3] - 255 * (srgb[::3] if len(seen) == 500 else srgb)).max() <= 1
refused(ValueError, "trisplat.bake", trisplat.to_trimesh, soup)
refused(OSError, "none.glb", trisplat.to_open3d, folder / "none.glb")

# Levels and tiles as the program writes them.
trisplat.bake(samples / "soups/studio.ply", folder / "b.glb", lod=[0.5], target="godot", **options)
assert (folder / "b.lod1.glb").exists() and (folder / "b.lod.tscn").exists()
trisplat.bake(samples / "soups/studio.ply", folder / "c.tileset.json", preset="fast", up="-y")
assert json.loads((folder / "c.tileset.json").read_text())["asset"]["version"] == "1.1"

# Limits on bytes and on time are the program's.
small = trisplat.bake(soup, folder / "d.glb", max_bytes=30_000, preset="fast", up="-y")
assert sum(file["bytes"] for file in small["outputs"]) <= 30_000
refused(ValueError, "time above 0", trisplat.train, samples / "dataset", budget=-1)
refused(ValueError, "max_bytes", trisplat.bake, soup, max_bytes=30_000)

# Train, bake, evaluate, draw.
photos = samples / "dataset"
how = {"max_size": 48}
few = dict(steps=150, max_triangles=600, teacher="off", dataset_options=how)
report = trisplat.train(photos, folder / "trained.ply", **few)
assert report["outputs"][0]["bytes"] == (folder / "trained.ply").stat().st_size
assert report["options"]["steps"] == 150, report["options"]
trained = trisplat.train(str(photos), **few)
stored = trisplat.read(folder / "trained.ply")
assert all(np.array_equal(trained[key], stored[key]) for key in trained) and len(trained["triangles"]) <= 600

# A callback sees every step, stops by False, and ends the training by what it raises; Ctrl-C does, between two steps.
seen = []
trisplat.train(photos, **few, callback=seen.append)
assert [now["step"] for now in seen] == list(range(1, 151)) and {now["part"] for now in seen} == {"scene"}
assert seen[-1]["psnr"] > seen[0]["psnr"] and seen[-1]["triangles"] <= 600
seen.clear()
report = trisplat.train(photos, folder / "stopped.ply", **few, callback=lambda now: seen.append(now) or now["step"] < 20)
assert len(seen) == 20 and report["stages"][-1]["details"]["stopped"] and len(trisplat.read(folder / "stopped.ply")["triangles"])


def interrupt(now):
    if now["step"] == 5:
        signal.raise_signal(signal.SIGINT)


refused(KeyboardInterrupt, "", trisplat.train, photos, folder / "interrupted.ply", **few, callback=interrupt)
refused(ZeroDivisionError, "zero", trisplat.train, photos, folder / "interrupted.ply", **few, callback=lambda now: 1 / 0)
both = dict(few, teacher="auto")
refused(KeyboardInterrupt, "", trisplat.train, photos, folder / "interrupted.ply", **both, callback=interrupt)
assert not (folder / "interrupted.ply").exists()
trisplat.bake(folder / "trained.ply", folder / "trained.glb", preset="fast")
scores = trisplat.eval(folder / "trained.glb", photos, ssaa=1, dataset_options=how)
[solid] = scores["steps"]
assert solid["name"] == "solid" and 8 < solid["mean"]["psnr"] < 40, solid["mean"]
pictures = trisplat.render(folder / "trained.glb", dataset=photos, ssaa=1, dataset_options=how)
assert sorted(pictures) == sorted(image["name"] for image in solid["images"])
assert all(p.dtype == np.uint8 and p.shape[2] == 3 and max(p.shape) == 48 for p in pictures.values())
orbit = trisplat.render(folder / "trained.glb", orbit=2, width=40)
assert [p.shape for p in orbit.values()] == [(30, 40, 3)] * 2 and any(p.any() for p in orbit.values())
depth = trisplat.render(folder / "trained.glb", orbit=1, width=40, show="depth")["orbit_0000.png"]
assert not np.array_equal(depth, orbit["orbit_0000.png"])
refused(FileExistsError, "force=True", trisplat.train, photos, folder / "trained.ply", **few)
refused(ValueError, ".ply", trisplat.train, photos, folder / "trained.glb", **few)
refused(ValueError, "stepps", trisplat.train, photos, stepps=3)
refused(ValueError, "max_sise", trisplat.train, photos, dataset_options={"max_sise": 3})
refused(ValueError, "none", trisplat.eval, folder / "trained.glb", photos, split="none")
refused(ValueError, "ssaa", trisplat.render, folder / "trained.glb", orbit=1, ssaa=3)
refused(ValueError, "orbit", trisplat.render, folder / "trained.glb")

# One call from photos to a file, a surface, and captures of nothing.
report = trisplat.make(photos, folder / "made.glb", work=folder / "made", steps=100, preset="fast", dataset_options=how)
assert (folder / "made.glb").exists() and [stage["name"] for stage in report["stages"]][:1] == ["capture"], report["stages"]
refused(FileExistsError, "force=True", trisplat.make, photos, folder / "made.glb", steps=100)
surface = trisplat.mesh(folder / "trained.ply", dataset=photos, dataset_options=how, max_triangles=500)
assert 0 < len(surface["faces"]) <= 500
report = trisplat.mesh(folder / "trained.ply", folder / "surface.ply", dataset=photos, dataset_options=how)
assert report["outputs"][0]["bytes"] == (folder / "surface.ply").stat().st_size
refused(FileExistsError, "force=True", trisplat.mesh, folder / "trained.ply", folder / "surface.ply")
refused(OSError, "none", trisplat.capture, folder / "none", folder / "captured")
refused(ValueError, "framez", trisplat.capture, folder / "none", folder / "captured", framez=3)

# The stubs say what the module has: the same functions, arguments and defaults, in the same order.
package = pathlib.Path(trisplat.__file__).parent
assert (package / "py.typed").exists(), sorted(package.iterdir())
[stub] = package.glob("*.pyi")
stubs = {}
for node in ast.parse(stub.read_text()).body:
    if isinstance(node, ast.FunctionDef):
        plain, named = node.args.args, node.args.kwonlyargs
        defaults = [None] * (len(plain) - len(node.args.defaults)) + node.args.defaults + node.args.kw_defaults
        arguments = [
            (argument.arg, inspect.Parameter.empty if default is None else ast.literal_eval(default))
            for argument, default in zip(plain + named, defaults)
        ]
        # Of two overloads the one that writes a file needs its name.
        overloads = stubs.setdefault(node.name, [])
        overloads.append((arguments, node.args.kwarg and node.args.kwarg.arg))
functions = {name for name in dir(trisplat) if inspect.isbuiltin(getattr(trisplat, name))}
assert functions == set(stubs), functions ^ set(stubs)
for name in functions:
    parameters = inspect.signature(getattr(trisplat, name)).parameters.values()
    more = [p.name for p in parameters if p.kind is p.VAR_KEYWORD]
    arguments = [(p.name, p.default) for p in parameters if p.kind is not p.VAR_KEYWORD]
    assert stubs[name][0] == (arguments, more[0] if more else None), (name, stubs[name][0], arguments)

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
