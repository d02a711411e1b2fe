#!/usr/bin/env bash
# Measures training and drawing on this machine's graphics card, in at most eight minutes, with programs that are already built:
#   cargo build --release --features gpu && cargo build --release -p trisplat-bench --features gpu
#   cargo test --release -p trisplat-train --features gpu --test train --no-run
#   docs/benchmarks/gpu.sh [PROGRAM] [TEST PROGRAM] [DATASET] >gpu.txt
# DATASET is a folder of photos and poses, which are taken at full size. Without a card, SMALL=1 measures software Vulkan on small
# sizes. What takes longer than its share is stopped, and says so. Tables go to standard output, in the form of gpu.md.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
program=$(realpath "${1:-$root/target/release/trisplat}")
tests=${2:+$(realpath "$2")}
dataset=${3:+$(realpath "$3")}
bench=$(dirname "$program")/trisplat-bench
[ -x "$program" ] && [ -x "$bench" ] || { echo "gpu.sh: $program or $bench is no program; build both first" >&2; exit 1; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
end=$((SECONDS + 470)) test_seconds=120 run_seconds=30

# within SECONDS COMMAND...: stops it, in good order, after these seconds or at the end of the eight minutes.
within() {
    local most=$1 left=$((end - SECONDS))
    shift
    [ "$left" -gt 5 ] || { echo "no time left for: ${*:2:3}"; return 1; }
    timeout --signal=INT --kill-after="${grace:-10}" "$((most < left ? most : left))" "$@"
}

if [ -n "${SMALL:-}" ]; then
    # Its compiler takes long, and so do debug builds of this program.
    end=$((SECONDS + 2400)) test_seconds=1800 run_seconds=200
    sizes=64:500:400:80
    fps=(--triangles 5000 --sizes 160x90 --frames 5 --warmup 1) steps=60 triangles=500
else
    sizes='640:50000:200000:400 1280:200000:1000000:300 1920:400000:3000000:300'
    fps=(--triangles 2000000 --sizes 1280x720,1920x1080,3840x2160 --frames 200) steps=30000 triangles=3000000
fi

# What is here. Containers often have the driver of an NVIDIA card without the file that names it.
nvidia-smi -L 2>/dev/null || true
if [ -z "${VK_DRIVER_FILES:-}" ] && ! ls /etc/vulkan/icd.d/nvidia* /usr/share/vulkan/icd.d/nvidia* >/dev/null 2>&1; then
    for library in libGLX_nvidia.so.0 libEGL_nvidia.so.0; do
        if ldconfig -p 2>/dev/null | grep -q "$library"; then
            printf '{"file_format_version": "1.0.0", "ICD": {"library_path": "%s", "api_version": "1.3.0"}}' "$library" >nvidia_icd.json
            export VK_DRIVER_FILES="$folder/nvidia_icd.json" VK_ICD_FILENAMES="$folder/nvidia_icd.json"
            break
        fi
    done
fi

# Correctness first: figures of wrong pictures are worth little. A card is rare, though, so they are taken all the same.
correct=true
if [ -n "$tests" ]; then
    if TRISPLAT_REQUIRE_GPU=1 within "$test_seconds" "$tests" gpu:: >tests.log 2>&1; then
        grep 'test result' tests.log
    else
        correct=false
        echo 'the tests FAILED or took too long; what follows is of a training that may be wrong:'
        cat tests.log
    fi
fi

# last FILE KEY: a number of the last sample of a log.
last() { tail -n 1 "$1" | grep -o "\"$2\":[0-9.e+-]*" | cut -d: -f2; }

# run BACKEND STEPS TRIANGLES SECONDS: a row of the table for the data set in `photos`; a run that takes longer is stopped.
run() {
    local backend=$1 steps=$2 triangles=$3 seconds=$4 lines
    rm -f log.jsonl scene.*
    within "$seconds" "$program" train photos -o scene.ply --backend "$backend" --preset outdoor --steps "$steps" \
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

echo
echo '## Runs, densifications included'
echo '| backend | width | triangles at the end | steps/s | CPU ms per step |'
echo '|---|---|---|---|---|'
touch cards.txt
for size in $sizes; do
    IFS=: read -r width points most count <<<"$size"
    rm -rf photos
    "$bench" sample dataset -o photos --views 16 --width "$width" --points "$points" 2>/dev/null
    run gpu "$count" "$most" "$run_seconds"
    run cpu "$((count / 10 < 40 ? 40 : count / 10))" "$most" 15
done
sort -u cards.txt | sed 's/^/card: /'

# Frames a second, before the data set, which takes all that is left.
echo
echo '## Frames per second of the solid scene'
within 60 "$bench" fps "${fps[@]}" 2>&1 || echo 'stopped early'

if [ -n "$dataset" ]; then
    echo
    echo "## $(basename "$dataset") at full size, $steps steps, up to $triangles triangles"
    rm -f log.jsonl scene.*
    # Few photos are held out: they are drawn on the CPU. A run that is stopped draws them too, and writes its scene.
    left=$((end - SECONDS - 100))
    grace=60 within "$left" "$program" train "$dataset" -o scene.ply --backend gpu --preset outdoor --steps "$steps" \
        --max-triangles "$triangles" --log log.jsonl --log-every "$((steps / 30))" --eval-every "$((steps / 3))" --test-every 60 2>messages.txt ||
        cat messages.txt
    echo '| step | triangles | seconds | PSNR, training photos | PSNR, held out |'
    echo '|---|---|---|---|---|'
    while read -r line; do
        echo "$line" >line.jsonl
        printf '| %s | %s | %.1f | %.2f | %.5s |\n' "$(last line.jsonl step)" "$(last line.jsonl triangles)" \
            "$(last line.jsonl wall_secs)" "$(last line.jsonl psnr)" "$(last line.jsonl test_psnr || true)"
    done <log.jsonl
fi
echo
echo "measured in $SECONDS s"
$correct
