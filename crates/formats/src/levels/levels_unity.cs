// Written by {generator}: makes one object of a scene and its levels of detail, an LOD group.
// Put it beside the files into Assets, then choose GameObject > trisplat > (the scene's name).
#if UNITY_EDITOR
using System.IO;
using System.Linq;
using UnityEditor;
using UnityEngine;

public static class TrisplatLevels_{class}
{
    const string Name = {name};
    // The scene, then its levels, finest first.
    static readonly string[] Files = { {files} };
    // Height of the scene on the screen, 1 being all of it, below which the next level is drawn: its triangles are then 2 px wide on a
    // screen of 1080 px, with a camera of 60 degrees and an LOD bias of 1.
    static readonly float[] Heights = { {sizes} };

    [MenuItem("GameObject/trisplat/" + Name)]
    static void Create()
    {
        // Wherever in the project this script is.
        var script = AssetDatabase.GetAllAssetPaths().First(path => Path.GetFileName(path) == Name + ".lod.cs");
        var folder = Path.GetDirectoryName(script).Replace('\\', '/');
        var scene = new GameObject(Name);
        var group = scene.AddComponent<LODGroup>();
        group.SetLODs(Files.Select((file, i) => Level(scene, folder + "/" + file, i)).ToArray());
        group.RecalculateBounds();
        Undo.RegisterCreatedObjectUndo(scene, "trisplat " + Name);
        Selection.activeGameObject = scene;
    }

    static LOD Level(GameObject scene, string path, int i)
    {
        var model = AssetDatabase.LoadAssetAtPath<GameObject>(path);
        if (model == null) throw new FileNotFoundException(path + " is not there, or no package imports it: install com.unity.cloud.gltfast");
        var level = (GameObject)PrefabUtility.InstantiatePrefab(model, scene.transform);
        level.name = Name + "_LOD" + i;
        // A backdrop is no part of a level: that of the finest is always drawn, and does not count for the size of the scene.
        var renderers = level.GetComponentsInChildren<Renderer>().ToLookup(renderer => renderer.name.StartsWith("backdrop"));
        foreach (var backdrop in renderers[true]) backdrop.enabled = i == 0;
        return new LOD(Heights[i], renderers[false].ToArray());
    }
}
#endif
