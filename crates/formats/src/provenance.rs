//! The provenance of a scene, as one comment line of a PLY or OBJ file.
//!
//! ```text
//! trisplat {"generator":"trisplat 0.1.0","source":"room.pt","up":"y","placement":{...}}
//! ```
//!
//! JSON, because it escapes line breaks in names and is the form of `asset.extras` in our GLB, too.

use trisplat_scene::Provenance;

const KEY: &str = "trisplat ";

/// The comment's text, without the format's comment sign and without a line break. Empty when only defaults
/// are known.
pub(super) fn to_comment(provenance: &Provenance) -> String {
    if *provenance == Provenance::default() {
        return String::new();
    }
    // Plain strings and numbers always serialize.
    serde_json::to_string(provenance).map(|json| format!("{KEY}{json}")).unwrap_or_default()
}

/// The provenance in the comments. A broken comment of ours becomes a warning, not an error, because the
/// triangles are valid without it.
pub(super) fn from_comments<'a>(
    comments: impl Iterator<Item = &'a str>,
    warnings: &mut Vec<String>,
) -> Provenance {
    for comment in comments {
        let Some(json) = comment.trim().strip_prefix(KEY).filter(|rest| rest.starts_with('{')) else {
            continue;
        };
        match serde_json::from_str::<Provenance>(json) {
            Ok(provenance) => {
                let possible = provenance.clone().possible();
                if possible != provenance {
                    let what = "the viewpoint or the placement in the trisplat comment is ignored: no scene has such numbers";
                    warnings.push(what.to_owned());
                }
                return possible;
            }
            Err(error) => warnings.push(format!("the trisplat comment is ignored: {error}")),
        }
    }
    Provenance::default()
}

/// The number of first triangles of a soup that are its shell, by the comments of earlier versions; newer
/// files have a property per face.
pub(super) fn shell_of_comments<'a>(mut comments: impl Iterator<Item = &'a str>) -> usize {
    #[derive(serde::Deserialize)]
    struct Old {
        #[serde(default)]
        shell: usize,
    }
    let old = |comment: &str| serde_json::from_str::<Old>(comment.trim().strip_prefix(KEY)?).ok();
    comments.find_map(old).map_or(0, |old| old.shell)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use trisplat_scene::camera::{OrbitRange, Viewpoint};
    use trisplat_scene::{Placement, UpAxis};

    proptest! {
        #[test]
        fn reads_back_equal(source in ".{0,20}", scale in 1e-30f64..1e30, x: f32, seed: u64) {
            let center = [x as f64, seed as f64 * 1e-7, -scale];
            prop_assume!(x.is_finite());
            let provenance = Provenance {
                generator: Some("trisplat 0.1.0".into()),
                source: Some(format!("{source}\r\n{source}")),
                trainer: None,
                up: Some(UpAxis::NegY),
                placement: Placement { up: UpAxis::Z.into(), rotate: -scale, scale, center },
                viewpoint: Some(Viewpoint {
                    eye: [1.0, seed as f64 * 1e-7, -scale.sqrt()],
                    target: [0.0; 3],
                    up: [0.0, 1.0, 0.0],
                    fov: 50.0,
                    radius: Some(x.abs().into()),
                    orbit: Some(OrbitRange { turn: Some([-scale.min(360.0), 0.1]), elevation: [-0.3, 1.0 / 3.0] }),
                }),
                backdrop: seed as u32,
            };
            let comment = to_comment(&provenance);
            prop_assert!(!comment.contains(['\n', '\r']));
            let mut warnings = Vec::new();
            let back = from_comments(["made by hand", comment.as_str()].into_iter(), &mut warnings);
            prop_assert_eq!(back, provenance);
            prop_assert!(warnings.is_empty());
        }
    }

    #[test]
    fn a_viewpoint_or_placement_that_cannot_be_is_a_warning() {
        for (place, with) in
            [("scale", "1e308"), ("scale", "0"), ("eye", "[1e39,0,0]"), ("fov", "1e308"), ("fov", "0")]
        {
            let provenance = Provenance {
                viewpoint: Some(Viewpoint {
                    eye: [1.0; 3],
                    target: [0.0; 3],
                    up: [0.0, 1.0, 0.0],
                    fov: 50.0,
                    radius: None,
                    orbit: None,
                }),
                ..Provenance::default()
            };
            let mut json = serde_json::to_value(&provenance).unwrap();
            let part = if place == "scale" { "placement" } else { "viewpoint" };
            json[part][place] = serde_json::from_str(with).unwrap();
            let mut warnings = Vec::new();
            let back = from_comments([format!("{KEY}{json}").as_str()].into_iter(), &mut warnings);
            assert!(back != provenance || part == "placement", "{back:?}");
            assert_eq!((back.placement, warnings.len()), (Placement::IDENTITY, 1), "{place} {with}");
            assert_eq!(back.viewpoint.is_some(), part == "placement", "{place} {with}");
        }
    }

    #[test]
    fn a_broken_comment_is_a_warning() {
        let mut warnings = Vec::new();
        let back = from_comments(["trisplat {\"up\":\"sideways\"}"].into_iter(), &mut warnings);
        assert_eq!(back, Provenance::default());
        assert_eq!(warnings.len(), 1);
    }
}
