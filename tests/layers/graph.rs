//! Which file of `src` imports which.

use crate::source::{Path, Source};
use std::collections::{BTreeMap, BTreeSet};

/// A file by the module it is: `["raster", "soft"]`; the crate's root is empty.
pub(super) type Module = Vec<String>;

/// Imports between files: who, whom, and the paths that say so.
pub(super) type Edges = BTreeMap<(Module, Module), BTreeSet<String>>;

/// The files of a crate.
#[derive(Default)]
pub(super) struct Graph {
    files: BTreeMap<Module, Source>,
}

impl Graph {
    /// Reads every Rust file under `src`.
    pub(super) fn read(src: &std::path::Path) -> Self {
        let mut graph = Self::default();
        for file in rust_files(src) {
            let relative = file.strip_prefix(src).unwrap().with_extension("");
            let mut module: Module = relative
                .components()
                .map(|c| c.as_os_str().to_string_lossy().into_owned())
                .collect();
            if module.last().is_some_and(|name| name == "mod") || module == ["lib"] {
                module.pop();
            }
            let text = std::fs::read_to_string(&file).unwrap();
            // Programs are crates of their own and name the library by its name.
            let is_program = module == ["main"] || module == ["web_main"];
            let text = if is_program { text.replace("trisplat::", "crate::") } else { text };
            graph.add(module, &text);
        }
        graph
    }

    /// Adds one file.
    pub(super) fn add(&mut self, module: Module, text: &str) {
        self.files.insert(module, Source::parse(text));
    }

    /// Every import of one file by another; re-exports are followed to the file that defines what
    /// they name.
    pub(super) fn edges(&self) -> Edges {
        let mut edges = Edges::new();
        for (module, source) in &self.files {
            for path in &source.paths {
                let owner = self.owner(module, path, 0);
                if owner != *module {
                    edges.entry((module.clone(), owner)).or_default().insert(path.join("::"));
                }
            }
        }
        edges
    }

    /// The file that owns what `path` names, seen from `module`.
    fn owner(&self, module: &Module, path: &Path, depth: usize) -> Module {
        let mut at = module.clone();
        let mut rest = path.iter();
        let mut item = None;
        for name in rest.by_ref() {
            let child = [at.clone(), vec![name.clone()]].concat();
            match name.as_str() {
                "crate" => at.clear(),
                "self" => {}
                "super" => drop(at.pop()),
                _ if self.files.contains_key(&child) => at = child,
                _ => {
                    item = Some(name);
                    break;
                }
            }
        }
        // A module written out in a file belongs to that file.
        while !self.files.contains_key(&at) {
            at.pop();
        }
        let Some((item, source)) = item.zip(self.files.get(&at)) else { return at };
        if depth > 8 || source.defines.contains(item) {
            return at;
        }
        let named = source.exports.iter().find(|(name, _)| name == item);
        if let Some((_, path)) = named {
            return self.owner(&at, path, depth + 1);
        }
        for (_, path) in source.exports.iter().filter(|(name, _)| name == "*") {
            let owner = self.owner(&at, path, depth + 1);
            if self.files.get(&owner).is_some_and(|source| source.defines.contains(item)) {
                return owner;
            }
        }
        at
    }
}

/// Groups of files that import each other, directly or through others; each sorted, the largest
/// first.
pub(super) fn circles(edges: &Edges) -> Vec<Vec<Module>> {
    let mut after: BTreeMap<&Module, Vec<&Module>> = BTreeMap::new();
    edges.keys().for_each(|(from, to)| after.entry(from).or_default().push(to));
    let reached = |from| {
        let mut seen = BTreeSet::new();
        let mut open = vec![from];
        while let Some(module) = open.pop() {
            open.extend(
                after.get(module).into_iter().flatten().copied().filter(|next| seen.insert(*next)),
            );
        }
        seen
    };
    let reach: BTreeMap<&Module, BTreeSet<&Module>> =
        after.keys().map(|from| (*from, reached(*from))).collect();
    let mut groups: Vec<Vec<Module>> = Vec::new();
    for (module, seen) in reach.iter().filter(|(module, seen)| seen.contains(**module)) {
        if groups.iter().flatten().any(|grouped| grouped == *module) {
            continue;
        }
        let together = seen
            .iter()
            .filter(|other| reach.get(**other).is_some_and(|back| back.contains(*module)));
        groups.push(together.map(|other| (*other).clone()).collect());
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    groups
}

/// "raster/soft.rs", or "lib".
pub(super) fn name(module: &Module) -> String {
    if module.is_empty() { "lib".to_owned() } else { module.join("/") }
}

fn rust_files(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(files: &[(&str, &str)]) -> Graph {
        let mut graph = Graph::default();
        for (module, text) in files {
            graph.add(
                module.split('/').filter(|s| !s.is_empty()).map(str::to_owned).collect(),
                text,
            );
        }
        graph
    }

    #[test]
    fn circles_are_found_through_re_exports() {
        let files = [
            ("", "pub mod a;"),
            ("a", "mod b; mod c; pub use b::B;"),
            ("a/b", "use super::c::C; pub struct B;"),
            ("a/c", "fn f(b: super::B) {} pub struct C;"),
        ];
        let found = circles(&graph(&files).edges());
        assert_eq!(found.iter().flatten().map(name).collect::<Vec<_>>(), ["a/b", "a/c"]);
    }

    #[test]
    fn a_parent_that_calls_a_child_which_needs_it_is_a_circle() {
        let files = [
            ("a", "mod b; fn f() { b::g(); } pub struct A;"),
            ("a/b", "use super::A; pub fn g() {}"),
        ];
        assert_eq!(circles(&graph(&files).edges()).len(), 1);
        let files =
            [("a", "pub mod b; pub use b::g;"), ("a/b", "use crate::a::g as other; pub fn g() {}")];
        assert_eq!(circles(&graph(&files).edges()), Vec::<Vec<Module>>::new());
    }
}
