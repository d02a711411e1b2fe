//! Files of 3D Gaussian splatting (Kerbl et al. 2023): they hold no triangles. They are recognised for their readers, and for a
//! helpful message where triangles are wanted.

use super::format::Format;
use serde_json::Value;
use std::path::Path;
use trisplat_scene::Error;

/// The extension of glTF that holds them.
pub(crate) const GLTF_EXTENSION: &str = "KHR_gaussian_splatting";

/// The names of formats that have readers.
pub(crate) const SPZ: &str = "SPZ";
pub(crate) const SPLAT: &str = ".splat";

/// The refusal of a file of Gaussians where triangles are wanted, or in a format without a reader; `kind` is the usual name of
/// the format.
pub(crate) fn refusal(path: &Path, kind: &str) -> Error {
    let reason = format!(
        "holds 3D Gaussians ({kind}), blurred ellipsoids instead of triangles; `trisplat bake` turns them into triangles, and `trisplat info` and \
         `trisplat render` read them too: as PLY, .splat, SPZ (versions 2 to 4), SOG (version 2) and glTF"
    );
    Error::unsupported(path, reason)
}

/// The name of the format when a file that begins with `head` and is called `path` holds Gaussians.
///
/// `.splat` and `.ksplat` have no signature: their name decides, unless the first bytes are those of another
/// format.
pub(crate) fn recognise(head: &[u8], path: &Path) -> Option<&'static str> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    // A record of numbers may begin like a bare pickle; nothing else is taken for one.
    let other = !head.starts_with(&[0x80]) && Format::detect(head, path).is_some();
    match (head, extension.as_str()) {
        ([b'N', b'G', b'S', b'P', ..], _) | ([0x1f, 0x8b, ..], "spz") => Some(SPZ),
        (_, "splat") if !other && !head.is_empty() => Some(SPLAT),
        (_, "ksplat") if !other && !head.is_empty() => Some(".ksplat"),
        _ => None,
    }
}

/// Whether an archive of entries with these names is a scene in SOG: pictures of the Gaussians' parameters.
pub(crate) fn is_sog(entries: &[String]) -> bool {
    let has = |file: &str| entries.iter().any(|name| name.rsplit('/').next() == Some(file));
    has("meta.json") && (has("means_l.webp") || has("means_l.png"))
}

/// Whether a JSON text is the `meta.json` of SOG.
pub(crate) fn is_sog_json(json: &[u8]) -> bool {
    let parsed: Option<Value> = serde_json::from_slice(json).ok();
    parsed.is_some_and(|json| ["means", "quats", "scales"].iter().all(|key| json.get(key).is_some()))
}

/// Whether a checkpoint with these tensors is one of Gaussians: gsplat's, nerfstudio's.
pub(crate) fn are_parameters(tensors: &[String]) -> bool {
    let has = |names: [&str; 2]| {
        names.iter().any(|name| tensors.iter().any(|key| key.rsplit('.').next() == Some(name)))
    };
    has(["quats", "_rotation"]) && has(["scales", "_scaling"])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_other_formats_win_over_the_name() {
        let cases: [(&[u8], &str, Option<&str>); 9] = [
            (b"\x1f\x8b\x08\0", "a.spz", Some("SPZ")),
            (b"\x1f\x8b\x08\0", "a.gz", None),
            (b"NGSP\x04\0\0\0", "-", Some("SPZ")),
            (b"\x80\x02\x12\x3f", "a.splat", Some(".splat")),
            (b"\0\x01\0\0", "a.KSPLAT", Some(".ksplat")),
            (b"ply\nformat", "a.splat", None),
            (b"glTF\x02\0\0\0", "a.ksplat", None),
            (b"", "a.splat", None),
            (b"\0\x01\0\0", "a.bin", None),
        ];
        for (head, path, wanted) in cases {
            assert_eq!(recognise(head, Path::new(path)), wanted, "{head:?} {path}");
        }
    }

    #[test]
    fn checkpoints_of_gaussians_are_known_by_their_tensors() {
        let keys = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        assert!(are_parameters(&keys(&["splats.means", "splats.quats", "splats.scales"])));
        assert!(are_parameters(&keys(&["_xyz", "_rotation", "_scaling"])));
        assert!(!are_parameters(&keys(&["triangles_points", "sigma", "features_dc"])));
    }
}
