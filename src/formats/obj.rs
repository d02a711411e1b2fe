//! Wavefront OBJ with vertex colours.
