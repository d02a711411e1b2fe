//! PLY: our soup PLY, and vertex-coloured triangle meshes.
