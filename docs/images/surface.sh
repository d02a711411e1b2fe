#!/usr/bin/env bash
# Makes docs/images/surface.jpg: a textured surface of a part of a capture, from three sides, as `trisplat render` draws it.
# Usage: docs/images/surface.sh TRISPLAT DATASET REGION   (with ImageMagick)
# REGION is what `--crop` takes. It trains for up to four minutes of CPU time.
set -euo pipefail
trisplat=$(realpath "$1")
dataset=$(realpath "$2")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$trisplat" train "$dataset" -o "$folder/scene.ply" --budget 4m
"$trisplat" mesh "$folder/scene.ply" "$dataset" --texture --set texels_per_pixel=1 --max-triangles 4000 "--crop=$3" -o "$folder/surface.glb"
"$trisplat" render "$folder/surface.glb" --orbit 9 --width 2400 --background white -o "$folder"
for picture in 0 1 3; do
    convert "$folder/orbit_000$picture.png" -fuzz 2% -trim +repage -bordercolor white -border 12 -filter Lanczos -resize 560x "$folder/$picture.png"
done
convert "$folder"/{0,1,3}.png -background white -gravity center +append -quality 88 docs/images/surface.jpg
