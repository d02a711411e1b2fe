#!/usr/bin/env bash
# Makes docs/images/capture.jpg: a held-out photo, the same view of the GLB in Godot 4 (Forward+), and its wires.
# Usage: docs/images/capture.sh TRISPLAT DATASET PHOTO CROP [SOUP]   (after tests/judges/godot4.sh; with ImageMagick)
# DATASET has a transforms.json beside its COLMAP model; CROP is WxH+X+Y in pixels of the photo. Without SOUP it trains for four minutes of CPU time.
set -euo pipefail
trisplat=$(realpath "$1")
dataset=$(realpath "$2")
photo=$3
crop=$4
soup=${5:+$(realpath "$5")}
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

[ -n "$soup" ] || { soup=$folder/soup.ply && "$trisplat" train "$dataset" -o "$soup" --budget 4m; }
# In the frame of the photos, so that their cameras are the engine's.
"$trisplat" bake "$soup" --dataset "$dataset" --up y --target godot -o "$folder/scene.glb"
cp docs/images/capture.gd tests/judges/godot4/project.godot "$folder"
size=$(python3 - "$dataset" "$photo" "$folder/view.json" <<'PY'
import json, sys

dataset, photo, out = sys.argv[1:]
file = json.load(open(f"{dataset}/transforms.json"))
[frame] = [f for f in file["frames"] if f["file_path"].endswith(photo)]
# Like Godot's, these cameras look along -z with y up.
m = frame["transform_matrix"]
axes = [[m[row][column] for row in range(3)] for column in range(4)]
w, h, fy, cx, cy = (file[key] for key in ("w", "h", "fl_y", "cx", "cy"))
json.dump({"camera_to_world": axes, "height": h / fy, "offset": [(w / 2 - cx) / fy, (cy - h / 2) / fy]}, open(out, "w"))
print(f"{2 * int(w)}x{2 * int(h)}")
PY
)
target/judges/godot4 "$folder" --import >/dev/null
target/judges/godot4-screen "$folder" --rendering-method forward_plus --resolution "$size" --script capture.gd
convert "$(find "$dataset/images" -name "$photo")" -filter Mitchell -resize "$size" "$folder/photo.png"
twice=$(awk -F'[x+]' '{ print 2 * $1 "x" 2 * $2 "+" 2 * $3 "+" 2 * $4 }' <<<"$crop")
for panel in photo colors wires; do
    convert "$folder/$panel.png" -crop "$twice" +repage -filter Lanczos -resize 560x "$folder/$panel.crop.png"
done
convert "$folder"/{photo,colors,wires}.crop.png -background white -splice 8x0+0+0 +append -chop 8x0+0+0 -quality 88 docs/images/capture.jpg
