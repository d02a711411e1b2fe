//! The program as a user meets it, and whatever the disk does to it.

mod cli;
mod faults;
#[path = "common/folders.rs"]
mod folders;
#[path = "common/night.rs"]
mod night;
#[allow(dead_code)]
#[path = "common/phone.rs"]
mod phone;
#[path = "common/samples.rs"]
mod samples;
#[path = "common/skip.rs"]
mod skip;
