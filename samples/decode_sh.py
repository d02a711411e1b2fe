#!/usr/bin/env python3
"""Prints the colours of some corners of a GLB with view-dependent colours, as docs/formats.md defines them.

    python3 samples/decode_sh.py scene.glb EYE_X EYE_Y EYE_Z     needs Pillow; for files without compression or quantisation

One line per corner: its number in the primitive, then red, green and blue, sRGB-encoded.
"""

import io
import json
import math
import struct
import sys

from PIL import Image

data, eye = open(sys.argv[1], "rb").read(), [float(x) for x in sys.argv[2:5]]
length = struct.unpack_from("<I", data, 12)[0]
gltf, binary = json.loads(data[20:20 + length]), data[28 + length:]


def rows(accessor):
    """The numbers of an accessor, normalised."""
    accessor = gltf["accessors"][accessor]
    start = gltf["bufferViews"][accessor["bufferView"]].get("byteOffset", 0)
    width = {"VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    letter, most = {5126: ("f", 1), 5123: ("H", 65535)}[accessor["componentType"]]
    values = struct.unpack_from(f"<{width * accessor['count']}{letter}", binary, start)
    return [[x / most for x in values[i:i + width]] for i in range(0, len(values), width)]


def basis(x, y, z):
    """The harmonics of degree 0 to 3 in a unit direction."""
    xx, yy, zz = x * x, y * y, z * z
    return [0.28209479, -0.48860251 * y, 0.48860251 * z, -0.48860251 * x, 1.09254843 * x * y, -1.09254843 * y * z,
            0.31539157 * (2 * zz - xx - yy), -1.09254843 * x * z, 0.54627422 * (xx - yy),
            -0.59004359 * y * (3 * xx - yy), 2.89061144 * x * y * z, -0.45704580 * y * (4 * zz - xx - yy),
            0.37317633 * z * (2 * zz - 3 * xx - 3 * yy), -0.45704580 * x * (4 * zz - xx - yy), 1.44530572 * z * (xx - yy),
            -0.59004359 * x * (xx - 3 * yy)]


primitive = gltf["meshes"][0]["primitives"][0]
material = gltf["materials"][primitive["material"]]
sh = material["extras"]["trisplat_sh"]
view = gltf["bufferViews"][gltf["images"][gltf["textures"][material["occlusionTexture"]["index"]]["source"]]["bufferView"]]
picture = Image.open(io.BytesIO(binary[view["byteOffset"]:view["byteOffset"] + view["byteLength"]])).convert("RGB")
attributes = [rows(primitive["attributes"][name]) for name in ("POSITION", "COLOR_0", "TEXCOORD_0")]
for corner, (position, color, (u, v)) in enumerate(zip(*attributes)):
    away = [p - e for p, e in zip(position, eye)]
    harmonics = basis(*(x / math.hypot(*away) for x in away))
    left, row = int(u * picture.width), int(v * picture.height)
    encoded = [12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055 for c in color[:3]]
    for j in range((sh["degree"] + 1) ** 2):
        texel = picture.getpixel((left + j, row))
        for c in range(3):
            encoded[c] += harmonics[j] * (texel[c] - 128) / 127 * sh["scale"][math.isqrt(j)]
    print(corner, *(f"{min(max(c, 0), 1):.6f}" for c in encoded))
