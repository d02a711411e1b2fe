//! Drawing on a graphics card: pictures, and the window.

#![cfg(feature = "gpu")]

mod card;
#[cfg(all(feature = "view", unix))]
mod drag;
mod texture;
#[cfg(all(feature = "view", unix))]
mod window;
