"""Trains a planned scene on a Ray cluster: blocks fan out, lost workers are replaced, then blocks are merged and tiled.

    trisplat plan photos -o city --blocks 8
    python samples/cluster/ray_city.py city [--address auto] [--cpus 2] [--gpus 0]

CITY and the photos are on storage that every machine mounts at the same path. What is done is never done again: start it anew at any time.
"""

import argparse
import ctypes
import json
import pathlib
import signal
import subprocess
import sys

import ray

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("city", type=pathlib.Path, help="folder of the plan")
parser.add_argument("--trisplat", default="trisplat", help="the program, on every machine")
parser.add_argument("--address", help="of a running cluster; without it one is started here")
parser.add_argument("--cpus", type=float, default=2, help="cores of a block")
parser.add_argument("--gpus", type=float, default=0, help="cards of a block")
parser.add_argument("--retries", type=int, default=20, help="of a block whose process was killed")
args = parser.parse_args()
city = args.city.resolve()
manifest = json.loads((city / "manifest.json").read_text())


def die_with_the_worker():
    if sys.platform == "linux":  # else a block may go on after its worker was killed, and its successor would find it at work
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


@ray.remote(num_cpus=args.cpus, num_gpus=args.gpus, max_retries=args.retries, retry_exceptions=[ChildProcessError])
def train(block):
    command = [args.trisplat, "train", "--block", f"{city}:{block}", "--threads", str(max(1, round(args.cpus)))]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=die_with_the_worker)
    if done.returncode == 1 and "another program" not in done.stderr:  # it says what is wrong: trying again would not help
        raise RuntimeError(f"block {block}: {done.stderr.strip()}")
    if done.returncode != 0:  # killed or preempted: the next one goes on from the checkpoint
        raise ChildProcessError(f"block {block} ended with {done.returncode}")
    return block


ray.init(address=args.address, log_to_driver=False)
# The largest first: the last to end is then a small one.
expected = {i: block["expected"] for i, block in enumerate(manifest["blocks"])}
order = sorted(expected, key=lambda i: -expected[i]["cpu_secs"])
left = [train.options(memory=expected[i]["bytes"]).remote(i) for i in order]
while left:
    done, left = ray.wait(left)
    print(f"block {ray.get(done[0])} done, {len(left)} of {len(order)} left", flush=True)
for outcome in (["merge", city, "-o", city / "city.ply", "-f"], ["bake", city, "-o", city / "city.tileset.json", "-f"]):
    subprocess.run([args.trisplat, *map(str, outcome)], check=True)
