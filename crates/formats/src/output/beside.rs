//! The files beside the scene: backdrop, collision, levels.

use super::{Output, OutputFormat, OutputOptions, is_device};
use crate::levels::EngineLevels;
use crate::target::OutputTarget;
use std::path::{Path, PathBuf};
use trisplat_scene::{Error, Result};

/// Name of the node in a file of the collider.
const COLLISION_NODE: &str = "collision";

/// The kinds of files beside the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Beside {
    /// How many levels of detail.
    pub levels: usize,
    /// The backdrop in a separate file.
    pub backdrop: bool,
    /// The surroundings as a panorama.
    pub sky: bool,
    /// What to collide with.
    pub collision: bool,
    /// The picture of its texture, if the format does not hold it.
    pub texture: bool,
}

impl Output {
    /// The files of a scene and all files beside it; `format` decides if the name of `path` does not.
    /// Standard output can take only one file.
    ///
    /// Errors: a name without a known ending; an output that cannot have files beside it.
    pub fn of_scene(
        path: &Path,
        format: Option<OutputFormat>,
        options: &OutputOptions,
        beside: &Beside,
    ) -> Result<Self> {
        let mut output = Self::plan(path, format, options)?.with_levels(beside.levels, options)?;
        if beside.backdrop {
            output = output.with_backdrop_file(options)?;
        }
        // A page holds it.
        if beside.sky && output.format != OutputFormat::Html {
            output.sky = Some(output.beside(
                &format!("sky.{}", options.texture_format.ending()),
                "`backdrop` sky writes a picture",
            )?);
        }
        if beside.collision {
            output = output.with_collision(options)?;
        }
        if beside.texture && output.format == OutputFormat::Obj {
            output.take_picture(options);
        }
        Ok(output)
    }

    /// Adds the picture of a texture to the scene, its backdrop and its levels: OUT.jpg.
    fn take_picture(&mut self, options: &OutputOptions) {
        self.picture = Some(self.main.with_extension(options.texture_format.ending()));
        self.backdrop.iter_mut().for_each(|backdrop| backdrop.take_picture(options));
        self.levels.iter_mut().for_each(|level| level.take_picture(options));
    }

    /// The same with the backdrop in a separate file: OUT.backdrop.glb.
    pub fn with_backdrop_file(mut self, options: &OutputOptions) -> Result<Self> {
        let path = self.part("backdrop", "`backdrop` file writes one")?;
        self.backdrop = Some(Box::new(Self::plan(&path, Some(self.format), options)?));
        Ok(self)
    }

    /// The same with the collider in a separate file, OUT.collision.glb, unless the target has a node for it.
    pub fn with_collision(mut self, options: &OutputOptions) -> Result<Self> {
        let gltf = matches!(self.format, OutputFormat::Glb | OutputFormat::Gltf);
        if gltf && options.target.has_collision_node() {
            return Ok(self);
        }
        let path = self.part("collision", "`collision` writes one")?;
        let file = Self::plan(&path, Some(self.format), options)?;
        self.collision = Some(Box::new(Self { node: COLLISION_NODE, ..file }));
        Ok(self)
    }

    /// The same with `levels` levels of detail beside it: OUT.lod1.glb and so on, and for glTF a tileset of all and the file that the
    /// target's engine needs.
    pub fn with_levels(mut self, levels: usize, options: &OutputOptions) -> Result<Self> {
        if levels == 0 {
            return Ok(self);
        }
        let level = |i: usize| {
            let path = self.part(&format!("lod{i}"), "`lod` writes more files")?;
            Self::plan(&path, Some(self.format), options)
        };
        self.levels = (1..=levels).map(level).collect::<Result<_>>()?;
        let gltf = matches!(self.format, OutputFormat::Glb | OutputFormat::Gltf);
        self.tileset = gltf.then(|| self.main.with_extension("tileset.json"));
        let kind = options.target.levels().filter(|_| gltf);
        self.engine_levels = kind.map(|kind| (self.main.with_extension(kind.ending()), kind));
        Ok(self)
    }

    /// OUT.PART.glb, as [`Output::beside`].
    fn part(&self, part: &str, what: &str) -> Result<PathBuf> {
        let ending = self.main.extension().and_then(|e| e.to_str()).unwrap_or("glb");
        self.beside(&format!("{part}.{ending}"), what)
    }

    /// OUT.ENDING; `what` names the content in the error for outputs that cannot have files beside them.
    fn beside(&self, ending: &str, what: &str) -> Result<PathBuf> {
        let alone = matches!(self.format, OutputFormat::Html | OutputFormat::Tiles | OutputFormat::Usdz);
        if alone || self.main.as_os_str() == "-" || is_device(&self.main) {
            let wants = format!("a .glb, .gltf, .obj or .ply file: {what} beside the first");
            return Err(Error::invalid("output", self.main.display(), wants));
        }
        Ok(self.main.with_extension(ending))
    }
}

// ---- Left-over files of an earlier scene of the same name --------------------------------------------

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
        let of_levels = |path: &PathBuf| ["bin", "mtl"].map(|ending| path.with_extension(ending));
        found.extend(found.clone().iter().flat_map(of_levels));
        let parts = ["backdrop", "collision"].map(|part| beside(&format!("{part}.{ending}")));
        found.extend(parts.iter().flat_map(of_levels));
        found.extend(parts);
        found.extend(["tileset.json", "sky.jpg", "sky.png"].map(beside));
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
