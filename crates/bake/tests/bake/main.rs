//! The stages of the bake: each by itself, each on every hostile soup, and what they promise
//! together.

mod background;
mod chunks;
mod closed_form;
mod collision;
mod connected;
mod exposure;
mod first_view;
mod hostile;
mod levels;
mod lit;
mod pages;
mod photos;
mod raycast;
mod reshape;
mod robustness;
mod sh;
mod shell;
mod sides;
mod sky;
mod stages;
mod subject;
mod teacher;
mod texture;
mod tiles;
