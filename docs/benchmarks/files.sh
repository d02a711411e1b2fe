#!/usr/bin/env bash
# Scores every way from photos to a file on held-out photos, the file read back and drawn as an engine does (files.md):
#   LPIPS="python3 samples/score_lpips.py" docs/benchmarks/files.sh PROGRAM FOLDER DATA_SET... >files.txt
# FOLDER gets scenes, files, reports and drawings; what is there already is not made again. LPIPS is a command that is called as
# `$LPIPS DRAWINGS PHOTOS --json OUT` and writes {"mean": {"lpips": FIGURE}}; without it that column is empty.
# One thread, so that user seconds are those of the work.
set -euo pipefail
program=$(realpath "$1")
folder=$(realpath -m "$2")
shift 2
mkdir -p "$folder"

# timed NAME OUTPUT COMMAND...: runs it unless its output is there; user and system seconds go to NAME.seconds.
timed() {
    local name=$1 output=$2
    shift 2
    [ -s "$output" ] && return
    TIMEFORMAT='%U %S'
    { time "$program" "$@" -o "$output" --threads 1 --force --quiet 2>"$name.messages"; } 2>"$name.seconds" || { cat "$name.messages" >&2; return 1; }
}

# figures NAME: PSNR, SSIM, FLIP, LPIPS and triangles, as cells of a table.
figures() {
    python3 - "$1" <<'PY'
import json, os, sys
name = sys.argv[1]
drawn = json.load(open(name + ".json"))["steps"][-1]
scores = drawn["mean"]
lpips = f'{json.load(open(name + ".lpips"))["mean"]["lpips"]:.3f}' if os.path.exists(name + ".lpips") else ""
print(f'| {scores["psnr"]:.2f} | {scores["ssim"]:.3f} | {scores["flip"]:.3f} | {lpips} | {drawn["triangles"]:,} |', end="")
PY
}

# row SCENE WAY FILE KIND SECONDS...: scores a file and prints its row; the seconds are those of all steps that led to it.
row() {
    local scene=$1 way=$2 file=$3 kind=$4 name=${3%.*} seconds
    shift 4
    if [ ! -s "$name.json" ]; then
        "$program" eval "$file" "$data" --as "$kind" --ssaa 4 --json --save-renders "$name.drawings" --force >"$name.json" 2>"$name.messages"
    fi
    if [ -n "${LPIPS:-}" ] && [ ! -s "$name.lpips" ]; then
        $LPIPS "$name.drawings" "$data/images" --json "$name.lpips" >/dev/null
    fi
    seconds=$(cat "$@" | awk '{ sum += $1 + $2 } END { printf "%.0f", sum }')
    echo "| $scene | $way $(figures "$name") $seconds |"
}

echo '| scene | way | PSNR | SSIM | FLIP | LPIPS | triangles | CPU s |'
echo '|---|---|---|---|---|---|---|---|'
for data in "$@"; do
    data=$(realpath "$data")
    scene=$(basename "$data")
    at=$folder/$scene
    size=(--steps 2500 --max-triangles 40000)
    timed "$at-soft" "$at-soft.ply" train "$data" --preset outdoor "${size[@]}" --backend cpu
    row "$scene" 'soft scene, drawn soft' "$at-soft.ply" soft "$at-soft.seconds"
    timed "$at-plain" "$at-plain.glb" bake "$at-soft.ply" --teacher off
    row "$scene" 'made solid only' "$at-plain.glb" solid "$at-soft.seconds" "$at-plain.seconds"
    timed "$at-bake" "$at-bake.glb" bake "$at-soft.ply"
    row "$scene" 'bake, on its own pictures' "$at-bake.glb" solid "$at-soft.seconds" "$at-bake.seconds"
    timed "$at-photos" "$at-photos.glb" bake "$at-soft.ply" --dataset "$data"
    row "$scene" 'bake with the photos' "$at-photos.glb" solid "$at-soft.seconds" "$at-photos.seconds"
    timed "$at-harden" "$at-harden.glb" bake "$at-soft.ply" --harden
    row "$scene" 'harden, on its own pictures' "$at-harden.glb" solid "$at-soft.seconds" "$at-harden.seconds"
    timed "$at-harden-photos" "$at-harden-photos.glb" bake "$at-soft.ply" --harden --dataset "$data"
    row "$scene" 'harden with the photos' "$at-harden-photos.glb" solid "$at-soft.seconds" "$at-harden-photos.seconds"
    timed "$at-solid" "$at-solid.ply" train "$data" "${size[@]}" --backend cpu
    timed "$at-default" "$at-default.glb" bake "$at-solid.ply" --dataset "$data"
    row "$scene" '**solid from the photos (the default)**' "$at-default.glb" solid "$at-solid.seconds" "$at-default.seconds"
done
