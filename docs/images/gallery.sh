#!/usr/bin/env bash
# Makes docs/images/gallery-*.jpg: a photo, or a drawing of the Gaussians, the same view of the file as `trisplat render`
# draws it, and its wires.
# Usage: docs/images/gallery.sh TRISPLAT DATA FILES   (with ImageMagick)
# DATA holds the data set `banana`, and splats.ply, Gaussians trained on it. Files that are in the folder FILES are taken
# as they are, others made by the commands below, in three minutes of CPU time for all.
set -euo pipefail
trisplat=$(realpath "$1")
data=$(realpath "$2")
mkdir -p "$3"
files=$(realpath "$3")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
# scene NAME DATASET PHOTO COMMAND...: the file of a command that writes $files/NAME.glb, seen from a photo that training did not see.
scene() {
    local name=$1 dataset=$2 photo=$3
    shift 3
    [ -e "$files/$name.glb" ] || "$trisplat" "$@" -o "$files/$name.glb"
    for show in color wires; do
        "$trisplat" render "$files/$name.glb" --dataset "$dataset" --show $show -q -o "$folder/${name}_$show"
    done
    local left=$dataset/images/$photo
    if [ "$name" = splats ]; then
        "$trisplat" render "$data/splats.ply" --dataset "$dataset" -q -o "$folder/left"
        left=$folder/left/${photo%.*}.png
    fi
    convert "$left" "$folder/${name}_color/${photo%.*}.png" "$folder/${name}_wires/${photo%.*}.png" \
        -resize 400x -background white -splice 6x0+0+0 +append -chop 6x0+0+0 -quality 80 "docs/images/gallery-$name.jpg"
}
scene bananas "$data/banana" DSC_0423.jpg make "$data/banana" --budget 60s
scene splats "$data/banana" DSC_0431.jpg bake "$data/splats.ply" --preset fast
