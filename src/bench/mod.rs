//! Measures cost, stability and fidelity.

mod degenerate;
pub mod scenes;
mod studio;
