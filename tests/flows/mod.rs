//! Whole runs through the library: photos or scenes in, trained and baked scenes out.

mod far;
mod hardening;
mod mesh_photos;
mod train_from_scene;
mod transparent;
