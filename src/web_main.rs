//! The program for pages and scripts (`web/`), built for WebAssembly.

use std::process::ExitCode;
use trisplat_scene::process::memory::Allocator;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() -> ExitCode {
    trisplat::web::main()
}
