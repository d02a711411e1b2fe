//! What is wanted of an element's rows.

/// What is wanted of an element's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Nothing, except the end of the rows.
    Nothing,
    /// All single numbers, and faces with three corners: any other face is an error.
    Triangles,
    /// All single numbers, and faces with any number of corners.
    Polygons,
}
