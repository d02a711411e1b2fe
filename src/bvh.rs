//! The bounding volume hierarchy over an asset's faces (built by obvhs).

/// Placeholder: the builder, the permutation and the queries.
#[derive(Debug, Clone, Default)]
pub struct Bvh {}
