"""A killed worker changes no byte: runs samples/cluster/ray_city.py on a plan, kills its blocks at random, compares with blocks trained
one after the other.

    python tests/judges/cluster.py CITY TRISPLAT [KILLS]

CITY is a plan none of whose blocks is trained; copies of it are trained beside it. Wants Linux, and `ray` in this Python.
"""

import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import time

city, trisplat = pathlib.Path(sys.argv[1]).resolve(), str(pathlib.Path(sys.argv[2]).resolve())
kills = int(sys.argv[3]) if len(sys.argv) > 3 else 6
driver = pathlib.Path(__file__).resolve().parents[2] / "samples/cluster/ray_city.py"
serial, fanned = city.with_name(city.name + "-serial"), city.with_name(city.name + "-fanned")
for copy in (serial, fanned):
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(city, copy)


def running():
    """Processes that train a block of the copy that is fanned out."""
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if len(words) > 3 and words[1:3] == [b"train", b"--block"] and words[3].startswith(bytes(fanned) + b":"):
            yield int(process.name)


blocks = (city / "manifest.json").read_text().count('"key":')
for block in range(blocks):
    subprocess.run([trisplat, "train", "-q", "--block", f"{serial}:{block}", "--threads", "1"], check=True)
random.seed(int(os.environ.get("SEED", "1")))
job = subprocess.Popen([sys.executable, driver, fanned, "--trisplat", trisplat, "--cpus", "1"])
killed = []
while job.poll() is None:
    time.sleep(random.uniform(0.5, 3.0))
    for process in random.sample(list(running()), k=min(1, len(list(running())))):
        if len(killed) < kills:
            how = random.choice([signal.SIGKILL, signal.SIGTERM])
            os.kill(process, how)
            killed.append(how.name)
print("killed:", ", ".join(killed) or "nothing")
assert job.returncode == 0, f"the driver ended with {job.returncode}"
made = sorted(path.name for path in serial.glob("block-*.ply"))
assert len(made) == blocks and made == sorted(path.name for path in fanned.glob("block-*.ply"))
for name in made:
    assert (serial / name).read_bytes() == (fanned / name).read_bytes(), f"{name} differs"
assert (fanned / "city.ply").is_file() and (fanned / "city.tileset.json").is_file()
print(f"{blocks} blocks: the same bytes after {len(killed)} kills")
