//! A soft scene teaches a solid one: pictures of it, drawn as it was trained, replace photos.
//!
//! They are drawn from the cameras that the scene stores and from between them. For a scene without
//! cameras viewpoints are chosen: around an object, or within a room.
//!
//! In: a soft scene, or Gaussians. Out: viewpoints around and inside it, and pictures from there.

mod drawing;
mod gaussians;
mod splat_views;
mod survey;
mod viewpoints;

pub use drawing::{
    ObjectBackground, Teacher, dataset, dataset_of_pictures, with_pictures_of, with_soft_pictures,
};
pub use gaussians::GaussianTeacher;
pub use viewpoints::{ViewpointKind, Viewpoints, between};
