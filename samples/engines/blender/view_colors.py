"""View-dependent colours of trisplat's GLB files in Blender 4.2 and later: docs/formats.md says how they are stored.

    blender --python view_colors.py -- scene.glb      imports a file; or call load("scene.glb") from a script

Their sum is a group of nodes between the colours of the file and what draws them. Blender takes the direction of every
pixel, where the file means that of every corner: the difference is below what a picture of 8 bits shows.
"""

import json
import struct
import sys

import bpy

GROUP = "trisplat view-dependent colours"
# Harmonics of degree 1 to 3 as sums of a number times powers of x, y and z.
BASIS = [
    [(-0.48860251, 0, 1, 0)], [(0.48860251, 0, 0, 1)], [(-0.48860251, 1, 0, 0)],
    [(1.09254843, 1, 1, 0)], [(-1.09254843, 0, 1, 1)],
    [(0.63078313, 0, 0, 2), (-0.31539157, 2, 0, 0), (-0.31539157, 0, 2, 0)],
    [(-1.09254843, 1, 0, 1)], [(0.54627422, 2, 0, 0), (-0.54627422, 0, 2, 0)],
    [(-1.77013077, 2, 1, 0), (0.59004359, 0, 3, 0)], [(2.89061144, 1, 1, 1)],
    [(-1.82818320, 0, 1, 2), (0.45704580, 2, 1, 0), (0.45704580, 0, 3, 0)],
    [(0.74635266, 0, 0, 3), (-1.11952998, 2, 0, 1), (-1.11952998, 0, 2, 1)],
    [(-1.82818320, 1, 0, 2), (0.45704580, 3, 0, 0), (0.45704580, 1, 2, 0)],
    [(1.44530572, 2, 0, 1), (-1.44530572, 0, 2, 1)], [(-0.59004359, 3, 0, 0), (1.77013077, 1, 2, 0)],
]


class Nodes:
    """Makes nodes that compute; numbers and sockets are their inputs."""

    def __init__(self, tree):
        self.tree = tree

    def node(self, kind, inputs=(), **settings):
        made = self.tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(made, name, value)
        for socket, value in zip(made.inputs, inputs):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return made

    def math(self, operation, *inputs, clamp=False):
        return self.node("ShaderNodeMath", inputs, operation=operation, use_clamp=clamp).outputs[0]

    def vector(self, operation, *inputs):
        return self.node("ShaderNodeVectorMath", inputs, operation=operation).outputs[0]

    def choose(self, value, limit, below, above):
        """`below` where `value` is at most `limit`, else `above`."""
        is_above = self.math("GREATER_THAN", value, limit)
        return self.math("ADD", below, self.math("MULTIPLY", is_above, self.math("SUBTRACT", above, below)))

    def encoded(self, c):
        curve = self.math("MULTIPLY_ADD", self.math("POWER", c, 1 / 2.4), 1.055, -0.055)
        return self.choose(c, 0.0031308, self.math("MULTIPLY", c, 12.92), curve)

    def decoded(self, c):
        curve = self.math("POWER", self.math("MULTIPLY_ADD", c, 1 / 1.055, 0.055 / 1.055), 2.4)
        return self.choose(c, 0.04045, self.math("MULTIPLY", c, 1 / 12.92), curve)

    def channels(self, color, change):
        parts = self.node("ShaderNodeSeparateColor", [color]).outputs
        return self.node("ShaderNodeCombineColor", [change(part) for part in parts]).outputs[0]


