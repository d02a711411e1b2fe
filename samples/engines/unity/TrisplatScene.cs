// Mesh colliders and sky of what `trisplat bake scene.ply -o scene.glb --target unity --collision --backdrop sky` writes: drag scene.glb into the
// scene, put this on the object, and choose Build in the menu of the component. It finds scene.collision.glb and scene.sky.jpg beside
// scene.glb; elsewhere, drag them into the fields. The levels that `--lod` writes have a script of their own, scene.lod.cs, which makes an LOD
// group of them.
using UnityEngine;
#if UNITY_EDITOR
using System.IO;
using UnityEditor;
#endif

public class TrisplatScene : MonoBehaviour
{
    [Tooltip("The imported scene.collision.glb.")]
    public GameObject collision;

    [Tooltip("The panorama that --backdrop sky writes, scene.sky.jpg.")]
    public Texture sky;

    [SerializeField, HideInInspector] GameObject built;

    // A triangle mesh as it is: a convex one would close doors and rooms. Static, as Unity moves no body with such a collider.
    [ContextMenu("Build")]
    public void Build()
    {
        FindBeside();
        if (sky != null) RenderSettings.skybox = Panorama();
        if (built != null) DestroyImmediate(built);
        if (collision == null) return;
        built = Instantiate(collision, transform);
        built.name = $"{name}_collision";
        foreach (var filter in built.GetComponentsInChildren<MeshFilter>())
        {
            filter.gameObject.AddComponent<MeshCollider>().sharedMesh = filter.sharedMesh;
            filter.gameObject.isStatic = true;
        }
        foreach (var renderer in built.GetComponentsInChildren<Renderer>()) renderer.enabled = false;
    }

    void FindBeside()
    {
#if UNITY_EDITOR
        var scene = PrefabUtility.GetPrefabAssetPathOfNearestInstanceRoot(gameObject);
        if (string.IsNullOrEmpty(scene)) return;
        if (collision == null) collision = AssetDatabase.LoadAssetAtPath<GameObject>(Path.ChangeExtension(scene, "collision.glb"));
        foreach (var ending in new[] { "sky.jpg", "sky.png" })
        {
            if (sky == null) sky = AssetDatabase.LoadAssetAtPath<Texture>(Path.ChangeExtension(scene, ending));
        }
#endif
    }

    // Its middle is +X, in the file and in Unity. Importers of glTF turn x around, so the file's +X is Unity's -X: half a turn.
    Material Panorama()
    {
        var material = new Material(Shader.Find("Skybox/Panoramic"));
        material.SetTexture("_MainTex", sky);
        material.SetFloat("_Rotation", 180);
        return material;
    }
}
