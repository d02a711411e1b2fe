//! The `prune` of the bake.
