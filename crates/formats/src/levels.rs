//! Files that make an engine draw each level of detail where it suffices; each engine has its own kind.

mod distances;
mod godot;
mod scripts;

pub(super) use distances::{EngineScene, LevelFile};

/// The kind of file an engine reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EngineLevels {
    /// Godot 4: a scene with visibility ranges, OUT.lod.tscn.
    GodotScene,
    /// Unity: an editor script that makes an LOD group, OUT.lod.cs.
    UnityScript,
    /// Unreal Engine 5: a Python script for the editor that makes one static mesh, OUT.lod.py.
    UnrealScript,
}

impl EngineLevels {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::GodotScene, Self::UnityScript, Self::UnrealScript];

    /// The ending of the file's name, which replaces the scene's.
    pub fn ending(self) -> &'static str {
        match self {
            Self::GodotScene => "lod.tscn",
            Self::UnityScript => "lod.cs",
            Self::UnrealScript => "lod.py",
        }
    }

    /// The text of the file for a scene called `name`.
    pub(super) fn text(self, name: &str, scene: &EngineScene) -> String {
        match self {
            Self::GodotScene => godot::text(scene),
            Self::UnityScript => scripts::unity(name, scene),
            Self::UnrealScript => scripts::unreal(name, scene),
        }
    }
}
