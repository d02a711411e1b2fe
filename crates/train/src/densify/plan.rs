//! Inputs and counts of a densification.

use crate::options::DensifyOptions;
use crate::params::{Anneal, Core};
use crate::stereo::DepthAnchors;
use glam::Vec3;

/// Inputs of one densification.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DensifyPlan<'a> {
    /// The constants.
    pub options: &'a DensifyOptions,
    /// Places of the cameras, in training space.
    pub eyes: &'a [Vec3],
    /// Depth anchors, once the scene is solid.
    pub anchors: Option<&'a DepthAnchors>,
    /// Never more triangles than this.
    pub max_triangles: usize,
    /// The box with its own budget, when only a part of a scene is trained.
    pub core: Option<Core>,
    /// Triangles may be added.
    pub grow: bool,
    /// Depth anchors may move triangles.
    pub pull: bool,
    /// τ_prune of this densification.
    pub prune_weight: f32,
    /// Triangles fainter than this are pruned.
    pub prune_opacity: f64,
    /// Number of the densification: alternating sampling goes by opacity at odd ones.
    pub densification: u64,
    /// Grow by cutting triangles in two where the picture is wrong, which does not change the look
    /// of a solid scene.
    pub bisect: bool,
    /// State of the solid anneal.
    pub anneal: Anneal,
    /// The user's seed.
    pub seed: u64,
    /// Steps made.
    pub step: u64,
}

/// Counts of one densification.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Densified {
    /// Removed: no longer finite.
    pub broken: usize,
    /// Removed: too faint.
    pub faint: usize,
    /// Removed: too little weight at every pixel.
    pub unimportant: usize,
    /// Removed: visible in too few photos.
    pub unseen: usize,
    /// Removed: before a camera, and shown by few photos from far away.
    pub unsupported: usize,
    /// Removed: before depth anchors.
    pub blocking: usize,
    /// Removed: least summed weight, in a scene at its limit of triangles.
    pub relocated: usize,
    /// Added at depth anchors that photos saw through.
    pub filled: usize,
    /// Split into four.
    pub split: usize,
    /// Cloned.
    pub cloned: usize,
    /// Triangles afterwards.
    pub triangles: usize,
}
