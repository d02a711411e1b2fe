//! A connected, coloured surface in place of triangles that overlap: something to walk on and to
//! collide with.
//!
//! ```text
//! scene + cameras ──► depth pictures ──┬► signed distances on a sparse lattice ──► surface nets ──► components ──► fill ──► smooth ──► simplify ──► Mesh
//!   photos' depth maps ────────────────┘
//! ```
//!
//! As in the supplement of Held et al. 2025 (mesh extraction from depth maps, after 2D Gaussian
//! Splatting): the median depth of what each camera sees is fused into a truncated signed distance
//! field (Curless and Levoy 1996), whose zero is the surface. Where photos agree on a depth, this
//! takes the place of the drawn one; without texture drawn ones become planes. What no camera has
//! observed has no surface, unless this closes a hole; what cameras look through stays open.
//!
//! Surface nets are our own, as the crates there are take a dense box of known samples: they would
//! invent a surface around what is unobserved, and double the vertices where the blocks of a sparse
//! lattice meet.
//!
//! In: a scene. Out: a connected mesh, for the eye or to collide with.

mod collapse;
mod collider;
mod connected;
mod extend;
mod extract;
mod fill;
mod flatten;
mod fuse;
mod grid;
mod measured;
mod nets;
mod options;
mod picture;
mod simplify;
mod smooth;

pub use collapse::{Collapsed, EdgeCollapse};
pub use connected::{connected_faces, connected_parts};
pub use extract::{
    CollisionDetails, CollisionOptions, Observations, SurfacePart, collision, surface,
    surface_of_part,
};
pub use options::{SurfaceDetails, SurfaceOptions};
