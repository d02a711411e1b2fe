//! What needs a graphics card, or one in software: training on it, pictures, the window.

#[path = "common/samples.rs"]
mod samples;
#[path = "common/skip.rs"]
mod skip;
mod train_gpu;
mod view;
