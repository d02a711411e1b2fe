//! The BVH sidecar file.
