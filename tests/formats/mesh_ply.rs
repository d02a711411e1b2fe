//! Mesh PLY.
