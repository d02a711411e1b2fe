"""Writes reference.json: PSNR and SSIM by scikit-image and FLIP by NVIDIA's flip-evaluator. Neither shares code with trisplat.

Usage: python -m venv venv && venv/bin/pip install scikit-image flip-evaluator && venv/bin/python crates/scene/tests/metric/reference.py

The renders are of samples/soups/trained.ply, drawn by `trisplat render` at the held-out cameras of samples/dataset; small_*.png are cut from them.
"""

import json
import pathlib
from importlib.metadata import version

import flip_evaluator
import numpy as np
from skimage.io import imread
from skimage.metrics import mean_squared_error, peak_signal_noise_ratio, structural_similarity

here = pathlib.Path(__file__).parent
photos = here.parents[1] / "samples/dataset/images"
PAIRS = [
    ("view_0000.png", "view_0000.soft.png"),
    ("view_0016.png", "view_0016.solid.png"),
    ("view_0000.png", "view_0008.png"),
    ("small_a.png", "small_b.png"),
]
# Eleven taps of a Gaussian of deviation 1.5 px.
WINDOW = dict(gaussian_weights=True, sigma=1.5, truncate=3.5, use_sample_covariance=False, data_range=1.0)
BORDER = 16


def load(name):
    path = here / name
    return imread(path if path.exists() else photos / name)[..., :3].astype(np.float64) / 255


def ssim(a, b):
    # Zeros outside the picture, as 3DGS has it: scikit-image mirrors at the border, so the border is moved away.
    a, b = (np.pad(picture, ((BORDER, BORDER), (BORDER, BORDER), (0, 0))) for picture in (a, b))
    full = structural_similarity(a, b, channel_axis=2, full=True, **WINDOW)[1]
    return full[BORDER:-BORDER, BORDER:-BORDER].mean()


def compare(reference, test):
    a, b = load(reference), load(test)
    flip = flip_evaluator.evaluate(a.astype(np.float32), b.astype(np.float32), "LDR", applyMagma=False)[1]
    return {
        "reference": reference,
        "test": test,
        "mse": float(mean_squared_error(a, b)),
        "psnr": float(peak_signal_noise_ratio(a, b, data_range=1.0)),
        "ssim": float(ssim(a, b)),
        "flip": float(flip),
    }


packages = {name: version(name) for name in ("scikit-image", "flip-evaluator", "numpy")}
values = {"made_with": packages, "pairs": [compare(*pair) for pair in PAIRS]}
(here / "reference.json").write_text(json.dumps(values, indent=1) + "\n")
