//! The `bvh` of the bake.
