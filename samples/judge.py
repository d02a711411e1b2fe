"""Shared by check_trimesh.py and check_open3d.py: the source, read without trisplat, and the comparison.

A triangle set is two arrays: corners [N, 3, 3] and rgb [N, 3, 3], one sRGB-encoded colour in [0, 1] per corner.
"""

import argparse
import io
import json
import pickle
import struct
import sys
import zipfile
from pathlib import Path

import numpy as np

SH_C0 = 0.28209479177387814
COLOR_STEP = 1.0 / 255.0
# Signed rows of the rotation that takes an axis to +y: the row of y' picks that axis.
UP = {
    "x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    "y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
}


class Failed(Exception):
    """The baked file does not show what the source holds."""


# --- the source -----------------------------------------------------------------------------------------

PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


def read_ply(data):
    """Elements of a binary little-endian PLY whose lists all hold three entries."""
    head, body = data.split(b"end_header\n", 1)
    elements, lines = [], head.decode().split("\n")
    if "format binary_little_endian 1.0" not in lines:
        raise Failed("the source is not a binary little-endian PLY")
    for word in (line.split() for line in lines):
        if word[:1] == ["element"]:
            elements.append((word[1], int(word[2]), []))
        elif word[:2] == ["property", "list"]:
            elements[-1][2].append((f"count of {word[4]}", PLY_TYPES[word[2]]))
            elements[-1][2].append((word[4], "<" + PLY_TYPES[word[3]], 3))
        elif word[:1] == ["property"]:
            elements[-1][2].append((word[2], "<" + PLY_TYPES[word[1]]))
    found, at = {}, 0
    for name, count, properties in elements:
        found[name] = np.frombuffer(body, np.dtype(properties), count, at)
        at += found[name].nbytes
    return found


def ply_triangles(data):
    """A soup PLY (f_dc_* per face), or a mesh PLY with red, green and blue per vertex or per face."""
    found = read_ply(data)
    vertex, face = found["vertex"], found["face"]
    indices = face["vertex_indices"]
    corners = np.stack([vertex[axis] for axis in "xyz"], -1)[indices]
    if "f_dc_0" in face.dtype.names:
        rgb = 0.5 + SH_C0 * np.stack([face[f"f_dc_{c}"] for c in range(3)], -1).astype(float)
        return corners, np.repeat(rgb[:, None], 3, 1)
    owner = face if "red" in face.dtype.names else vertex
    rgb = np.stack([owner[c] for c in ("red", "green", "blue")], -1) / 255.0
    return corners, np.repeat(rgb[:, None], 3, 1) if owner is face else rgb[indices]


def off_triangles(data):
    """A COFF file with one colour per face, as the authors' exporter writes it."""
    magic, counts, *rest = data.decode().split("\n", 2)
    vertices, faces = (int(n) for n in counts.split()[:2])
    numbers = np.array(rest[0].split(), float)
    positions = numbers[: 3 * vertices].reshape(-1, 3).astype(np.float32)
    rows = numbers[3 * vertices :].reshape(faces, 8)
    return positions[rows[:, 1:4].astype(int)], np.repeat(rows[:, None, 4:7] / 255.0, 3, 1)


def checkpoint_triangles(data):
    """A training checkpoint (torch.save), read without torch: tensors are views of raw storages."""
    archive = zipfile.ZipFile(io.BytesIO(data))
    root = archive.namelist()[0].split("/")[0]

    class Reader(pickle.Unpickler):
        def persistent_load(self, key):
            return np.frombuffer(archive.read(f"{root}/data/{key[2]}"), np.float32)

        def find_class(self, module, name):
            known = {
                "_rebuild_tensor_v2": lambda data, start, shape, *_: data[start : start + np.prod(shape)].reshape(shape),
                "_rebuild_parameter": lambda tensor, *_: tensor,
                "FloatStorage": np.float32,
                "OrderedDict": dict,
            }
            return known[name]

    state = Reader(io.BytesIO(archive.read(f"{root}/data.pkl"))).load()
    rgb = 0.5 + SH_C0 * state["features_dc"].reshape(-1, 3).astype(float)
    return state["triangles_points"], np.repeat(rgb[:, None], 3, 1)


