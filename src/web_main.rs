//! The program for pages and scripts (`web/`), built for WebAssembly.

use std::process::ExitCode;

fn main() -> ExitCode {
    trisplat::web::main()
}
