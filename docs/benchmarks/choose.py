#!/usr/bin/env python3
"""Compares ways to train on parts of captures, judged on training photos that are left out: how defaults are chosen.

    python3 docs/benchmarks/choose.py run FOLDER DATASET... --arm "NAME=PROGRAM [TRAIN OPTION...]" [--arm ...]
    python3 docs/benchmarks/choose.py table FOLDER NAME [NAME...]       mean and worst of each arm against the first
    python3 docs/benchmarks/choose.py leave-out FOLDER NAME [NAME...]   the arm chosen on all captures but one, scored on that one

A part has 14, 20 or 40 photos (fewer where a capture has fewer), evenly around or the nearest ones to one photo, and the points that two of
them track. Up to 24 other photos judge; the capture's held-out photos do not take part. FOLDER gets parts, files and scores; what is there is
not made again. BUDGET (40s of CPU time), SEEDS ("0 1"), SIZES ("14 20 40") and JOBS (2 at a time, one thread each) are environment variables.
"""

import json
import math
import os
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

KINDS = "SIMPLE_PINHOLE PINHOLE SIMPLE_RADIAL RADIAL OPENCV OPENCV_FISHEYE FULL_OPENCV FOV SIMPLE_RADIAL_FISHEYE RADIAL_FISHEYE".split()
LENGTHS = [3, 4, 4, 5, 8, 8, 12, 5, 4, 5]
MAX_JUDGES = 24
MEASURES = {
    "dB": lambda step: step["mean"]["psnr"],
    "SSIM": lambda step: step["mean"]["ssim"],
    "within 1%": lambda step: (step.get("depth") or {}).get("within"),
    "behind": lambda step: (step.get("depth") or {}).get("behind"),
    "unsupported": lambda step: (step.get("beside") or {}).get("unsupported"),
    "empty": lambda step: (step.get("beside") or {}).get("empty"),
}


def text_model(folder):
    """Lines of a COLMAP model: cameras; (name, id, pose, 2D points) of images; (id, place and colour, track) of points."""
    def rows(name):
        return [line for line in (folder / f"{name}.txt").read_text().splitlines() if not line.startswith("#")]

    images = rows("images")
    images = [(line.split()[9], line.split()[0], line, marks) for line, marks in zip(images[::2], images[1::2])]
    points = [(line.split()[0], " ".join(line.split()[1:8]), line.split()[8:]) for line in rows("points3D") if line]
    return rows("cameras"), images, points


def binary_model(folder):
    """The same of a binary model."""
    def reader(name):
        data, at = (folder / f"{name}.bin").read_bytes(), 0

        def read(layout):
            nonlocal at
            values = struct.unpack_from("<" + layout, data, at)
            at += struct.calcsize("<" + layout)
            return values

        def word():
            nonlocal at
            end = data.index(b"\0", at)
            found, at = data[at:end].decode(), end + 1
            return found
        return read, word

    cameras, images, points = [], [], []
    read, _ = reader("cameras")
    for _ in range(read("Q")[0]):
        index, kind, width, height = read("iiQQ")
        cameras.append(" ".join(map(str, [index, KINDS[kind], width, height, *read(f"{LENGTHS[kind]}d")])))
    read, word = reader("images")
    for _ in range(read("Q")[0]):
        index, *pose, camera = read("i7di")
        name = word()
        marks = [read("ddq") for _ in range(read("Q")[0])]
        line = " ".join(map(str, [index, *pose, camera, name]))
        images.append((name, str(index), line, " ".join(f"{x} {y} {point}" for x, y, point in marks)))
    read, _ = reader("points3D")
    for _ in range(read("Q")[0]):
        index, *rest = read("Q3d3Bd")
        track = read(f"{2 * read('Q')[0]}i")
        points.append((str(index), " ".join(map(str, rest)), [str(number) for number in track]))
    return cameras, images, points


