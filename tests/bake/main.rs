//! The stages of the bake: each by itself, each on every hostile soup, and what they promise together.

mod chunks;
mod closed_form;
mod hierarchy;
mod hostile;
mod stages;
mod sturdy;
