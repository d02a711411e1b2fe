// What the scripts for Unity use of its editor, by its documentation: for a compiler to check them against. What the importer uses does as
// much as shows what it makes (import.cs).
using System;
using System.Collections.Generic;
using System.IO;
using System.Runtime.Serialization.Json;
using System.Text;
using System.Xml;

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
        public GameObject gameObject { get; internal set; }
        public Transform transform => gameObject.transform;
    }
    public class MonoBehaviour : Component { }
    public class Transform : Component
    {
        internal readonly List<Transform> children = new List<Transform>();
        public void SetParent(Transform parent, bool worldPositionStays) => parent.children.Add(this);
    }
    public class GameObject : Object
    {
        readonly List<Component> components = new List<Component>();
        public GameObject(string name)
        {
            this.name = name;
            transform = AddComponent<Transform>();
        }
        public Transform transform { get; }
        public bool isStatic;
        public T AddComponent<T>() where T : Component, new()
        {
            var made = new T { gameObject = this };
            components.Add(made);
            return made;
        }
        public T GetComponent<T>() where T : Component => components.Find(one => one is T) as T;
        public T[] GetComponentsInChildren<T>() => throw new NotImplementedException();
    }
    public struct Vector3 { public float x, y, z; public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; } }
    public struct Color32 { public byte r, g, b, a; public Color32(byte r, byte g, byte b, byte a) { this.r = r; this.g = g; this.b = b; this.a = a; } }
    public class Mesh : Object
    {
        public Rendering.IndexFormat indexFormat { get; set; }
        public Vector3[] vertices { get; set; }
        public Color32[] colors32 { get; set; } = { };
        public int[] triangles { get; set; }
    }
    public class Texture : Object { }
    public class Shader : Object { public static Shader Find(string name) => new Shader { name = name }; }
    public static class RenderSettings { public static Material skybox; }
    public class Material : Object
    {
        internal readonly Dictionary<string, float> floats = new Dictionary<string, float>();
        internal readonly Dictionary<string, Texture> textures = new Dictionary<string, Texture>();
        public Material(Shader shader) => this.shader = shader;
        public Shader shader { get; }
        public void SetFloat(string name, float value) => floats[name] = value;
        public void SetTexture(string name, Texture value) => textures[name] = value;
    }
    public static class JsonUtility
    {
        // Fields of what is not there are 0 or null.
        public static T FromJson<T>(string json)
        {
            var document = new XmlDocument();
            document.Load(JsonReaderWriterFactory.CreateJsonReader(Encoding.UTF8.GetBytes(json), new XmlDictionaryReaderQuotas()));
            return (T)Make(typeof(T), document.DocumentElement);
        }

        static object Make(Type type, XmlElement from)
        {
            if (type == typeof(int) || type == typeof(bool) || type == typeof(string)) return Convert.ChangeType(from.InnerText, type);
            if (type.IsArray)
            {
                var items = Array.CreateInstance(type.GetElementType(), from.ChildNodes.Count);
                for (var i = 0; i < items.Length; i++) items.SetValue(Make(type.GetElementType(), (XmlElement)from.ChildNodes[i]), i);
                return items;
            }
            var made = Activator.CreateInstance(type);
            foreach (var field in type.GetFields())
            {
                if (from[field.Name] != null) field.SetValue(made, Make(field.FieldType, from[field.Name]));
            }
            return made;
        }
    }
    public class MeshFilter : Component { public Mesh sharedMesh; }
    public class MeshCollider : Component { public Mesh sharedMesh; }
    public class Renderer : Component { public bool enabled; public Material sharedMaterial; }
    public class MeshRenderer : Renderer { }
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

namespace UnityEngine.Rendering
{
    public enum IndexFormat { UInt16, UInt32 }
}

namespace UnityEditor
{
    using UnityEngine;

    [AttributeUsage(AttributeTargets.Method)]
    public class MenuItem : Attribute { public MenuItem(string path) { } }
    public static class AssetDatabase
    {
        public static string[] GetAllAssetPaths() => throw new NotImplementedException();
        // The assets of this project are shaders in packages, and pictures that are files.
        public static T LoadAssetAtPath<T>(string path) where T : Object
        {
            if (path.EndsWith(".shader")) return new Shader { name = path } as T;
            return File.Exists(path) ? new Texture { name = path } as T : null;
        }
    }
    public static class EditorPrefs
    {
        static readonly Dictionary<string, string> all = new Dictionary<string, string>();
        public static string GetString(string key, string otherwise) => all.TryGetValue(key, out var value) ? value : otherwise;
        public static void SetString(string key, string value) => all[key] = value;
    }
    public static class EditorGUILayout { public static string TextField(string label, string text) => throw new NotImplementedException(); }
    public enum SettingsScope { User, Project }
    public class SettingsProvider
    {
        public SettingsProvider(string path, SettingsScope scope) => throw new NotImplementedException();
        public Action<string> guiHandler { get; set; }
    }
    [AttributeUsage(AttributeTargets.Method)]
    public class SettingsProviderAttribute : Attribute { }
    public static class PrefabUtility
    {
        internal static string path = "";
        public static string GetPrefabAssetPathOfNearestInstanceRoot(Object of) => path;
        public static Object InstantiatePrefab(Object source, Transform parent) => throw new NotImplementedException();
    }
    public static class Undo { public static void RegisterCreatedObjectUndo(Object what, string name) => throw new NotImplementedException(); }
    public static class Selection { public static GameObject activeGameObject; }
}

namespace UnityEditor.AssetImporters
{
    using UnityEngine;

    [AttributeUsage(AttributeTargets.Class)]
    public class ScriptedImporterAttribute : Attribute { public ScriptedImporterAttribute(int version, string[] exts) { } }
    public abstract class ScriptedImporter : Object { public abstract void OnImportAsset(AssetImportContext ctx); }
    public class AssetImportContext
    {
        internal readonly List<Object> objects = new List<Object>();
        internal readonly List<string> errors = new List<string>();
        internal AssetImportContext(string path) => assetPath = path;
        public string assetPath { get; }
        public Object mainObject { get; private set; }
        public void AddObjectToAsset(string identifier, Object obj) => objects.Add(obj);
        public void SetMainObject(Object obj) => mainObject = obj;
        public void DependsOnArtifact(string path) { }
        public void LogImportError(string msg, Object obj = null) => errors.Add(msg);
    }
}
