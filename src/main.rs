//! The command line: parse, run one command, print the error chain, pick the exit code.

use std::process::ExitCode;
use trisplat_scene::process::memory::Allocator;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() -> ExitCode {
    trisplat::cli::main()
}
