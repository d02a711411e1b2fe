//! The targets of a file: one row for each, from measured needs of the engines.
//!
//! `docs/engines.md` gives the reasons and the steps to take in each engine.

use crate::gltf::{ColorEncoding, GltfOptions, PositionEncoding};
use crate::levels::EngineLevels;
use crate::lines::quoted;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The engine or program that will read a GLB.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "cli", value(rename_all = "lowercase"))]
pub enum OutputTarget {
    /// Any viewer that follows the glTF specification.
    #[default]
    Gltf,
    /// Godot 4: sRGB colours, a `-vcol` material and a `.import` file beside the GLB.
    Godot,
    /// Godot 3: as Godot 4, with colours as floats and no `.import` file.
    Godot3,
    /// Unity with glTFast or UnityGLTF.
    Unity,
    /// Unreal Engine 5 (Interchange).
    Unreal,
    /// Blender 3.3 and later.
    Blender,
    /// three.js, Babylon.js, CesiumJS.
    Web,
    /// PlayCanvas 2.14 and later.
    Playcanvas,
}

/// A target's support for small files.
enum SmallFile {
    /// None: positions stay f32, for this reason.
    No(&'static str),
    /// Reads 16-bit positions (KHR_mesh_quantization).
    Quantised,
    /// Reads 16-bit positions and EXT_meshopt_compression.
    Compressed,
}

/// One row of the table.
struct TargetRow {
    name: &'static str,
    colors: ColorEncoding,
    material: &'static str,
    /// Name of a node that collides and is not drawn, for engines that go by names.
    collision: Option<&'static str>,
    /// The file that switches levels of detail, if any.
    levels: Option<EngineLevels>,
    small: SmallFile,
    notes: &'static [&'static str],
    /// Notes for small files.
    small_notes: &'static [&'static str],
}

const LINEAR: ColorEncoding = ColorEncoding::U16Linear;
/// Godot reads vertex colours of materials with this ending as sRGB, and drops the ending on
/// import.
const GODOT_MATERIAL: &str = "trisplat-vcol";
/// Godot makes a static body from the mesh of a node with this ending, and does not draw it.
const GODOT_COLLISION: &str = "collision-colonly";

impl OutputTarget {
    fn row(self) -> TargetRow {
        let plain = |name, small| TargetRow {
            name,
            colors: LINEAR,
            material: "trisplat",
            collision: None,
            levels: None,
            small,
            notes: &[],
            small_notes: &[],
        };
        match self {
            OutputTarget::Gltf => plain(
                "gltf",
                SmallFile::No(
                    "not every viewer reads 16-bit positions (Godot and assimp do not); \
                     web, unity, blender and playcanvas do",
                ),
            ),
            OutputTarget::Godot => TargetRow {
                colors: ColorEncoding::U8Srgb,
                material: GODOT_MATERIAL,
                collision: Some(GODOT_COLLISION),
                levels: Some(EngineLevels::GodotScene),
                notes: &["vertex colours are sRGB codes; other viewers show this file washed out"],
                ..plain(
                    "godot",
                    SmallFile::No("its importer refuses quantised and compressed meshes"),
                )
            },
            OutputTarget::Godot3 => TargetRow {
                colors: ColorEncoding::F32Srgb,
                material: GODOT_MATERIAL,
                collision: Some(GODOT_COLLISION),
                notes: &[
                    "vertex colours are sRGB codes; other viewers show this file washed out",
                    "the importer ignores 'unlit': tick Unshaded in the material's flags",
                ],
                ..plain("godot3", SmallFile::No("a compressed mesh comes in empty"))
            },
            OutputTarget::Unity => TargetRow {
                levels: Some(EngineLevels::UnityScript),
                small_notes: &["meshopt is left out: it needs one more Unity package"],
                ..plain("unity", SmallFile::Quantised)
            },
            OutputTarget::Unreal => TargetRow {
                levels: Some(EngineLevels::UnrealScript),
                notes: &["the material needs a Vertex Color node (docs/engines.md)"],
                ..plain(
                    "unreal",
                    SmallFile::No(
                        "its importer does not read meshopt, and 16-bit positions are untried",
                    ),
                )
            },
            OutputTarget::Blender => TargetRow {
                small_notes: &[
                    "objects get a scale of their own; meshopt is left out, Blender reads it from 5.2 on",
                ],
                ..plain("blender", SmallFile::Quantised)
            },
            OutputTarget::Web => TargetRow {
                small_notes: &["the page must set a meshopt decoder (docs/engines.md)"],
                ..plain("web", SmallFile::Compressed)
            },
            OutputTarget::Playcanvas => TargetRow {
                notes: &["needs engine 2.14 or later: before, vertex colours show too bright"],
                small_notes: &["meshopt is left out: the engine does not read it"],
                ..plain("playcanvas", SmallFile::Quantised)
            },
        }
    }

