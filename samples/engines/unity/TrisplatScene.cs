// Mesh colliders and sky of what `trisplat bake scene.ply -o scene.glb --target unity --collision --backdrop sky` writes beside the scene: put
// this on the scene's object, drag the imported scene.collision.glb into `collision` and scene.sky.jpg into `sky`, then choose Build in the menu of the component. The levels that `--lod`
// writes have a script of their own, scene.lod.cs, which makes an LOD group of them.
using UnityEngine;

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

    // Importers of glTF turn x around: the panorama turns by a half with it.
    Material Panorama()
    {
        var material = new Material(Shader.Find("Skybox/Panoramic"));
        material.SetTexture("_MainTex", sky);
        material.SetFloat("_Rotation", 180);
        return material;
    }
}
