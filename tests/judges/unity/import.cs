// Imports PROGRAM'S bake of SCENE as Unity would, and writes DUMP as tests/judges/godot4/dump.gd does; lines of errors where it fails.
// Usage: import.exe PROGRAM SCENE DUMP [FLAGS]
using System;
using System.IO;
using System.Linq;
using UnityEditor;
using UnityEditor.AssetImporters;
using UnityEngine;

static class Import
{
    static void Main(string[] words)
    {
        if (words[0] == "--quoted")
        {
            var echo = new System.Diagnostics.ProcessStartInfo(words[1], string.Join(" ", words.Skip(2).Select(Trisplat.TrisplatImporter.Quoted)));
            echo.UseShellExecute = false;
            using (var program = System.Diagnostics.Process.Start(echo)) program.WaitForExit();
            return;
        }
        EditorPrefs.SetString("trisplat.program", words[0]);
        var importer = new Trisplat.TrisplatImporter { backdrop = words.Length == 3, settings = words.Skip(3).ToArray() };
        var context = new AssetImportContext(words[1]);
        importer.OnImportAsset(context);
        foreach (var error in context.errors) Console.WriteLine("error " + error);
        if (!(context.mainObject is GameObject root)) return;
        using (var dump = new BinaryWriter(File.Create(words[2])))
        {
            foreach (var node in root.transform.children.Select(child => child.gameObject)) Dump(node, context, dump);
        }
    }

    static void Dump(GameObject node, AssetImportContext context, BinaryWriter dump)
    {
        var body = node.GetComponent<MeshCollider>();
        if (body != null)
        {
            Console.WriteLine($"body {node.name} {body.sharedMesh.triangles.Length / 3}");
            return;
        }
        var mesh = node.GetComponent<MeshFilter>().sharedMesh;
        var material = node.GetComponent<MeshRenderer>().sharedMaterial;
        var kept = context.objects.Contains(mesh) && context.objects.Contains(material) && material.shader.name.EndsWith(".shader");
        var both = !material.floats.ContainsKey("_Cull");
        Console.WriteLine($"node {node.name} {mesh.vertices.Length} {mesh.colors32.Length} {kept && both}");
        for (var face = 0; face < mesh.triangles.Length; face += 3)
        {
            foreach (var corner in new[] { 0, 2, 1 })
            {
                var i = mesh.triangles[face + corner];
                var (place, code) = (mesh.vertices[i], mesh.colors32[i]);
                foreach (var value in new[] { -place.x, place.y, place.z }) dump.Write(value);
                foreach (var value in new[] { code.r, code.g, code.b }) dump.Write(value);
            }
        }
    }
}
