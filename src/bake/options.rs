//! The `options` of the bake.
