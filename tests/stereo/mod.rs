//! Depths from photos, against the exact depths of the synthetic scene.

mod synthetic;
