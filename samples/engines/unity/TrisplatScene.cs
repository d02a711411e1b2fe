// Mesh colliders of what `trisplat bake scene.ply -o scene.glb --target unity --collision` writes beside the scene: put this on the scene's
// object, drag the imported scene.collision.glb into `collision`, then choose Build in the menu of the component. The levels that `--lod`
// writes have a script of their own, scene.lod.cs, which makes an LOD group of them.
using UnityEngine;

public class TrisplatScene : MonoBehaviour
{
    [Tooltip("The imported scene.collision.glb.")]
    public GameObject collision;

    [SerializeField, HideInInspector] GameObject built;

    // A triangle mesh as it is: a convex one would close doors and rooms. Static, as Unity moves no body with such a collider.
    [ContextMenu("Build")]
    public void Build()
    {
        if (built != null) DestroyImmediate(built);
        built = Instantiate(collision, transform);
        built.name = $"{name}_collision";
        foreach (var filter in built.GetComponentsInChildren<MeshFilter>())
        {
            filter.gameObject.AddComponent<MeshCollider>().sharedMesh = filter.sharedMesh;
            filter.gameObject.isStatic = true;
        }
        foreach (var renderer in built.GetComponentsInChildren<Renderer>()) renderer.enabled = false;
    }
}
