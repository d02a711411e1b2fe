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
            let within =
                edges.iter().filter(|((from, to), _)| group.contains(from) && group.contains(to));
            for ((from, to), paths) in within {
                let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
                report += &format!("    {} → {}: {}\n", name(from), name(to), paths.join(", "));
            }
        }
    }
    assert!(report.is_empty(), "files import each other:\n{report}");
}

/// What a crate's manifest imports of the workspace, apart from its tests.
fn imports(manifest: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(manifest).expect("a manifest");
    let mut inside = false;
    let mut names = Vec::new();
    for line in text.lines() {
        if line.starts_with('[') {
            inside = line == "[dependencies]";
        } else if let (true, Some(name)) = (inside, line.strip_prefix("trisplat-")) {
            let end = name.find(['.', ' ']).expect("a dependency has a value");
            names.push(name[..end].to_owned());
        }
    }
    names.sort();
    names
}

#[test]
fn the_table_of_crates_in_the_docs_is_true() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let docs = std::fs::read_to_string(root.join("docs/architecture.md")).expect("the page");
    for entry in std::fs::read_dir(root.join("crates")).expect("the crates of the workspace") {
        let folder = entry.unwrap().path();
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        let row = format!("| `{name}` | {} |", imports(&folder.join("Cargo.toml")).join(" "));
        assert!(docs.contains(&row), "docs/architecture.md has no row that begins with {row}");
    }
}

/// The package of a crate in a registry holds its own folder and nothing beside it.
#[test]
fn a_crate_includes_files_of_its_own_folder_only() {
    let mut files = sources();
    let mut included = 0;
    let mut at = 0;
    while let Some(path) = files.get(at).cloned() {
        at += 1;
        if path.is_dir() {
            files.extend(std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
            continue;
        }
        if path.extension().is_none_or(|extension| extension != "rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        for part in text.split("include_").skip(1).filter(|part| part.starts_with(['s', 'b'])) {
            let Some(name) = part.split('"').nth(1).filter(|_| part.contains("!(\"")) else {
                continue;
            };
            let file = path.parent().unwrap().join(name).canonicalize().expect("an included file");
            let own =
                path.ancestors().find(|folder| folder.ends_with("src")).unwrap().parent().unwrap();
            assert!(
                file.starts_with(own.canonicalize().unwrap()),
                "{} includes {name}",
                path.display()
            );
            included += 1;
        }
    }
    assert!(included > 10, "only {included} files are included");
}

/// The page of constants that decide names none that is gone.
#[test]
fn the_constants_in_the_docs_exist() {
    let mut files = sources();
    let mut code = String::new();
    let mut at = 0;
    while let Some(path) = files.get(at).cloned() {
        at += 1;
        if path.is_dir() {
            files.extend(std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            code += &std::fs::read_to_string(&path).unwrap();
        }
    }
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/accuracy.md");
    let page = std::fs::read_to_string(page).expect("the page");
    let is_constant = |word: &&str| {
        let is_part = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
        word.len() > 2 && word.chars().all(is_part)
    };
    let named: Vec<&str> = page.split('`').skip(1).step_by(2).filter(is_constant).collect();
    assert!(named.len() > 100, "only {} constants", named.len());
    for name in named {
        assert!(
            code.contains(&format!("const {name}:")),
            "docs/accuracy.md names {name}, which is no constant"
        );
    }
}