    /// Options of a GLB for this target, and notes for the user, one sentence each; `small` asks
    /// for the smallest file that it can read.
    pub(crate) fn encoding(self, small: bool) -> (GltfOptions, Vec<String>) {
        let row = self.row();
        let mut notes: Vec<&str> = row.notes.to_vec();
        let kept = match row.small {
            SmallFile::No(why) => Some(format!("positions stay f32: {why}")),
            SmallFile::Quantised | SmallFile::Compressed => None,
        };
        if small {
            notes.extend(kept.as_deref());
            notes.extend(row.small_notes);
        }
        let positions = if small && kept.is_none() {
            PositionEncoding::ChunkU16
        } else {
            PositionEncoding::F32
        };
        let options = GltfOptions {
            colors: row.colors,
            positions,
            meshopt: small && matches!(row.small, SmallFile::Compressed),
            material_name: row.material.to_owned(),
            collision_name: row.collision.map(str::to_owned),
            ..GltfOptions::default()
        };
        (options, notes.iter().map(|note| format!("{}: {note}", row.name)).collect())
    }

    /// True when the target's glTF has a collision node; other targets get a file beside the scene.
    pub fn has_collision_node(self) -> bool {
        self.row().collision.is_some()
    }

    /// The file that switches levels of detail in the engine, if any.
    pub(crate) fn levels(self) -> Option<EngineLevels> {
        self.row().levels
    }

    /// Name and content of the file that goes beside `glb_file_name`, for engines that need one.
    ///
    /// Godot 4 honours and completes an import file that exists before it first sees the GLB. Ours
    /// turns off features that harm triangle soups: level-of-detail meshes (they delete triangles),
    /// tangents, shadow meshes, lightmap coordinates and vertex compression.
    pub(crate) fn sidecar(self, glb_file_name: &str) -> Option<(String, String)> {
        (self == OutputTarget::Godot).then(|| {
            let source = quoted(&format!("res://{glb_file_name}"));
            (format!("{glb_file_name}.import"), GODOT_IMPORT.replace("{source}", &source))
        })
    }
}

const GODOT_IMPORT: &str = r#"[remap]

importer="scene"
importer_version=1
type="PackedScene"

[deps]

source_file={source}

[params]

meshes/ensure_tangents=false
meshes/generate_lods=false
meshes/create_shadow_meshes=false
meshes/light_baking=0
meshes/force_disable_compression=true
gltf/embedded_image_handling=3
"#;

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [OutputTarget; 8] = [
        OutputTarget::Gltf,
        OutputTarget::Godot,
        OutputTarget::Godot3,
        OutputTarget::Unity,
        OutputTarget::Unreal,
        OutputTarget::Blender,
        OutputTarget::Web,
        OutputTarget::Playcanvas,
    ];

    /// Its name in options and reports.
    fn name(target: OutputTarget) -> String {
        serde_json::to_value(target).unwrap().as_str().unwrap().to_owned()
    }

    #[cfg(feature = "cli")]
    #[test]
    fn all_targets_are_tested_and_named_as_they_are_typed() {
        use clap::ValueEnum;
        assert_eq!(OutputTarget::value_variants(), ALL);
        for target in ALL {
            assert_eq!(target.to_possible_value().unwrap().get_name(), name(target));
        }
    }

    #[test]
    fn godot_files_alone_have_srgb_colors_and_say_so() {
        for target in ALL {
            for small in [false, true] {
                let options = target.encoding(small).0;
                assert_eq!(
                    options.colors.is_linear(),
                    !options.material_name.ends_with("-vcol"),
                    "{target:?}"
                );
                let godot = matches!(target, OutputTarget::Godot | OutputTarget::Godot3);
                assert_eq!(options.colors.is_linear(), !godot, "{target:?}");
            }
        }
    }

    #[test]
    fn glb_is_quantised_and_compressed_by_small_only() {
        for target in ALL {
            let options = target.encoding(false).0;
            assert!(options.positions == PositionEncoding::F32 && !options.meshopt, "{target:?}");
            let (small, notes) = target.encoding(true);
            let reads = matches!(
                target,
                OutputTarget::Unity
                    | OutputTarget::Blender
                    | OutputTarget::Web
                    | OutputTarget::Playcanvas
            );
            assert_eq!(small.positions == PositionEncoding::ChunkU16, reads, "{target:?}");
            assert_eq!(small.meshopt, target == OutputTarget::Web, "{target:?}");
            assert!(!notes.is_empty(), "{target:?} says what small means");
        }
    }

    #[test]
    fn notes_start_with_the_name_the_user_typed() {
        for target in ALL {
            for note in target.encoding(true).1 {
                assert!(note.starts_with(&format!("{}: ", name(target))), "{note}");
            }
        }
    }

    #[test]
    fn engines_with_levels_of_their_own_get_a_file_for_them() {
        let kinds = ALL.iter().filter_map(|target| target.levels());
        assert_eq!(kinds.collect::<Vec<_>>(), EngineLevels::ALL);
        assert_eq!(OutputTarget::Godot.levels().map(EngineLevels::ending), Some("lod.tscn"));
    }

    #[test]
    fn godot_gets_an_import_file_and_nobody_else() {
        for target in ALL {
            assert_eq!(target.sidecar("scene.glb").is_some(), target == OutputTarget::Godot);
        }
        let (name, content) = OutputTarget::Godot.sidecar("a \"b\".glb").unwrap_or_default();
        assert_eq!(name, "a \"b\".glb.import");
        assert!(content.contains("source_file=\"res://a \\\"b\\\".glb\"\n"));
        assert!(content.contains("meshes/generate_lods=false\n"));
    }
}
