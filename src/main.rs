//! The command line: parse, run one command, print the error chain, pick the exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    trisplat::cli::main()
}
