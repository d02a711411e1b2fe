// What the scripts for Unity use of its editor, by its documentation, with nothing behind it: for a compiler to check them against.
using System;
using System.Collections.Generic;

namespace UnityEngine
{
    public class Object
    {
        public string name;
        public static bool operator ==(Object a, Object b) => ReferenceEquals(a, b);
        public static bool operator !=(Object a, Object b) => !ReferenceEquals(a, b);
        public override bool Equals(object other) => ReferenceEquals(this, other);
        public override int GetHashCode() => 0;
        public static T Instantiate<T>(T original, Transform parent) where T : Object => throw new NotImplementedException();
        public static void DestroyImmediate(Object what) => throw new NotImplementedException();
    }
    public class Component : Object
    {
        public GameObject gameObject => throw new NotImplementedException();
        public Transform transform => throw new NotImplementedException();
    }
    public class MonoBehaviour : Component { }
    public class Transform : Component { }
    public class GameObject : Object
    {
        public GameObject(string name) => throw new NotImplementedException();
        public Transform transform => throw new NotImplementedException();
        public bool isStatic;
        public T AddComponent<T>() where T : Component => throw new NotImplementedException();
        public T[] GetComponentsInChildren<T>() => throw new NotImplementedException();
    }
    public class Mesh : Object { }
    public class Texture : Object { }
    public class Shader : Object { public static Shader Find(string name) => throw new NotImplementedException(); }
    public class Material : Object
    {
        public Material(Shader shader) => throw new NotImplementedException();
        public void SetTexture(string name, Texture value) => throw new NotImplementedException();
        public void SetFloat(string name, float value) => throw new NotImplementedException();
    }
    public static class RenderSettings { public static Material skybox; }
    public class MeshFilter : Component { public Mesh sharedMesh; }
    public class MeshCollider : Component { public Mesh sharedMesh; }
    public class Renderer : Component { public bool enabled; }
    public struct LOD { public LOD(float screenRelativeTransitionHeight, Renderer[] renderers) { } }
    public class LODGroup : Component
    {
        public void SetLODs(LOD[] lods) => throw new NotImplementedException();
        public void RecalculateBounds() => throw new NotImplementedException();
    }
    [AttributeUsage(AttributeTargets.Field)]
    public class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
    [AttributeUsage(AttributeTargets.Field)]
    public class SerializeField : Attribute { }
    [AttributeUsage(AttributeTargets.Field)]
    public class HideInInspector : Attribute { }
    [AttributeUsage(AttributeTargets.Method)]
    public class ContextMenu : Attribute { public ContextMenu(string name) { } }
}

namespace UnityEditor
{
    using UnityEngine;

    [AttributeUsage(AttributeTargets.Method)]
    public class MenuItem : Attribute { public MenuItem(string path) { } }
    public static class AssetDatabase
    {
        public static string[] GetAllAssetPaths() => throw new NotImplementedException();
        public static T LoadAssetAtPath<T>(string path) where T : Object => throw new NotImplementedException();
    }
    public static class PrefabUtility
    {
        public static Object InstantiatePrefab(Object source, Transform parent) => throw new NotImplementedException();
    }
    public static class Undo { public static void RegisterCreatedObjectUndo(Object what, string name) => throw new NotImplementedException(); }
    public static class Selection { public static GameObject activeGameObject; }
}
