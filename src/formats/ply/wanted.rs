//! What is wanted of an element's rows.

/// What is wanted of an element's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Only to know where they end.
    Nothing,
    /// All single numbers, and of faces three corners: any other face is an error.
    Triangles,
    /// All single numbers, and faces with any number of corners.
    Polygons,
}
