//! Drawing on a graphics card: pictures, and the window.

#![cfg(feature = "gpu")]

mod card;
#[cfg(feature = "view")]
mod window;
