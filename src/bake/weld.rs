//! The `weld` of the bake.
