//! Kinds of Gaussians beside those of 3DGS, told by the names of their columns: refused with the
//! way to plain ones, or read with a warning about what is lost.

use std::path::Path;
use trisplat_scene::report::counted;
use trisplat_scene::{Error, excerpt, input};

/// Maximum number of columns that a warning names.
const MAX_NAMED: usize = 6;

/// Beginnings of the names of columns for motion, or for an appearance in time: Spacetime
/// Gaussians, 4D rotors and 4D Gaussians, dynamic Gaussians with velocities.
const MOVING: [&str; 12] = [
    "trbf_", "motion_", "omega_", "rot_r_", "scale_t", "t_scale", "t_center", "time", "velocity",
    "vel_", "lifetime", "deform",
];

/// Beginnings of the names of files with a network that moves the Gaussians beside it.
const NETWORKS: [&str; 2] = ["deformation.", "deform."];

/// Names of columns that are read, or that say nothing about the look; `*` ends a beginning.
const PLAIN: [&str; 24] = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "normal_*",
    "f_dc_*",
    "f_rest_*",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
    "filter_3D",
    "red",
    "green",
    "blue",
    "alpha",
    "packed_*",
    "segment*",
];

/// The error of Gaussians that need a decoder of their trainer's; `elements` are the names of the
/// file's elements, `numbers` those of the columns and whether they are whole numbers.
pub(crate) fn refusal(path: &Path, elements: &[&str], columns: &[(&str, bool)]) -> Option<Error> {
    let has = |name: &str| columns.iter().any(|(column, _)| column.starts_with(name));
    let kind = if has("f_anchor_feat") || has("f_offset_0") {
        "anchors of Scaffold-GS or a successor, which networks turn into Gaussians for each view"
    } else if elements.iter().any(|name| name.contains("codebook"))
        || columns.iter().any(|(name, is_whole)| {
            *is_whole && ["f_dc_", "scale_", "rot_"].iter().any(|start| name.starts_with(start))
        })
    {
        "3D Gaussians as places in a codebook"
    } else if has("f_dc_0") || has("red") || has("packed_") {
        return None;
    } else if has("feature") || has("f_") {
        "3D Gaussians whose colours are features for a network"
    } else {
        return None;
    };
    let reason = format!(
        "holds {kind}; export plain Gaussians (a PLY as 3DGS writes it) with the program that trained it"
    );
    Some(Error::unsupported(path, reason))
}

/// Warnings about columns that are not read, and about a network beside the file that moves the
/// Gaussians.
pub(crate) fn warnings(path: &Path, columns: &[&str]) -> Vec<String> {
    let moves = |name: &&&str| **name == "t" || MOVING.iter().any(|start| name.starts_with(start));
    let is_plain = |name: &str| {
        PLAIN.iter().any(|plain| match plain.strip_suffix('*') {
            Some(start) => name.starts_with(start),
            None => name == *plain,
        })
    };
    let moving: Vec<&str> = columns.iter().filter(moves).copied().collect();
    let unread = |name: &&str| !is_plain(name) && !moving.contains(name);
    let unread: Vec<&str> = columns.iter().copied().filter(unread).collect();
    let mut warnings = Vec::new();
    if !moving.is_empty() {
        warnings.push(format!(
            "its Gaussians move or appear in time ({}): all moments are drawn at once; export one moment as plain Gaussians",
            named(&moving)
        ));
    } else if let Some(network) = network_beside(path) {
        warnings.push(format!(
            "{network} beside it may move its Gaussians in time, and is not read: export one moment as plain Gaussians"
        ));
    }
    if !unread.is_empty() {
        warnings.push(format!(
            "columns of its Gaussians are not read, which may change their look: {}",
            named(&unread)
        ));
    }
    warnings
}

/// The first names, and how many there are more.
fn named(columns: &[&str]) -> String {
    let first = &columns[..columns.len().min(MAX_NAMED)];
    let names: Vec<String> = first.iter().map(|name| excerpt(name)).collect();
    let more = columns.len() - first.len();
    let more = if more > 0 {
        format!(" and {} more", counted(more as u64, "column"))
    } else {
        String::new()
    };
    format!("{}{more}", names.join(", "))
}

/// The name of a file of a deformation network in the folder of `path`.
fn network_beside(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|_| path.as_os_str() != "-")?;
    let names = input::entries(folder)
        .filter_map(|file| Some(file.file_name()?.to_str()?.to_owned()))
        .filter(|name| NETWORKS.iter().any(|start| name.starts_with(start)))
        .filter(|name| name.ends_with(".pth") || name.ends_with(".pt"));
    names.min()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BASE: [&str; 14] = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
        "rot_0", "rot_1", "rot_2", "rot_3",
    ];

    #[test]
    fn splats_of_other_kinds_are_named() {
        let of = |more: &[&'static str]| [&BASE[..], more].concat();
        let warned = |more: &[&'static str]| warnings(Path::new("-"), &of(more)).join("; ");
        assert_eq!(warned(&["nx", "f_rest_0", "filter_3D", "red"]), "");
        for time in ["trbf_center", "t", "velocity_0", "time", "motion_3"] {
            let text = warned(&[time]);
            assert!(text.contains("move or appear in time") && text.contains(time), "{text}");
        }
        let text = warned(&["beta", "sb_params_0"]);
        assert!(text.contains("not read") && text.ends_with("beta, sb_params_0"), "{text}");
        let refused = |elements: &[&str], columns: &[(&str, bool)]| {
            refusal(Path::new("a"), elements, columns).map(|error| error.to_string())
        };
        let floats: Vec<(&str, bool)> = BASE.map(|name| (name, false)).to_vec();
        assert_eq!(refused(&["vertex"], &floats), None);
        let codes: Vec<(&str, bool)> = BASE.map(|name| (name, name == "rot_0")).to_vec();
        for (elements, columns, kind) in [
            (&["vertex"][..], &[("x", false), ("f_anchor_feat_0", false)][..], "Scaffold-GS"),
            (&["vertex"], &[("x", false), ("scale_0", false), ("features_0", false)], "network"),
            (&["vertex", "codebook_centers"], &floats, "codebook"),
            (&["vertex"], &codes, "codebook"),
        ] {
            let text = refused(elements, columns).unwrap_or_default();
            assert!(text.contains(kind) && text.contains("export plain"), "{kind}: {text}");
        }
    }
}
