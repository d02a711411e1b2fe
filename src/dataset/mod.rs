//! Posed photos in.
