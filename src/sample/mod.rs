//! Synthetic scenes for trials: `trisplat sample`.

mod degenerate;
pub mod scenes;
mod studio;
#[cfg(feature = "bench")]
pub mod town;
#[cfg(feature = "bench")]
pub mod town_photos;
