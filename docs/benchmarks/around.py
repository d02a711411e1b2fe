"""Cameras on all sides of a thing, the PSNR of two folders of their pictures, and smaller pictures.

python3 around.py cameras OUT.json X Y Z DISTANCE [COUNT [TURN [SIDE]]]
python3 around.py psnr WANTED FOUND
python3 around.py average FROM TO BY
"""
import json, math, sys
from pathlib import Path
import numpy as np
from PIL import Image


def cameras(out, x, y, z, distance, count=12, turn=0.0, side=400):
    """COUNT cameras that look at X Y Z from DISTANCE, 45 degrees wide, TURN radians about x."""
    count, side, listed = int(count), int(side), []
    middle, distance, turn = np.array([float(x), float(y), float(z)]), float(distance), float(turn)
    for i in range(count):
        up = 1 - 2 * (i + 0.5) / count
        r, a = math.sqrt(1 - up * up), i * 2.399963
        d = np.array([r * math.cos(a), up, r * math.sin(a)])
        c, s = math.cos(turn), math.sin(turn)
        d = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ d
        right = np.cross(-d, [0.1, 1.0, 0.2])
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(-d, right), -d], 1)
        focal = side / 2 / math.tan(math.radians(22.5))
        listed.append({"img_name": f"{i:02}.png", "width": side, "height": side, "fx": focal, "fy": focal,
                       "position": list(middle + d * distance), "rotation": axes.tolist()})
    Path(out).write_text(json.dumps(listed))


def psnr(wanted, found):
    """The mean over the pictures of WANTED, and the least."""
    scores = []
    for path in sorted(Path(wanted).glob("*.png")):
        a, b = (np.asarray(Image.open(p).convert("RGB"), float) for p in (path, Path(found) / path.name))
        scores.append(10 * math.log10(255**2 / max(((a - b) ** 2).mean(), 1e-9)))
    print(f"{sum(scores) / len(scores):.2f} dB, least {min(scores):.2f}")


def average(source, target, by):
    """Pictures of SOURCE with a pixel for each square of BY x BY."""
    by = int(by)
    Path(target).mkdir(exist_ok=True)
    for path in Path(source).glob("*.png"):
        a = np.asarray(Image.open(path).convert("RGB"), float)
        a = a.reshape(a.shape[0] // by, by, -1, by, 3).mean((1, 3))
        Image.fromarray(a.round().astype(np.uint8)).save(Path(target) / path.name)


{"cameras": cameras, "psnr": psnr, "average": average}[sys.argv[1]](*sys.argv[2:])
