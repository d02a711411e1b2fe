// The meshes of a GLB as `trisplat bake --target godot` writes it: no node moves a mesh, and colours are sRGB codes in four bytes.
using System;
using System.Collections.Generic;
using System.Linq;
using System.Text;
using UnityEngine;
using UnityEngine.Rendering;

namespace Trisplat
{
    class Glb
    {
        // The parts of its JSON; 0 stands for what is not there, as accessor 0 holds positions.
        [Serializable]
        public class Document { public Entry[] meshes; public Surface[] materials; public Accessor[] accessors; public View[] bufferViews; }
        [Serializable] public class Entry { public string name; public Primitive[] primitives; }
        [Serializable] public class Primitive { public Attributes attributes; public int indices; public int material; }
        [Serializable] public class Surface { public bool doubleSided; }
        [Serializable] public class Attributes { public int POSITION; public int COLOR_0; public int TEXCOORD_0; }
        [Serializable] public class Accessor { public int bufferView; public int byteOffset; public int count; public int componentType; }
        [Serializable] public class View { public int byteOffset; }

        const int Short = 5123;

        readonly byte[] file;
        readonly int data;
        readonly Document document;

        Glb(byte[] file)
        {
            // A header of 12 bytes, then JSON and data, each after its length and its type.
            var length = BitConverter.ToInt32(file, 12);
            this.file = file;
            data = 20 + length + 8;
            document = JsonUtility.FromJson<Document>(Encoding.UTF8.GetString(file, 20, length));
        }

        // Each with whether it is seen from both sides.
        public static List<(Mesh mesh, bool bothSides)> Read(byte[] file)
        {
            var glb = new Glb(file);
            var document = glb.document;
            return document.meshes.Select(entry => entry.primitives[0])
                .Zip(document.meshes, (primitive, entry) => (glb.Read(entry.name, primitive), document.materials[primitive.material].doubleSided)).ToList();
        }

        Mesh Read(string name, Primitive primitive)
        {
            if (primitive.attributes.TEXCOORD_0 != 0)
            {
                throw new InvalidOperationException("it has a texture, which needs a GLB: trisplat bake --target unity, and glTFast");
            }
            var places = Values<float>(primitive.attributes.POSITION, 3, 4);
            var vertices = Enumerable.Range(0, places.Length / 3);
            var corners = primitive.indices == 0 ? vertices.ToArray() : Indices(primitive.indices);
            // Unity's x points the other way, so triangles turn round.
            for (var i = 0; i < corners.Length; i += 3) Array.Reverse(corners, i + 1, 2);
            var mesh = new Mesh { name = name, indexFormat = IndexFormat.UInt32 };
            mesh.vertices = vertices.Select(i => new Vector3(-places[3 * i], places[3 * i + 1], places[3 * i + 2])).ToArray();
            if (primitive.attributes.COLOR_0 != 0)
            {
                var codes = Values<byte>(primitive.attributes.COLOR_0, 4, 1);
                mesh.colors32 = vertices.Select(i => new Color32(codes[4 * i], codes[4 * i + 1], codes[4 * i + 2], 255)).ToArray();
            }
            mesh.triangles = corners;
            return mesh;
        }

        int[] Indices(int index) => document.accessors[index].componentType == Short
            ? Array.ConvertAll(Values<ushort>(index, 1, 2), i => (int)i) : Values<int>(index, 1, 4);

        T[] Values<T>(int index, int components, int bytes)
        {
            var accessor = document.accessors[index];
            var values = new T[accessor.count * components];
            var start = data + document.bufferViews[accessor.bufferView].byteOffset + accessor.byteOffset;
            Buffer.BlockCopy(file, start, values, 0, values.Length * bytes);
            return values;
        }
    }
}
