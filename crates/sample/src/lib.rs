//! Synthetic scenes for trials: `trisplat sample`.
//!
//! In: a seed. Out: a data set, a soup or a town.

mod degenerate;
pub mod scenes;
mod studio;
mod town;
pub mod town_photos;
