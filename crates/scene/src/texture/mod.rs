//! Textures of triangles: pictures, and the places of triangles on them.

mod excerpt;
mod faces;
mod joined;
mod picture;

pub use faces::FaceTexture;
pub use picture::{StoredPicture, Texture};
