//! Scenes in blocks: what a task may change, what it may not, and that blocks make one scene again.

mod city;
mod parts;
