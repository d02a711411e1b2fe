#!/usr/bin/env python3
"""Error over time: files that `trisplat` makes of photos within some budgets, scored on held-out photos.

    python3 docs/benchmarks/curves.py run TRISPLAT FOLDER DATASET...     adds rows to curves.csv; BUDGETS="30s 1m" chooses others
    python3 docs/benchmarks/curves.py plot                               draws curves.svg from curves.csv (needs matplotlib)

Each row is `train --budget`, `bake --dataset` and `eval` with one thread. FOLDER gets the files; what is there is not made again.
"""

import csv
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

TABLE = Path(__file__).with_suffix(".csv")


def cpu_seconds(command):
    """Runs a command; gives its user and system time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def row(program, folder, data, budget):
    """Trains, bakes and scores one file."""
    scene, asset, scores = (folder / f"{data.name}-{budget}{end}" for end in (".ply", ".glb", ".json"))
    seconds = scene.with_suffix(".seconds")
    one = [program, "--quiet", "--threads", "1"]
    if not seconds.exists():
        seconds.write_text(str(cpu_seconds([*one, "train", data, "-o", scene, "--force", "--budget", budget])))
    if not asset.exists():
        cpu_seconds([*one, "bake", scene, "-o", asset, "--dataset", data])
    if not scores.exists():
        cpu_seconds([*one, "eval", asset, data, "--report", scores])
    mean = json.loads(scores.read_text())["steps"][-1]["mean"]
    photos = len((data / "train.txt").read_text().split())
    return [data.name, photos, budget, f"{float(seconds.read_text()):.0f}", f"{mean['psnr']:.2f}"]


def run(program, folder, *datasets):
    """Adds the rows of some data sets to the table."""
    program, folder = os.path.realpath(program), Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for data in map(Path, datasets):
        for budget in os.environ.get("BUDGETS", "30s 1m 2m 5m 15m").split():
            cells = row(program, folder, data.resolve(), budget)
            print(*cells, flush=True)
            with TABLE.open("a", newline="") as table:
                csv.writer(table, lineterminator="\n").writerow(cells)


def plot():
    """Draws the curves: CPU seconds against PSNR, a line for each scene."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "curves", "svg.fonttype": "none"})
    from matplotlib import pyplot

    with TABLE.open() as table:
        rows = list(csv.DictReader(table))
    figure, axes = pyplot.subplots(figsize=(8, 4.5), layout="constrained")
    for scene, photos in dict.fromkeys((row["scene"], row["photos"]) for row in rows):
        of_scene = [row for row in rows if (row["scene"], row["photos"]) == (scene, photos)]
        points = sorted((float(row["seconds"]), float(row["psnr"])) for row in of_scene)
        axes.plot(*zip(*points), marker="o", markersize=3, label=f"{scene}, {photos} photos")
    axes.set_xscale("log")
    axes.set_xticks([30, 60, 120, 300, 900], ["30", "60", "120", "300", "900"])
    axes.minorticks_off()
    axes.set(xlabel="CPU seconds of training", ylabel="PSNR of the file, held-out photos, dB")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(TABLE.with_suffix(".svg"), metadata={"Date": None})


if __name__ == "__main__":
    try:
        {"run": run, "plot": plot}[sys.argv[1]](*sys.argv[2:])
    except (IndexError, KeyError):
        sys.exit(__doc__)
