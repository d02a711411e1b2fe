//! The `solid` of the bake.
