// Builds the component of samples/engines/unity on an instance of SCENE, and prints its skybox: its shader, its pictures, its numbers.
// Usage: sky.exe SCENE
using System;
using UnityEditor;
using UnityEngine;

static class Sky
{
    static void Main(string[] words)
    {
        PrefabUtility.path = words[0];
        new GameObject("scene").AddComponent<TrisplatScene>().Build();
        var skybox = RenderSettings.skybox;
        if (skybox == null) return;
        Console.WriteLine($"shader {skybox.shader.name}");
        foreach (var picture in skybox.textures) Console.WriteLine($"{picture.Key} {picture.Value.name}");
        foreach (var number in skybox.floats) Console.WriteLine($"{number.Key} {number.Value}");
    }
}
