//! Progress of a plan's blocks, by the files beside the plan.

use super::manifest::Manifest;
use super::task::BlockFigures;
use std::path::Path;
use trisplat_scene::{Limits, Result, input};

/// State of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockState {
    /// Not started.
    Waiting,
    /// A checkpoint exists: the block is being trained, or was stopped.
    Begun,
    /// Its result exists.
    Done,
}

impl BlockState {
    /// As it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Begun => "begun",
            Self::Done => "done",
        }
    }
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockStatus {
    /// Its state.
    pub state: BlockState,
    /// What it took, once it is done.
    pub figures: Option<BlockFigures>,
}

/// The state of every block of `manifest`, whose folder is `folder`.
///
/// Errors: figures that cannot be read.
pub fn status(manifest: &Manifest, folder: &Path, limits: &Limits) -> Result<Vec<BlockStatus>> {
    let block = |index: usize| {
        let file = |ending: &str| folder.join(manifest.blocks[index].file(index, ending));
        let state = match (file("ply").is_file(), file("checkpoint").is_file()) {
            (true, _) => BlockState::Done,
            (false, true) => BlockState::Begun,
            (false, false) => BlockState::Waiting,
        };
        let text = match file("json").is_file() {
            true => Some(input::read_text(&file("json"), limits)?),
            false => None,
        };
        // Figures are for people: broken ones are none.
        let figures = text.and_then(|text| serde_json::from_str(&text).ok());
        Ok(BlockStatus { state, figures })
    };
    (0..manifest.blocks.len()).map(block).collect()
}
