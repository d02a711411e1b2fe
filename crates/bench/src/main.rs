//! Measures what trisplat costs and how exact it is, and makes samples: `cargo run --release -p
//! trisplat-bench -- --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    trisplat_bench::cli::main()
}
