//! The first triangles on surfaces from stereo, and the points of the cloud that are still needed.

use super::init::{FIRST_OPACITY, FIRST_SIGMA};
use super::options::{StereoUse, TrainOptions};
use crate::dataset::{Point, View};
use crate::error::Result;
use crate::report::StageProgress;
use crate::soup::{Soup, sh0_from_rgb};
use crate::space::Space;
use crate::stereo::{DepthMap, StereoOptions, estimate, facets};
use glam::Vec3;

/// Most triangles on surfaces, as a share of `max_triangles`, because growth needs room.
const SHARE: f64 = 0.4;
/// Other photos that must agree with a depth, and its least confidence: stricter than for points, because a
/// wrong surface floats in every other view (docs/benchmarks/stereo.md).
const MIN_AGREEING: u32 = 3;
const MIN_CONFIDENCE: f32 = 0.8;
/// Least photos for stereo.
const LEAST_PHOTOS: usize = 3;
/// A point lies on a surface if their depths differ by less than this share.
const IN_SURFACE: f32 = 0.05;
/// Number of photos that must see through a point before it counts as wrong.
const SEEN_THROUGH: u32 = 2;

/// The results of stereo for a scene.
#[derive(Debug)]
pub(super) struct Surfaces {
    /// Its triangles in training space; SH degree 0.
    pub(super) soup: Soup,
    maps: Vec<DepthMap>,
}

impl Surfaces {
    /// Of the photos among `views`; `None` when stereo is off or there are too few. Pictures drawn of a scene
    /// are not used.
    ///
    /// Errors: photos that cannot be decoded.
    pub(super) fn find(
        views: &[&View],
        points: &[Point],
        space: &Space,
        options: &TrainOptions,
    ) -> Result<Option<Self>> {
        let photos: Vec<&View> =
            views.iter().copied().filter(|view| !view.photo.path.as_os_str().is_empty()).collect();
        if !is_wanted(options.stereo, photos.len()) {
            return Ok(None);
        }
        let stereo = StereoOptions {
            stereo_seed: options.seed,
            min_agreeing: MIN_AGREEING,
            min_confidence: MIN_CONFIDENCE,
            ..StereoOptions::default()
        };
        let maps = estimate(&photos, points, &stereo, &mut StageProgress::new(&mut ()))?;
        let most = (SHARE * options.max_triangles as f64) as usize;
        let facets = facets(&maps, most);
        let n = facets.len();
        let soup = Soup {
            vertices: facets.iter().map(|facet| facet.corners.map(|p| space.to_training(p))).collect(),
            // As faint and soft as triangles at points, so that wrong ones can still fade.
            opacity: vec![FIRST_OPACITY; n],
            sigma: vec![FIRST_SIGMA; n],
            sh: facets.iter().map(|facet| facet.rgb.map(|c| sh0_from_rgb(f32::from(c) / 255.0))).collect(),
            sh_degree: 0,
            ..Soup::default()
        };
        Ok(Some(Self { soup, maps }))
    }

    /// Whether no depth map shows the surface at a point of the world, and the point does not hide surfaces
    /// of the maps.
    pub(super) fn misses(&self, point: Vec3) -> bool {
        let (mut same, mut through) = (0, 0);
        for map in &self.maps {
            let Some((pixel, depth)) = map.pixel(point) else { continue };
            let seen = map.depth[pixel];
            same += u32::from((seen - depth).abs() < IN_SURFACE * depth);
            through += u32::from(seen > (1.0 + IN_SURFACE) * depth);
        }
        same == 0 && through < SEEN_THROUGH
    }
}

fn is_wanted(stereo: StereoUse, photos: usize) -> bool {
    match stereo {
        StereoUse::Auto | StereoUse::Off => false,
        StereoUse::On => photos >= LEAST_PHOTOS,
    }
}
