#!/bin/sh
# The rows of scale.md: one run, then the same scene in 1, 2, 4 and 8 blocks, on one thread each.
#
#   sh docs/benchmarks/scale.sh TRISPLAT PHOTOS FOLDER [training options]
#
# BLOCKS="2 4" chooses others, PLAN="--passes 0.5" gives options to the plan only.
set -eu

trisplat=$1 photos=$2 folder=$3
shift 3
mkdir -p "$folder"
one=$folder/one.ply
[ -e "$one" ] || "$trisplat" train "$photos" -o "$one" --report "$folder/one.json" --threads 1 "$@"
for blocks in ${BLOCKS:-1 2 4 8}; do
  city=$folder/city$blocks${NAME:-}
  # The coarse scene depends on nothing but the photos and its options.
  mkdir -p "$city" && cp "$folder"/coarse-*.ply "$city" 2>/dev/null || true
  "$trisplat" plan "$photos" -o "$city" --blocks "$blocks" ${PLAN:-} --threads 1 --force "$@"
  cp -n "$city"/coarse-*.ply "$folder" 2>/dev/null || true
  block=0
  while [ "$block" -lt "$blocks" ]; do
    "$trisplat" train -q --block "$city:$block" --threads 1
    block=$((block + 1))
  done
  "$trisplat" plan --status "$city"
  "$trisplat" merge "$city" -o "$city.ply" --force
  "$trisplat" eval "$city.ply" "$photos" --as soft -q
done
