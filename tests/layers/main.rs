//! No files of a crate import each other in a circle; between crates the compiler sees to it.

mod graph;
mod source;

use graph::{Edges, Graph, circles, name};
use std::path::{Path, PathBuf};

/// The source folders of all crates.
fn sources() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let crates = std::fs::read_dir(root.join("crates")).expect("the crates of the workspace");
    let mut sources: Vec<PathBuf> = crates.map(|entry| entry.unwrap().path().join("src")).collect();
    sources.push(root.join("src"));
    sources.sort();
    sources
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let mut report = String::new();
    for src in sources() {
        let edges: Edges = Graph::read(&src).edges();
        for group in circles(&edges) {
            let files = group.iter().map(name).collect::<Vec<_>>().join(", ");
            report += &format!("{}: {} files: {files}\n", src.display(), group.len());
            let within = edges.iter().filter(|((from, to), _)| group.contains(from) && group.contains(to));
            for ((from, to), paths) in within {
                let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
                report += &format!("    {} → {}: {}\n", name(from), name(to), paths.join(", "));
            }
        }
    }
    assert!(report.is_empty(), "files import each other:\n{report}");
}
