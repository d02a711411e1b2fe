#!/usr/bin/env python3
"""The curves of trainings as a picture, and for TensorBoard.

    pip install matplotlib                       (and tensorboardX for --tensorboard)
    trisplat train photos -o scene.ply --log scene.jsonl --eval-every 500
    python samples/plot_log.py scene.jsonl [other.jsonl ...] -o curve.png [--tensorboard runs]
"""

import argparse
import json
from pathlib import Path

parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
parser.add_argument("logs", type=Path, nargs="+", help="files that `trisplat train --log` wrote")
parser.add_argument("-o", "--output", type=Path, default="curve.png", help="picture to write: .png .svg .pdf")
parser.add_argument("--tensorboard", type=Path, help="folder of runs to write, for `tensorboard --logdir`")
args = parser.parse_args()
runs = {log.stem: [json.loads(line) for line in log.read_text().splitlines()] for log in args.logs}

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot

figure, axes = pyplot.subplots(1, 3, figsize=(15, 4), layout="constrained")
for name, samples in runs.items():
    for axis, key, label in zip(axes, ["psnr", "loss", "triangles"], ["PSNR, dB", "loss", "triangles"]):
        axis.plot([s["step"] for s in samples], [s[key] for s in samples], label=name)
        axis.set(xlabel="step", ylabel=label)
    held_out = [(s["step"], s["test_psnr"]) for s in samples if "test_psnr" in s]
    axes[0].plot(*zip(*held_out), "o--", label=f"{name}, held out") if held_out else None
axes[0].legend()
figure.savefig(args.output, dpi=120)

if args.tensorboard:
    from tensorboardX import SummaryWriter

    for name, samples in runs.items():
        with SummaryWriter(str(args.tensorboard / name)) as writer:
            for sample in samples:
                for key in ("psnr", "test_psnr", "loss", "triangles", "cpu_secs"):
                    if key in sample:
                        writer.add_scalar(key, sample[key], sample["step"])
