//! Readers and writers of PLY, OFF and OBJ: round trips, odd but legal files, real files, bad input.

mod files;
mod mesh_ply;
mod soup_ply;
