// One object of the files that `trisplat bake scene.ply -o scene.glb --target unity --collision --lod 0.5,0.25,0.125` writes: drag the
// imported scene.glb, scene.lod1.glb, ... into `levels`, scene.collision.glb into `collision`, then choose Build in the menu of the component.
using System.Linq;
using UnityEngine;

public class TrisplatScene : MonoBehaviour
{
    [Tooltip("The imported scene, then its levels, finest first.")]
    public GameObject[] levels;
    [Tooltip("The imported scene.collision.glb, if there is one.")]
    public GameObject collision;
    [Tooltip("Height on the screen, of 1, below which the next level is drawn: one for each level. Below the last, nothing is.")]
    public float[] heights = { 0.5f, 0.25f, 0.12f, 0.02f };

    [ContextMenu("Build")]
    public void Build()
    {
        while (transform.childCount > 0) DestroyImmediate(transform.GetChild(0).gameObject);
        if (levels.Length > 0) BuildLevels();
        if (collision != null) BuildCollision();
    }

    void BuildLevels()
    {
        if (!TryGetComponent<LODGroup>(out var group)) group = gameObject.AddComponent<LODGroup>();
        group.SetLODs(levels.Select((level, i) =>
        {
            var copy = Instantiate(level, transform);
            copy.name = $"{name}_LOD{i}";
            var height = i < heights.Length ? heights[i] : heights.Last() / (1 << (i + 1 - heights.Length));
            return new LOD(height, copy.GetComponentsInChildren<Renderer>());
        }).ToArray());
        group.RecalculateBounds();
    }

    // A triangle mesh as it is: a convex one would close doors and rooms. Static, as Unity moves no body with such a collider.
    void BuildCollision()
    {
        var copy = Instantiate(collision, transform);
        copy.name = $"{name}_collision";
        foreach (var filter in copy.GetComponentsInChildren<MeshFilter>())
        {
            filter.gameObject.AddComponent<MeshCollider>().sharedMesh = filter.sharedMesh;
            filter.gameObject.isStatic = true;
        }
        foreach (var renderer in copy.GetComponentsInChildren<Renderer>()) renderer.enabled = false;
    }
}
