//! Drawing on a graphics card: its pictures against a ray caster.

#![cfg(feature = "gpu")]

mod card;
mod texture;
