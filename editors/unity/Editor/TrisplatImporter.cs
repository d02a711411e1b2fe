// A trained scene or Gaussian splats in Assets become a model: `trisplat bake` makes a GLB, and this makes meshes of it.
using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Linq;
using System.Text.RegularExpressions;
using UnityEditor;
using UnityEditor.AssetImporters;
using UnityEngine;

namespace Trisplat
{
    [ScriptedImporter(1, new[] { "ply", "pt", "splat", "spz", "sog" })]
    public class TrisplatImporter : ScriptedImporter
    {
        public enum Quality { Default, Fast, Small }

        const string ShaderPath = "Packages/com.trisplat.importer/Shaders/VertexColors.shader";

        public Quality quality;
        [Tooltip("Train a soft scene opaque first: minutes, and much closer to it.")]
        public bool harden;
        [Tooltip("0: all that the scene needs.")]
        public int maxTriangles;
        [Tooltip("A surface of few triangles with a mesh collider, which is not drawn.")]
        public bool collision = true;
        [Tooltip("Surroundings far behind the scene.")]
        public bool backdrop = true;
        [Tooltip("Metres to one unit of the scene.")]
        public float scale = 1;
        [Tooltip("Other options of `trisplat bake`, as `trisplat schema bake` lists them: chunk_triangles=3000.")]
        public string[] settings = { };

        public override void OnImportAsset(AssetImportContext context)
        {
            var folder = Path.Combine(Path.GetTempPath(), Path.GetRandomFileName());
            Directory.CreateDirectory(folder);
            try
            {
                var glb = Path.Combine(folder, "scene.glb");
                Bake(Path.GetFullPath(context.assetPath), glb);
                Fill(context, Glb.Read(File.ReadAllBytes(glb)));
            }
            catch (Exception error) when (error is IOException || error is InvalidOperationException)
            {
                context.LogImportError($"trisplat cannot bake {context.assetPath}: {error.Message}");
            }
            finally
            {
                Directory.Delete(folder, true);
            }
        }

        // The target is Godot's because its one file has what a model of Unity needs: colours in four bytes, and the collision surface.
        IEnumerable<string> Flags()
        {
            var flags = new List<string> { "--quiet", "--target", "godot", "--preset", quality.ToString().ToLowerInvariant() };
            flags.AddRange(new[] { "--set", FormattableString.Invariant($"place.scale={scale}") });
            if (harden) flags.Add("--harden");
            if (maxTriangles > 0) flags.AddRange(new[] { "--max-triangles", maxTriangles.ToString() });
            if (collision) flags.Add("--collision");
            if (!backdrop) flags.AddRange(new[] { "--backdrop", "off" });
            // One word each: none can be another flag.
            return flags.Concat(settings.Select(setting => "--set=" + setting));
        }

        // A word of a command line. Windows takes backslashes as they are, except before a quote; Mono elsewhere takes each for an escape.
        public static string Quoted(string word)
        {
            var escaped = Path.DirectorySeparatorChar == '\\'
                ? Regex.Replace(word, @"(\\*)(""|\z)", match => match.Groups[1].Value + match.Value.Replace("\"", "\\\""))
                : Regex.Replace(word, @"[\\""$`]", @"\$&");
            return '"' + escaped + '"';
        }

        void Bake(string scene, string glb)
        {
            var words = new[] { "bake", scene, "--output", glb }.Concat(Flags());
            const string lost = "the program was not found: Preferences > Trisplat > Program";
            var path = TrisplatPreferences.Find() ?? throw new InvalidOperationException(lost);
            var start = new ProcessStartInfo(path, string.Join(" ", words.Select(Quoted)))
            {
                UseShellExecute = false, CreateNoWindow = true, RedirectStandardError = true,
            };
            try
            {
                using (var program = Process.Start(start))
                {
                    var said = program.StandardError.ReadToEnd().Trim();
                    program.WaitForExit();
                    if (program.ExitCode != 0) throw new InvalidOperationException(said);
                }
            }
            catch (System.ComponentModel.Win32Exception)
            {
                throw new InvalidOperationException(lost);
            }
        }

        static void Fill(AssetImportContext context, List<(Mesh mesh, bool bothSides)> meshes)
        {
            context.DependsOnArtifact(ShaderPath);
            var shader = AssetDatabase.LoadAssetAtPath<Shader>(ShaderPath);
            var both = new Material(shader) { name = "scene" };
            var front = new Material(shader) { name = "scene_front" };
            front.SetFloat("_Cull", 2);
            var root = new GameObject(Path.GetFileNameWithoutExtension(context.assetPath));
            foreach (var part in meshes)
            {
                var mesh = part.mesh;
                // Its name tells Godot what it is for.
                mesh.name = mesh.name.Replace("-colonly", "");
                var node = new GameObject(mesh.name) { isStatic = true };
                node.transform.SetParent(root.transform, false);
                if (mesh.name == "collision")
                {
                    node.AddComponent<MeshCollider>().sharedMesh = mesh;
                }
                else
                {
                    node.AddComponent<MeshFilter>().sharedMesh = mesh;
                    node.AddComponent<MeshRenderer>().sharedMaterial = part.bothSides ? both : front;
                }
                context.AddObjectToAsset(mesh.name, mesh);
            }
            context.AddObjectToAsset("material", both);
            context.AddObjectToAsset("material of fronts", front);
            context.AddObjectToAsset("root", root);
            context.SetMainObject(root);
        }
    }
}
