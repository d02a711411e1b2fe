#!/usr/bin/env bash
# Measures training and drawing on this machine's graphics card, in at most eight minutes, with a program that is already built:
#   cargo build --release --features gpu
#   cargo test --release --features gpu --test train_gpu --no-run
#   docs/benchmarks/gpu.sh [PROGRAM] [TEST PROGRAM] >gpu.txt
# Without a card it measures software Vulkan, on small sizes (SMALL=1). The table goes to standard output, in the form of gpu.md.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
program=$(realpath "${1:-$root/target/release/trisplat}")
tests=${2:+$(realpath "$2")}
[ -x "$program" ] || { echo "gpu.sh: $program is no program; build it first" >&2; exit 1; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

# Correctness first: figures of wrong pictures are worth nothing.
if [ -n "$tests" ]; then
    TRISPLAT_REQUIRE_GPU=1 timeout 60 "$tests" --quiet >tests.log 2>&1 || { cat tests.log >&2; exit 1; }
    grep 'test result' tests.log
fi

# last FILE KEY: a number of the last sample of a log.
last() { tail -n 1 "$1" | grep -o "\"$2\":[0-9.e+-]*" | cut -d: -f2; }

# run BACKEND STEPS TRIANGLES SECONDS: a row of the table for the data set in `photos`; a run that takes longer is stopped.
run() {
    local backend=$1 steps=$2 triangles=$3 seconds=$4 lines
    rm -f log.jsonl scene.*
    timeout "$seconds" "$program" train photos -o scene.ply --backend "$backend" --preset outdoor --steps "$steps" \
        --max-triangles "$triangles" --log log.jsonl --log-every "$((steps / 8))" --set warmup.quarter_until=0 \
        --set warmup.half_until=0 2>messages.txt || [ -s log.jsonl ] || { cat messages.txt >&2; return; }
    grep -h 'training on' messages.txt >>cards.txt || true
    # The second half: the scene has grown, and what is compiled once is compiled.
    lines=$(wc -l <log.jsonl)
    if [ "$lines" -lt 2 ]; then echo "| $backend | $width px | too slow for ${seconds} s | | |"; return; fi
    sed -n "$((lines / 2))p" log.jsonl >half.jsonl
    awk -v w1="$(last half.jsonl wall_secs)" -v w2="$(last log.jsonl wall_secs)" -v c1="$(last half.jsonl cpu_secs)" \
        -v c2="$(last log.jsonl cpu_secs)" -v s1="$(last half.jsonl step)" -v s2="$(last log.jsonl step)" -v size="$width" \
        -v t="$(last log.jsonl triangles)" -v b="$backend" \
        'BEGIN { n = s2 - s1; printf "| %s | %s px | %s | %.2f | %.1f |\n", b, size, t, n / (w2 - w1), 1000 * (c2 - c1) / n }'
}

echo '| backend | width | triangles at the end | steps/s | CPU ms per step |'
echo '|---|---|---|---|---|'
if [ -n "${SMALL:-}" ]; then sizes=64:500:400:80; else sizes='640:50000:200000:400 1280:200000:1000000:300 1920:400000:3000000:300'; fi
for size in $sizes; do
    IFS=: read -r width points triangles steps <<<"$size"
    rm -rf photos
    "$program" sample dataset -o photos --views 16 --width "$width" --points "$points" 2>/dev/null
    run gpu "$steps" "$triangles" 60
    run cpu "$((steps / 10 < 40 ? 40 : steps / 10))" "$triangles" 50
done
sort -u cards.txt | sed 's/^/card: /'

# Frames a second of what was trained.
if [ -z "${SMALL:-}" ]; then
    timeout 60 "$program" bench fps --triangles 2000000 --sizes 1280x720,1920x1080 --frames 200 || true
fi
