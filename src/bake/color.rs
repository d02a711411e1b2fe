//! The `color` of the bake.
