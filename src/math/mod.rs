//! Numbers: knows no triangle.

pub mod color;
