//! Looking at scenes: cameras that go around them, pictures of what is not colour.

pub mod orbit;
pub mod show;
