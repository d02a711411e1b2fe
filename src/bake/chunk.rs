//! The `chunk` of the bake.
