// Preferences > Trisplat: where the program is, if not on the PATH.
using System;
using System.IO;
using System.Linq;
using UnityEditor;

namespace Trisplat
{
    static class TrisplatPreferences
    {
        const string Key = "trisplat.program";

        public static string Program => EditorPrefs.GetString(Key, "trisplat");

        // Its path: an absolute one, or of a name in an absolute folder of the PATH, never in the current folder. Null if it is not there.
        public static string Find()
        {
            var name = Program;
            var windows = Path.DirectorySeparatorChar == '\\';
            var whole = Path.IsPathRooted(name);
            if (name.Length == 0 || !whole && Path.GetFileName(name) != name) return null;
            var path = Environment.GetEnvironmentVariable("PATH") ?? "";
            var folders = whole ? new[] { "" } : path.Split(Path.PathSeparator).Where(folder => folder.Length > 0 && Path.IsPathRooted(folder));
            var endings = windows ? new[] { "", ".exe" } : new[] { "" };
            return folders.SelectMany(folder => endings.Select(ending => Path.Combine(folder, name + ending))).FirstOrDefault(File.Exists);
        }

        [SettingsProvider]
        static SettingsProvider Provide() => new SettingsProvider("Preferences/Trisplat", SettingsScope.User)
        {
            guiHandler = _ => EditorPrefs.SetString(Key, EditorGUILayout.TextField("Program", Program)),
        };
    }
}
