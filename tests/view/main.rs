//! Drawing on a graphics card: pictures, and the window.

#![cfg(feature = "gpu")]
#![allow(clippy::print_stderr, reason = "a test that cannot judge says so")]

mod card;
#[cfg(feature = "view")]
mod window;
