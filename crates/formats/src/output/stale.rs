//! Left-over files of an earlier scene of the same name.

use super::{Output, is_device};
use crate::levels::EngineLevels;
use crate::target::OutputTarget;
use std::path::PathBuf;

impl Output {
    /// Files of an earlier scene of the same name that this one does not replace.
    pub(super) fn stale(&self) -> Vec<PathBuf> {
        if self.main.as_os_str() == "-" || is_device(&self.main) {
            return Vec::new();
        }
        let ending = self.main.extension().and_then(|e| e.to_str()).unwrap_or("glb").to_owned();
        let beside = |ending: &str| self.main.with_extension(ending);
        let level = |i: usize| beside(&format!("lod{i}.{ending}"));
        let past = self.levels.len() + 1;
        let mut found: Vec<PathBuf> = (past..).map(level).take_while(|path| path.exists()).collect();
        let of_levels = |path: &PathBuf| ["bin", "mtl", "bvh"].map(|ending| path.with_extension(ending));
        found.extend(found.clone().iter().flat_map(of_levels));
        let parts = ["backdrop", "collision"].map(|part| beside(&format!("{part}.{ending}")));
        found.extend(parts.iter().flat_map(of_levels));
        found.extend(parts);
        found.extend(["bvh", "tileset.json", "sky.jpg", "sky.png"].map(beside));
        found.extend(EngineLevels::ALL.map(|kind| beside(kind.ending())));
        // Godot writes settings of that name itself: only unchanged ones are ours.
        let name = self.main.file_name().unwrap_or_default().to_string_lossy();
        let import =
            OutputTarget::Godot.sidecar(&name).map(|(name, text)| (self.main.with_file_name(name), text));
        let ours = |(path, text): (PathBuf, String)| {
            std::fs::read_to_string(&path).is_ok_and(|found| found == text).then_some(path)
        };
        found.extend(import.and_then(ours));
        found.retain(|path| path.is_file() && self.paths().all(|written| written != path));
        found
    }
}