def source_triangles(path):
    read = {".ply": ply_triangles, ".off": off_triangles, ".pt": checkpoint_triangles}[path.suffix]
    corners, rgb = read(path.read_bytes())
    return np.asarray(corners, np.float32), rgb.clip(0, 1)


# --- the baked file -------------------------------------------------------------------------------------


def provenance(path):
    """Provenance of a baked file: `asset.extras` of glTF, the trisplat comment of PLY and OBJ."""
    data = path.read_bytes()
    if path.suffix in (".glb", ".gltf"):
        text = data[20 : 20 + struct.unpack_from("<I", data, 12)[0]] if path.suffix == ".glb" else data
        return json.loads(text)["asset"]["extras"]
    for line in data[:65536].split(b"\n"):
        sign, _, text = line.partition(b"trisplat {")
        if sign.strip() in (b"#", b"comment") and text:
            return json.loads(b"{" + text)
    raise Failed("no trisplat comment")


def srgb_from_linear(linear):
    c = np.clip(linear, 0, 1)
    return np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)


def place(corners, placement):
    """Source world to file: file = turn(rotate) * up_to_y * (scale * (world - center)), rounded once."""
    world = corners.astype(float) - np.array(placement["center"])
    angle = np.radians(placement.get("rotate", 0.0))
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]) if angle else np.eye(3)
    rotation = turn @ up_to_y(placement["up"])
    return (placement["scale"] * world @ rotation.T).astype(np.float32)


def up_to_y(up):
    """The rotation that takes an axis, or any direction by way of the nearest axis, to +y."""
    if isinstance(up, str):
        return np.array(UP[up], float)
    up = np.array(up) / np.linalg.norm(up)
    nearest = np.zeros(3)
    nearest[np.argmax(np.abs(up))] = np.sign(up[np.argmax(np.abs(up))])
    name = ("-" if nearest.min() < 0 else "") + "xyz"[np.argmax(np.abs(nearest))]
    axis, cosine = np.cross(up, nearest), up @ nearest
    across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.array(UP[name], float) @ (np.eye(3) + across + across @ across / (1 + cosine))


# --- the comparison -------------------------------------------------------------------------------------


def compare_exact(wants, got):
    """As many triangles and the same, bit for bit, in any order and from any first corner; colours within
    one step."""
    (corners, rgb), (found, found_rgb) = sorted_triangles(*wants), sorted_triangles(*got)
    wrong = np.flatnonzero((corners != found).any((1, 2)))
    if len(wrong):
        raise Failed(f"corners differ, of {len(wrong)} triangles: {found[wrong[0]].tolist()}")
    check_colors(rgb, found_rgb)


def sorted_triangles(corners, rgb):
    corners = np.asarray(corners, np.float32) + np.float32(0)  # -0 becomes 0
    first = np.lexsort(corners.transpose(2, 0, 1)[::-1])[:, :1]
    rotated = (first + np.arange(3)) % 3
    corners = np.take_along_axis(corners, rotated[..., None], 1)
    rgb = np.take_along_axis(rgb, rotated[..., None], 1)
    keys = np.concatenate([corners.reshape(-1, 9), np.round(rgb.reshape(-1, 9), 2)], 1)
    order = np.lexsort(keys.T[::-1])
    return corners[order], rgb[order]


def compare_matched(wants, got, shrunk):
    """Every triangle is one of the source, each used once: to 2^-19 of its coordinates as large, or, when
    `shrunk` is allowed, smaller about the same incenter. Says nothing of triangles that are missing."""
    corners, rgb = wants
    found, found_rgb = np.asarray(got[0], float), got[1]
    center, around = incenters(corners.astype(float))
    middle, within = incenters(found)
    slack = 2.0**-19 * np.abs(found).max((1, 2))

    along = np.array([0.5257, 0.2764, 0.8045])  # any direction: candidates are near each other on it
    order = np.argsort(center @ along)
    line = (center @ along)[order]
    low = np.searchsorted(line, middle @ along - slack)
    high = np.searchsorted(line, middle @ along + slack, "right")
    match = np.full(len(found), -1)
    for step in range((high - low).max(initial=0)):
        rows = np.flatnonzero((low + step < high) & (match < 0))
        pick = order[low[rows] + step]
        scale = np.ones(len(rows))
        if shrunk:
            scale = (within[rows] * around[pick]).sum((1, 2)) / (around[pick] ** 2).sum((1, 2)).clip(1e-300)
        shape = np.abs(within[rows] - scale[:, None, None] * around[pick]).max((1, 2))
        fits = (np.abs(center[pick] - middle[rows]).max(1) <= slack[rows]) & (shape <= 2 * slack[rows])
        fits &= (scale > 0) & (scale < 1 + 1e-3)
        fits &= np.abs(rgb[pick] - found_rgb[rows]).max((1, 2)) <= 1.01 * COLOR_STEP
        match[rows[fits]] = pick[fits]
    lost = np.flatnonzero(match < 0)
    if len(lost):
        raise Failed(f"{len(lost)} triangles that the source does not have: {found[lost[0]].tolist()}")
    twins = len(corners) - len(np.unique(corners.reshape(-1, 9), axis=0))
    if len(np.unique(match)) < len(match) - twins:
        raise Failed("one triangle of the source was written more than once")


