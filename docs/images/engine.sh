#!/usr/bin/env bash
# Makes docs/images/engine.png: a held-out photo of samples/dataset, the same view of the GLB in Godot 4 (Forward+), and its wires.
# Usage: docs/images/engine.sh TRISPLAT [PHOTO]   (after tests/godot4.sh; with ImageMagick)
set -euo pipefail
trisplat=$(realpath "$1")
photo=${2:-view_0016.png}
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# In the frame of the photos, so that their cameras are the engine's.
"$trisplat" bake samples/soups/trained.ply --dataset samples/dataset --up y --target godot -o "$folder/scene.glb"
cp docs/images/engine.gd tests/godot4/project.godot "$folder"
python3 - "$photo" >"$folder/view.json" <<'PY'
import json, sys

model = "samples/dataset/sparse/0/"
lines = [line.split() for line in open(model + "images.txt") if not line.startswith("#")]
[pose] = [line for line in lines if line[-1:] == [sys.argv[1]]]
w, x, y, z, *t = map(float, pose[1:8])
r = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
]
eye = [-sum(r[i][k] * t[i] for i in range(3)) for k in range(3)]
[camera] = [line.split() for line in open(model + "cameras.txt") if not line.startswith("#")]
width, height, _, fy, cx, cy = map(float, camera[2:])
# COLMAP's cameras look along +z with y down, Godot's along -z with y up.
axes = [r[0], [-a for a in r[1]], [-a for a in r[2]], eye]
offset = [(width / 2 - cx) / fy, (cy - height / 2) / fy]
print(json.dumps({"camera_to_world": axes, "height": height / fy, "offset": offset}))
PY
target/judges/godot4 "$folder" --import >/dev/null
target/judges/godot4-screen "$folder" --rendering-method forward_plus --resolution 400x300 --script engine.gd
convert "samples/dataset/images/$photo" -filter Mitchell -resize 400x300 "$folder/photo.png"
convert "$folder/photo.png" "$folder/colors.png" "$folder/wires.png" +append -colors 200 -define png:compression-level=9 docs/images/engine.png
