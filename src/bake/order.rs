//! The `order` of the bake.
