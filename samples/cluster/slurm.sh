#!/bin/sh
# Trains a planned scene on a Slurm cluster: an array of blocks, then a job that merges and tiles them when all are done.
#
#   trisplat plan photos -o city --blocks 8
#   sh samples/cluster/slurm.sh city [options of sbatch for blocks, as in --partition=spot --gres=gpu:1]
#
# CITY and the photos are on storage that every machine mounts at the same path. What is done is never done again: submit it anew at any
# time. A machine that is taken away sends SIGTERM: the block writes a checkpoint, is queued again, and goes on elsewhere.
set -eu

# A word as another shell reads it, whatever is in it.
quoted() { printf "'%s'" "$(printf '%s' "$1" | sed "s/'/'\\\\''/g")"; }

city=$(realpath "${1:?usage: slurm.sh CITY [options of sbatch]}")
shift
trisplat=$(quoted "${TRISPLAT:-trisplat}")
# Slurm replaces what follows a % in the names of logs.
logs=$(printf '%s' "$city" | sed 's/%/%%/g')
manifest=$city/manifest.json
last=$(($(grep -c '"key":' "$manifest") - 1))
# The largest block's memory, in MB.
memory=$(sed -n 's/^ *"bytes": \([0-9]*\),\{0,1\}$/\1/p' "$manifest" | sort -n | tail -1)
memory=$((memory / 1000000 + 1))

# --signal warns a minute before the time is over; 143 is what trisplat ends with once its checkpoint is written.
blocks=$(sbatch --parsable --array=0-"$last" --requeue --signal=TERM@60 --mem="$memory"M --cpus-per-task="${CPUS:-2}" \
  --job-name=trisplat-blocks --output="$logs/block-%a.log" --open-mode=append "$@" <<JOB
#!/bin/sh
$trisplat train --block $(quoted "$city"):"\$SLURM_ARRAY_TASK_ID" --threads "\$SLURM_CPUS_PER_TASK" &
child=\$!
trap 'kill -TERM \$child' TERM
code=143
wait \$child && code=0 || code=\$?
if kill -0 \$child 2>/dev/null; then wait \$child && code=0 || code=\$?; fi
if [ \$code -eq 143 ]; then scontrol requeue "\${SLURM_ARRAY_JOB_ID}_\$SLURM_ARRAY_TASK_ID"; fi
exit \$code
JOB
)
sbatch --parsable --dependency=afterok:"$blocks" --kill-on-invalid-dep=yes --job-name=trisplat-merge --output="$logs/merge.log" <<JOB
#!/bin/sh
set -e
$trisplat merge $(quoted "$city") -o $(quoted "$city/city.ply") -f
$trisplat bake $(quoted "$city") -o $(quoted "$city/city.tileset.json") -f
JOB
echo "submitted; how far it is: $trisplat plan --status $(quoted "$city")"