def place(line):
    """Position of a camera."""
    w, x, y, z, *t = map(float, line.split()[1:8])
    r = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
         [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
         [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    return [-sum(r[j][i] * t[j] for j in range(3)) for i in range(3)]


def evenly(items, count):
    """`count` of the items, evenly."""
    return [items[(2 * k + 1) * len(items) // (2 * count)] for k in range(count)]


def parts(folder, data):
    """Writes the parts of a capture; gives their folders."""
    model = data / "sparse" / "0"
    cameras, images, points = (binary_model if (model / "cameras.bin").exists() else text_model)(model)
    held_out = set((data / "test.txt").read_text().split()) if (data / "test.txt").exists() else set()
    photos = sorted(image for image in images if image[0] not in held_out)
    made, counts = [], []
    for size in map(int, os.environ.get("SIZES", "14 20 40").split()):
        count = min(size, len(photos) * 5 // 6)
        for way in ["even", "side"]:
            near = sorted(photos, key=lambda image: math.dist(place(image[2]), place(photos[0][2])))
            among = photos if way == "even" else sorted(near[:count + max(3, count // 4)])
            if (way, count) in counts or (way == "side" and len(among) == len(photos)):
                continue
            counts.append((way, count))
            train = evenly(among, count)
            rest = [image for image in among if image not in train]
            made.append(write(folder / f"{data.name}-{way}{count}", data, cameras, points, train,
                              evenly(rest, min(MAX_JUDGES, len(rest)))))
    return made


def write(part, data, cameras, points, train, judges):
    """Writes a part: the model of its photos, and links to them."""
    (part / "sparse" / "0").mkdir(parents=True, exist_ok=True)
    for name in ["images", "masks"]:
        if (data / name).exists() and not (part / name).exists():
            (part / name).symlink_to((data / name).resolve())
    known, own = {image[1] for image in train + judges}, {image[1] for image in train}
    kept = {}
    for index, line, track in points:
        pairs = [pair for pair in zip(track[::2], track[1::2]) if pair[0] in known]
        if not track or len({pair[0] for pair in pairs} & own) >= 2:
            kept[index] = " ".join([index, line, *(number for pair in pairs for number in pair)])

    def seen(marks):
        words = marks.split()
        words[2::3] = [point if point in kept else "-1" for point in words[2::3]]
        return " ".join(words)

    model = part / "sparse" / "0"
    (model / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (model / "images.txt").write_text("".join(f"{line}\n{seen(marks)}\n" for _, _, line, marks in train + judges))
    (model / "points3D.txt").write_text("\n".join(kept.values()) + "\n")
    (part / "test.txt").write_text("".join(image[0] + "\n" for image in judges))
    return part


def score(part, arm, program, options, seed):
    """Trains, bakes and scores one file."""
    scene, asset, report = (part / f"{arm}-{seed}{end}" for end in (".ply", ".glb", ".json"))
    if not report.exists():
        def run(*command):
            done = subprocess.run([program, "--quiet", "--threads", "1", *map(str, command)], capture_output=True, text=True)
            if done.returncode:
                sys.exit(f"{part.name}, {arm}: {done.stderr}")

        run("train", part, "-o", scene, "--force", "--budget", os.environ.get("BUDGET", "40s"), "--seed", seed, *options)
        run("bake", scene, "-o", asset, "--force", "--dataset", part)
        run("eval", asset, part, "--force", "--report", report)
    step = json.loads(report.read_text())["steps"][-1]
    print(part.name, arm, seed, *(f"{name} {figure(step):.3f}" for name, figure in MEASURES.items() if figure(step) is not None), flush=True)


def run(folder, arguments):
    """Makes what is missing of all arms."""
    at = arguments.index("--arm")
    arms = [arm.partition("=") for arm in arguments[at + 1::2]]
    found = [part for data in arguments[:at] for part in parts(folder, Path(data).resolve())]
    with ThreadPoolExecutor(int(os.environ.get("JOBS", "2"))) as pool:
        jobs = [pool.submit(score, part, name, *(lambda words: (words[0], words[1:]))(command.split()), seed)
                for seed in os.environ.get("SEEDS", "0 1").split() for part in found for name, _, command in arms]
        for job in jobs:
            job.result()


def scores(folder, names):
    """Means over the seeds of each part and arm: {part: {arm: {measure: value}}}."""
    found = {}
    for part in sorted(path for path in folder.iterdir() if path.is_dir()):
        for name in names:
            steps = [json.loads(path.read_text())["steps"][-1] for path in sorted(part.glob(f"{name}-[0-9].json"))]
            for measure, figure in MEASURES.items() if steps else []:
                values = [figure(step) for step in steps if figure(step) is not None]
                mean = sum(values) / len(values) if values else None
                found.setdefault(part.name, {}).setdefault(name, {})[measure] = mean
    return found


def mean(values):
    return sum(values) / len(values)


def table(folder, names):
    """Prints each part and arm, and the arms' differences from the first: mean and worst."""
    print("| part | arm |", " | ".join(MEASURES), "|")
    print("|---|---|" + "---|" * len(MEASURES))
    found = scores(folder, names)
    for part, arms in found.items():
        for name, row in arms.items():
            cells = ("" if value is None else f"{value:.2f}" if key == "dB" else f"{value:.3f}" for key, value in row.items())
            print(f"| {part} | {name} |", " | ".join(cells), "|")
    for name in names[1:]:
        for measure in MEASURES:
            both = [(arms[name][measure], arms[names[0]][measure]) for arms in found.values() if name in arms and names[0] in arms]
            values = [a - b for a, b in both if None not in (a, b)]
            if values:
                worst = (max if measure in ("behind", "unsupported", "empty") else min)(values)
                print(f"{name} - {names[0]}, {measure}: mean {mean(values):+.3f}, worst {worst:+.3f}, {len(values)} parts")


def leave_out(folder, names):
    """Prints what a choice among the arms gains over the first, in dB, on the capture that took no part in the choice."""
    captures = {}
    for part, arms in scores(folder, names).items():
        if len(arms) == len(names):
            captures.setdefault(part.rsplit("-", 1)[0], []).append([arms[name]["dB"] for name in names])
    if len(captures) < 2:
        sys.exit("a choice needs two captures with scores of every arm: make them with run")
    # Each capture counts once, however many parts it has.
    of_capture = {capture: [mean(values) for values in zip(*parts)] for capture, parts in captures.items()}
    gains = []
    for capture, values in of_capture.items():
        others = [mean(column) for column in zip(*(row for other, row in of_capture.items() if other != capture))]
        chosen = others.index(max(others))
        gains.append(values[chosen] - values[0])
        print(f"{capture}: the others choose {names[chosen]}, {gains[-1]:+.3f} dB here; best here {names[values.index(max(values))]}, {max(values) - values[0]:+.3f}")
    print(f"left out: mean {mean(gains):+.3f} dB, worst {min(gains):+.3f}, {len(gains)} captures")


if __name__ == "__main__":
    commands = {"run": run, "table": table, "leave-out": leave_out}
    if len(sys.argv) < 4 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    target = Path(sys.argv[2]).resolve()
    target.mkdir(parents=True, exist_ok=True)
    commands[sys.argv[1]](target, sys.argv[3:])
