#!/usr/bin/env bash
# Makes docs/images/shine.jpg: a file with view-dependent colours from two sides, each beside a photo that training did
# not see.
# Usage: docs/images/shine.sh TRISPLAT PYTHON   (with ImageMagick; PYTHON has Blender as a module: pip install bpy)
# Blender takes some minutes for 30 photos of our own scene, training two minutes of CPU time.
set -euo pipefail
trisplat=$(realpath "$1")
python=$2
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$python" docs/images/shine.py "$folder/photos" >/dev/null
"$trisplat" train "$folder/photos" -o "$folder/scene.ply" --steps 4000 --max-triangles 40000 --sh-degree 3
"$trisplat" bake "$folder/scene.ply" --dataset "$folder/photos" --sh 3 -o "$folder/scene.glb"
"$trisplat" eval "$folder/scene.glb" "$folder/photos"
"$trisplat" render "$folder/scene.glb" --dataset "$folder/photos" -q -o "$folder/drawn"
for photo in 010 020; do
    convert "$folder/photos/images/$photo.jpg" "$folder/drawn/$photo.png" -crop 340x300+50+30 +repage -resize 300x +append \
        "$folder/$photo.png"
done
convert "$folder"/{010,020}.png -background white -splice 6x0+0+0 +append -chop 6x0+0+0 -quality 85 docs/images/shine.jpg
