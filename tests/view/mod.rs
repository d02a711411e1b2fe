//! Drawing on a graphics card: pictures, and the window.

#![cfg(feature = "gpu")]
#![allow(clippy::print_stderr, reason = "a test that cannot judge says so")]

mod card;
#[cfg(all(feature = "view", unix))]
mod drag;
mod texture;
#[cfg(all(feature = "view", unix))]
mod window;
