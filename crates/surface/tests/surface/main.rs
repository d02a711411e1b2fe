//! Connected surfaces: of shapes that are known exactly, of the trained sample, and as something to
//! collide with.
#![allow(clippy::print_stdout, reason = "measured figures are for people")]

mod chamfer;
mod closed_form;
mod collision;
