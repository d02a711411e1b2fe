#!/bin/sh
# Stands in for COLMAP: answers with the model in `model` beside it. Notes its arguments in `calls` there, if that exists; fails or
# waits at the command that `fails` or `waits` there names.
here=$(dirname "$0")
case "$*" in
help) echo "COLMAP 3.8 -- Structure-from-Motion"; echo "(Commit Unknown on Unknown without CUDA)"; exit 0 ;;
*-h) echo "--SiftExtraction.use_gpu --SiftExtraction.max_image_size --SiftMatching.use_gpu --Mapper.num_threads"; exit 0 ;;
esac
[ -f "$here/calls" ] && echo "$*" >> "$here/calls"
command=$1
while [ $# -gt 0 ]; do
    case "$1" in
    --database_path) database=$2 ;;
    --output_path) output=$2 ;;
    esac
    shift
done
if [ "$(cat "$here/fails" 2>/dev/null)" = "$command" ]; then
    echo "loading"; echo "ERROR: the disk is made of cheese"; echo "bye"; exit 1
fi
if [ "$(cat "$here/waits" 2>/dev/null)" = "$command" ]; then
    sleep 1000 &
    echo "$! $$" > "$here/pids"
    wait
fi
case "$command" in
feature_extractor) echo "Processed file [1/2]"; echo features > "$database" ;;
*matcher | *importer) echo "Matching block [1/1, 1/1]" ;;
mapper) mkdir -p "$output/0" "$output/1"; cp "$here/model/"* "$output/0"; echo "Registering image #2 (40)" ;;
esac
