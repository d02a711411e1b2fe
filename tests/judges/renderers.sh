#!/usr/bin/env bash
# Draws a baked file with renderers by others from a data set's held-out cameras, and compares with the photos.
# Usage: tests/judges/renderers.sh FILE DATASET [FOLDER]   (FOLDER: where to keep the pictures)
#
# tests/run.sh installs Chromium and f3d under target/judges; one that is missing is left out, loudly.
# Fails when a renderer is more than 0.3 dB from ours. docs/benchmarks/figures.md holds results.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,4p' "$0" >&2; exit 2; }
TRISPLAT_FILE=$(realpath "$1")
TRISPLAT_DATASET=$(realpath "$2")
export TRISPLAT_FILE TRISPLAT_DATASET
if [ $# -ge 3 ]; then
    mkdir -p "$3"
    TRISPLAT_KEEP=$(realpath "$3")
    export TRISPLAT_KEEP
fi
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
exec cargo test --test judges renderers::outside_renderers_agree_on_the_photos -- --exact --nocapture
