// Preferences > Trisplat: where the program is, if not on the PATH.
using UnityEditor;

namespace Trisplat
{
    static class TrisplatPreferences
    {
        const string Key = "trisplat.program";

        public static string Program => EditorPrefs.GetString(Key, "trisplat");

        [SettingsProvider]
        static SettingsProvider Provide() => new SettingsProvider("Preferences/Trisplat", SettingsScope.User)
        {
            guiHandler = _ => EditorPrefs.SetString(Key, EditorGUILayout.TextField("Program", Program)),
        };
    }
}