def incenters(corners):
    """Incenters [N, 3] and the corners relative to them [N, 3, 3]."""
    opposite = np.linalg.norm(np.roll(corners, -1, 1) - np.roll(corners, 1, 1), axis=2)
    weight = opposite / opposite.sum(1, keepdims=True).clip(1e-300)
    center = (weight[..., None] * corners).sum(1)
    return center, corners - center[:, None]


def check_colors(wants, got):
    off = np.abs(wants - got).max((1, 2), initial=0)
    if (off > 1.01 * COLOR_STEP).any():
        worst = off.argmax()
        corner = np.abs(wants - got)[worst].max(1).argmax()
        colors = [np.round(255 * c[worst, corner], 2).tolist() for c in (wants, got)]
        raise Failed(f"colour {colors[1]} of 255, the source has {colors[0]}")


def judge(name, load, inexact=()):
    """Runs a judge over the command line; `load(path)` gives corners and the stored colours of a file. Of
    files ending in `inexact` the judge does not read coordinates to the last bit."""
    parser = argparse.ArgumentParser(description=f"Compares baked files, loaded by {name}, with their source.")
    parser.add_argument("source", type=Path, help="soup or mesh .ply, .off or .pt")
    parser.add_argument("baked", type=Path, nargs="+", help=".glb, .gltf, .obj or .ply made from it")
    parser.add_argument("--expect-shrunk", action="store_true", help="triangles may be smaller and fewer")
    parser.add_argument("--triangles", type=int, help="triangles that every file must have")
    parser.add_argument("--up", choices=UP, help="axis of the source that must have become +y")
    parser.add_argument("--scale", type=float, help="scale that must have been used")
    parser.add_argument("--damaged", action="store_true", help="every file must fail, not pass")
    args = parser.parse_args()
    source = source_triangles(args.source)
    all_well = True
    for path in args.baked:
        try:
            check(path, source, load, inexact, args)
            well, verdict = not args.damaged, "as the source"
        except Failed as reason:
            well, verdict = args.damaged, str(reason)
        except Exception as crash:  # of a loader: never what was expected
            well, verdict = False, repr(crash)
        all_well &= well
        print(f"{name}: {path.name}: {verdict}", file=sys.stdout if well else sys.stderr)
    sys.exit(0 if all_well else 1)


def check(path, source, load, inexact, args):
    said = provenance(path)
    placement = said["placement"]
    for key, wants in (("up", args.up), ("scale", args.scale)):
        if wants is not None and placement[key] != wants:
            raise Failed(f"placement says {key} {placement[key]}, not {wants}")
    corners, rgb = load(path)
    if said.get("color_encoding", "srgb").endswith("-linear"):
        rgb = srgb_from_linear(rgb)
    if args.triangles is not None and len(corners) != args.triangles:
        raise Failed(f"{len(corners)} triangles, not {args.triangles}")
    wants = place(source[0], placement), source[1]
    if not args.expect_shrunk and len(corners) != len(source[0]):
        raise Failed(f"{len(corners)} triangles, the source has {len(source[0])}")
    if args.expect_shrunk or path.suffix in inexact:
        compare_matched(wants, (corners, rgb), args.expect_shrunk)
    else:
        compare_exact(wants, (corners, rgb))
