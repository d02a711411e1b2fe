#!/usr/bin/env bash
# Makes docs/images/surface.jpg: the textured surface of a command of the README, from three sides, as `trisplat render`
# draws it.
# Usage: docs/images/surface.sh TRISPLAT PHOTOS   (with ImageMagick)
# It trains for half a minute of CPU time; where the circle of pictures begins may differ from run to run.
set -euo pipefail
trisplat=$(realpath "$1")
photos=$(realpath "$2")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$trisplat" mesh "$photos" --texture --max-triangles 4000 --crop subject -o "$folder/object.glb"
"$trisplat" render "$folder/object.glb" --orbit 9 --width 1200 --background white -o "$folder"
for picture in 4 5 6; do
    convert "$folder/orbit_000$picture.png" -fuzz 2% -trim +repage -bordercolor white -border 12 -filter Lanczos -resize 560x "$folder/$picture.png"
done
convert "$folder"/{4,5,6}.png -background white -gravity center +append -quality 85 docs/images/surface.jpg