def group(image, degree, scale):
    """A group that adds to a colour what the direction does."""
    tree = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    tree.interface.new_socket("Color", in_out="INPUT", socket_type="NodeSocketColor")
    tree.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    nodes = Nodes(tree)
    color = nodes.node("NodeGroupInput").outputs[0]
    # From the camera to the surface, in the frame of the file, which is Y-up.
    incoming = nodes.node("ShaderNodeNewGeometry").outputs["Incoming"]
    turned = nodes.node("ShaderNodeVectorTransform", [incoming], vector_type="VECTOR", convert_from="WORLD", convert_to="OBJECT")
    away = nodes.vector("NORMALIZE", turned.outputs[0])
    bx, by, bz = nodes.node("ShaderNodeSeparateXYZ", [away]).outputs
    axes = [nodes.math("MULTIPLY", bx, -1.0), nodes.math("MULTIPLY", bz, -1.0), by]
    place = nodes.node("ShaderNodeUVMap", uv_map="UVMap").outputs[0]
    total = nodes.channels(color, nodes.encoded)
    for j in range((degree + 1) ** 2):
        weight = 0.28209479
        if j > 0:
            terms = []
            for number, *powers in BASIS[j - 1]:
                for axis, power in zip(axes, powers):
                    for _ in range(power):
                        number = nodes.math("MULTIPLY", number, axis)
                terms.append(number)
            weight = terms[0]
            for term in terms[1:]:
                weight = nodes.math("ADD", weight, term)
        texel = nodes.node("ShaderNodeTexImage", image=image, interpolation="Closest", extension="EXTEND")
        tree.links.new(nodes.vector("ADD", place, (j / image.size[0], 0, 0)), texel.inputs[0])
        # A code stands for (code - 128) / 127 of the scale of its degree.
        of_degree = scale[int(j**0.5)]
        coefficient = nodes.vector("MULTIPLY_ADD", texel.outputs[0], (255 / 127 * of_degree,) * 3, (-128 / 127 * of_degree,) * 3)
        weighted = nodes.node("ShaderNodeVectorMath", [coefficient], operation="SCALE")
        if j == 0:
            weighted.inputs["Scale"].default_value = weight
        else:
            tree.links.new(weight, weighted.inputs["Scale"])
        total = nodes.vector("ADD", total, weighted.outputs[0])
    bounded = nodes.vector("MINIMUM", nodes.vector("MAXIMUM", total, (0, 0, 0)), (1, 1, 1))
    nodes.node("NodeGroupOutput", [nodes.channels(bounded, nodes.decoded)])
    return tree


def load(path):
    """Imports a GLB and gives its materials their view-dependent colours."""
    with open(path, "rb") as file:
        data = file.read()
    length = struct.unpack_from("<I", data, 12)[0]
    gltf, binary = json.loads(data[20:20 + length]), data[28 + length:]
    before = set(bpy.data.materials)
    bpy.ops.import_scene.gltf(filepath=str(path))
    for stored in gltf.get("materials", []):
        sh = stored.get("extras", {}).get("trisplat_sh")
        made = [m for m in bpy.data.materials if m not in before and m.name.split(".")[0] == stored.get("name")]
        if not sh or not made or "occlusionTexture" not in stored:
            continue
        source = gltf["textures"][stored["occlusionTexture"]["index"]]["source"]
        view = gltf["bufferViews"][gltf["images"][source]["bufferView"]]
        png = binary[view.get("byteOffset", 0):view.get("byteOffset", 0) + view["byteLength"]]
        image = bpy.data.images.new("trisplat harmonics", 1, 1)
        image.source = "FILE"
        image.pack(data=png, data_len=len(png))
        image.colorspace_settings.name = "Non-Color"
        add(made[0], group(image, sh["degree"], sh["scale"]))


def add(material, tree):
    """Puts a group between the vertex colours of a material and what they lead to."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    colors = next(node for node in nodes if node.type in ("VERTEX_COLOR", "ATTRIBUTE"))
    leads_to = [link.to_socket for link in links if link.from_socket == colors.outputs["Color"]]
    between = nodes.new("ShaderNodeGroup")
    between.node_tree = tree
    links.new(colors.outputs["Color"], between.inputs[0])
    for socket in leads_to:
        links.new(between.outputs[0], socket)


if __name__ == "__main__" and "--" in sys.argv:
    load(sys.argv[sys.argv.index("--") + 1])
