//! What needs a graphics card, or one in software: training on it, pictures, the window.

mod train_gpu;
mod view;
