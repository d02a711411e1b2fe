//! The paper's formulas: pure functions, no buffers, no I/O.

pub mod adam;
pub mod clip;
pub mod composite;
pub mod loss;
pub mod normal;
pub mod sh;
pub mod splat;
pub mod wgsl;
pub mod window;
