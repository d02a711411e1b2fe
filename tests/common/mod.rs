//! What several tests share.
#![allow(dead_code)]

pub(crate) mod edits;
pub(crate) mod folders;
mod night;
pub(crate) mod phone;
pub(crate) mod png;
pub(crate) mod regressions;
pub(crate) mod samples;

/// A viewpoint none of whose numbers is a default.
pub(crate) const VIEWPOINT: trisplat_scene::camera::Viewpoint = trisplat_scene::camera::Viewpoint {
    eye: [1.5, 2.0, -3.0],
    target: [0.1, 0.0, 7.0],
    up: [0.0, 1.0, 0.0],
    fov: 48.25,
    radius: Some(1.25),
    orbit: None,
};
