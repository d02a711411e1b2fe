//! The `target` of the bake.
