#!/bin/sh
# From a bare checkout to a scene that was trained in blocks on a Ray cluster of several processes on this machine, merged and tiled.
#
#   sh samples/cluster/local.sh [FOLDER] [BLOCKS]
#
# Wants Rust, Python 3 with venv, and two cores. Start it anew at any time: what is done is not done again.
set -eu

here=$(cd "$(dirname "$0")/../.." && pwd)
folder=${1:-local}
blocks=${2:-4}
mkdir -p "$folder"
[ -n "${TRISPLAT:-}" ] || (cd "$here" && cargo build --release)
trisplat=${TRISPLAT:-$here/target/release/trisplat}
[ -x "$folder/venv/bin/python" ] || python3 -m venv "$folder/venv"
"$folder/venv/bin/python" -c "import ray" 2>/dev/null || "$folder/venv/bin/pip" install --quiet ray
[ -e "$folder/photos/test.txt" ] ||
  cargo run --release --manifest-path "$here/Cargo.toml" -p trisplat-bench -- sample dataset -o "$folder/photos" --views 120 --width 240 --force
[ -e "$folder/city/manifest.json" ] ||
  "$trisplat" plan "$folder/photos" -o "$folder/city" --blocks "$blocks" --steps 2000 --max-triangles 60000
"$folder/venv/bin/python" "$here/samples/cluster/ray_city.py" "$folder/city" --trisplat "$trisplat" --cpus 1
"$trisplat" plan --status "$folder/city"
