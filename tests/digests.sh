#!/usr/bin/env bash
# Whether two commits write the same files: builds both and compares SHA-256 of everything they make of the samples.
# Usage: tests/digests.sh COMMIT [COMMIT]     the second is the working tree unless given
#        tests/digests.sh --list PROGRAM      prints the digests of one program
# Prints what differs; exit code 1 if something does. Takes about two builds and eight minutes on two cores.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD

# Reports without what differs from run to run: times, memory, paths.
plain_report='
import json, sys
def plain(value):
    if isinstance(value, dict):
        timed = ("seconds", "secs", "peak_memory", "peak_bytes", "inputs", "dataset", "file", "generator", "started")
        return {k: plain(v) for k, v in value.items() if not any(word in k for word in timed)}
    return [plain(v) for v in value] if isinstance(value, list) else value
for path in sys.argv[1:]:
    with open(path) as file: report = plain(json.load(file))
    with open(path, "w") as file: json.dump(report, file, indent=1, sort_keys=True)
'

# run NAME ARGUMENTS...: runs the program in an empty folder and prints a digest per file that it leaves; a failure is a line too.
run() {
    local name=$1 code=0
    shift
    mkdir -p "$work/$name"
    (cd "$work/$name" && "$program" --quiet --threads "$threads" "$@" >"$work/log" 2>&1) || code=$?
    if [ "$code" != 0 ]; then
        printf '%-64s exit %s\n' "$threads/$name" "$code"
        head -n 3 "$work/log" | sed 's/^/    /' >&2
    fi
    (
        cd "$work/$name"
        find . -name '*.json' ! -name '*.tileset.json' -path '*report*' -exec python3 -c "$plain_report" {} +
        # The notes of a run in its work folder contain times.
        find . -type f ! -path './work/*.json' | LC_ALL=C sort | while read -r file; do
            printf '%-64s %s\n' "$threads/$name/${file#./}" "$(sha256sum <"$file" | cut -c1-64)"
        done
    )
}

bakes() {
    local scene preset target
    for scene in trained studio degenerate; do
        for preset in fast default small; do
            for target in gltf godot godot3 unity unreal blender web playcanvas; do
                run "bake-$scene-$preset-$target" bake "$samples/soups/$scene.ply" -o scene.glb --preset $preset --target $target
            done
        done
        for ending in gltf obj ply usdz html tileset.json; do
            run "bake-$scene-$ending" bake "$samples/soups/$scene.ply" -o "scene.$ending"
        done
    done
    local photos=(--dataset "$samples/dataset")
    run bake-photos bake "$samples/soups/trained.ply" -o scene.glb "${photos[@]}" --report report.json
    run bake-few bake "$samples/soups/trained.ply" -o scene.glb "${photos[@]}" --max-triangles 2000 --lod 0.5,0.25 --target godot
    run bake-bytes bake "$samples/soups/trained.ply" -o scene.glb --max-bytes 200kB
    run bake-texture bake "$samples/soups/trained.ply" -o scene.glb "${photos[@]}" --texture --max-triangles 3000
    run bake-texture-obj bake "$samples/soups/trained.ply" -o scene.obj "${photos[@]}" --texture --max-triangles 3000
    run bake-sky bake "$samples/soups/trained.ply" -o scene.glb "${photos[@]}" --backdrop sky
    run bake-file bake "$samples/soups/trained.ply" -o scene.glb "${photos[@]}" --backdrop file --lit
    run bake-collision bake "$samples/soups/trained.ply" -o scene.glb "${photos[@]}" --collision --crop subject
    run bake-merged bake "$samples/soups/trained.ply" "$samples/soups/studio.ply" -o scene.glb
    run mesh mesh "$samples/soups/trained.ply" "$samples/dataset" -o surface.ply
    run mesh-texture mesh "$samples/soups/trained.ply" "$samples/dataset" -o surface.glb --texture --max-triangles 1000
    run render render "$samples/soups/trained.ply" -o pictures --dataset "$samples/dataset" --split test
    run orbit render "$samples/soups/trained.ply" -o pictures --orbit 4 --width 200
    run eval eval "$samples/soups/trained.ply" "$samples/dataset" --report report.json
    run info info "$samples/soups/trained.ply"
    run validate validate "$work/bake-photos/scene.glb"
}

trainings() {
    local preset
    for preset in solid soft-outdoor soft-indoor; do
        run "train-$preset" train "$samples/dataset" -o scene.ply --steps 300 --max-triangles 3000 --preset $preset
    done
    run train-teacher train "$samples/dataset" -o scene.ply --steps 300 --max-triangles 3000 --teacher auto
    run train-masks train "$samples/dataset" -o scene.ply --steps 300 --max-triangles 3000 --seed 5 --max-size 100
    run bake-soft bake "$work/train-soft-outdoor/scene.ply" -o scene.glb
    run bake-soft-fast bake "$work/train-soft-outdoor/scene.ply" -o scene.glb --preset fast
    run bake-soft-photos bake "$work/train-soft-outdoor/scene.ply" -o scene.glb --dataset "$samples/dataset"
    run harden bake "$work/train-soft-outdoor/scene.ply" -o scene.glb --harden=200
    run harden-photos bake "$work/train-soft-outdoor/scene.ply" -o scene.glb --harden=200 --dataset "$samples/dataset"
    run render-soft render "$work/train-soft-outdoor/scene.ply" -o pictures --orbit 3 --width 120 --as soft
    run eval-soft eval "$work/train-soft-outdoor/scene.ply" "$samples/dataset" --report report.json
    run make make "$samples/dataset" -o made.glb --steps 400 --work work
    run plan plan "$samples/dataset" -o plan --blocks 2
}

# digests PROGRAM: a line per file.
digests() {
    program=$(realpath "$1")
    work=$(mktemp -d)
    samples=$work/samples
    cp -r "$root/samples" "$samples"
    for threads in 1 2; do
        bakes
        trainings
        find "$work" -mindepth 1 -maxdepth 1 -type d ! -name samples -exec rm -rf {} +
    done
    rm -rf "$work"
}

# build COMMIT: prints the path of its program; the samples are those of the working tree for both.
build() {
    local folder=$root/target/digests/$1
    if [ "$1" = tree ]; then
        cargo build --quiet --release >&2
        echo target/release/trisplat
        return
    fi
    [ -d "$folder" ] || git worktree add --quiet --detach "$folder" "$1" >&2
    (cd "$folder" && CARGO_TARGET_DIR=$root/target/digests/build cargo build --quiet --release) >&2
    cp "$root/target/digests/build/release/trisplat" "$root/target/digests/$1.program"
    git worktree remove --force "$folder"
    echo "target/digests/$1.program"
}

case ${1:?tests/digests.sh COMMIT [COMMIT]} in
--list) digests "$2" ;;
*)
    mkdir -p target/digests
    first=$(build "$(git rev-parse "$1")")
    second=$(build "$([ $# -gt 1 ] && git rev-parse "$2" || echo tree)")
    digests "$first" >target/digests/first.txt
    digests "$second" >target/digests/second.txt
    diff target/digests/first.txt target/digests/second.txt || exit 1
    echo "the same $(wc -l <target/digests/first.txt) lines"
    ;;
esac
