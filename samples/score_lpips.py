#!/usr/bin/env python3
"""LPIPS of drawings against photos: the figure that papers state beside PSNR and SSIM.

    pip install lpips pillow
    trisplat eval scene.glb photos --save-renders drawings
    python samples/score_lpips.py drawings photos/images [--json scores.json]

Pairs pictures by name without ending, below both folders; a photo is shrunk to its drawing. VGG16 by default, on colours
in [0, 1] as the code of 3D Gaussian and triangle splatting feeds it; `--normalize` feeds [-1, 1], as LPIPS was trained, and
gives other figures. PyTorch downloads the weights of VGG16 (530 MB) the first time; the rest comes with the package.
Prints one line per picture and the mean; exit code 1 where a drawing has no photo.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

PICTURES = {".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff"}


def pictures(folder):
    """The pictures below a folder, by their path without ending."""
    files = [path for path in folder.rglob("*") if path.suffix.lower() in PICTURES]
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in files}


def load(path, size=None):
    """Colours in [0, 1], [1, 3, height, width], at `size` (width, height) if given."""
    import torch

    picture = Image.open(path).convert("RGB")
    if size and picture.size != size:
        picture = picture.resize(size, Image.Resampling.BOX)
    return torch.from_numpy(np.asarray(picture, np.float32) / 255).permute(2, 0, 1)[None]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("drawings", type=Path, help="folder that `trisplat eval --save-renders` wrote")
    parser.add_argument("photos", type=Path, help="folder of the photos")
    parser.add_argument("--net", choices=["vgg", "alex", "squeeze"], default="vgg")
    parser.add_argument("--normalize", action="store_true", help="feed colours in [-1, 1]")
    parser.add_argument("--json", type=Path, help="file to write the scores to")
    args = parser.parse_args()
    drawings, photos = pictures(args.drawings), pictures(args.photos)
    missing = sorted(set(drawings) - set(photos))
    if missing or not drawings:
        what = f"{args.photos} has no photo `{missing[0]}`" if missing else f"{args.drawings} holds no pictures"
        sys.exit(f"score_lpips.py: {what}")

    import warnings

    import lpips
    import torch

    # The package calls torchvision in a way that is out of date.
    warnings.filterwarnings("ignore", module="torchvision")
    measure = lpips.LPIPS(net=args.net, verbose=False)
    scores = {}
    with torch.no_grad():
        for name, path in sorted(drawings.items()):
            drawing = load(path)
            photo = load(photos[name], size=(drawing.shape[3], drawing.shape[2]))
            scores[name] = measure(drawing, photo, normalize=args.normalize).item()
            print(f"{scores[name]:.4f}  {name}")
    mean = sum(scores.values()) / len(scores)
    print(f"{mean:.4f}  mean of {len(scores)}")
    if args.json:
        args.json.write_text(json.dumps({"mean": {"lpips": mean}, "images": scores}, indent=1) + "\n")


if __name__ == "__main__":
    main()
