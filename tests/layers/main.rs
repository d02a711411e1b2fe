//! Who may import whom (docs/architecture.md): folders only what the table says, files never in a circle.

mod graph;
mod source;

use graph::{Edges, Graph, circles, name};
use std::collections::BTreeMap;
use std::path::Path;

/// A folder or single file of `src`, and those that it imports from: no others, and each of them.
const MAY: &[(&str, &str)] = &[
    ("error", ""),
    ("atomic", "error"),
    ("limits", "error process"),
    ("guard", "error"),
    ("input", "limits error"),
    ("process", ""),
    ("layered", "error input limits"),
    ("budget", "process"),
    ("report", "error"),
    ("ranges", "error"),
    ("rng", ""),
    ("work", ""),
    ("math", ""),
    ("camera", "error limits"),
    ("image", "atomic error guard input limits"),
    ("exposure", "image math"),
    ("soup", "error math"),
    ("texture", "error image limits math"),
    ("mesh", "error math texture"),
    ("bvh", "mesh error"),
    ("asset", "mesh bvh camera report"),
    ("scene", "soup mesh asset camera error math"),
    ("region", "camera"),
    ("space", "camera math rng soup"),
    ("placed", "asset camera"),
    ("kernel", "math"),
    ("gpu", "error"),
    ("dataset", "formats asset camera image ranges rng error guard math input limits"),
    ("capture", "dataset image atomic process report error input limits"),
    (
        "formats",
        "image texture soup mesh scene bvh asset camera ranges report error guard math atomic input limits",
    ),
    ("raster", "kernel texture soup mesh camera image math error work"),
    ("framing", "raster asset scene mesh camera math"),
    ("teacher", "raster placed math dataset scene soup space camera image error"),
    ("surface", "ranges teacher raster scene soup space mesh camera report error math limits"),
    (
        "train",
        "ranges raster kernel gpu dataset exposure formats asset scene atomic budget process soup mesh space camera image rng report error guard math input limits work",
    ),
    (
        "bake",
        "texture surface ranges framing raster teacher dataset exposure formats soup mesh scene placed bvh asset camera image region rng space report error math limits",
    ),
    (
        "scale",
        "bake ranges train raster dataset formats asset placed scene atomic process soup mesh space camera report error math input limits",
    ),
    (
        "view",
        "texture framing asset region rng mesh soup scene raster camera image gpu placed error math limits",
    ),
    ("render", "asset bake camera dataset error image limits mesh placed raster scene soup space train view"),
    ("eval", "asset bake camera dataset error formats image math render report scene soup train"),
    (
        "job",
        "capture atomic process input limits bake train teacher dataset formats layered asset scene budget report error camera eval framing image placed render rng view",
    ),
    ("sample", "asset atomic camera error formats math mesh raster report rng soup"),
    (
        "bench",
        "asset atomic process bake budget camera dataset error eval formats gpu image job kernel math mesh placed ranges raster render report rng sample scene soup space train view",
    ),
    (
        "cli",
        "capture process asset atomic bake bench budget camera dataset error eval formats gpu guard image job layered math placed region render report sample scale scene surface teacher train view limits",
    ),
    (
        "web",
        "asset atomic bake camera error formats guard input job layered limits placed process render report scene train",
    ),
    ("main", "cli process"),
    ("web_main", "process web"),
    ("lib", ""),
];

fn edges() -> Edges {
    Graph::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src")).edges()
}

#[test]
fn folders_import_what_the_table_says() {
    let top = |module: &graph::Module| module.first().map_or("lib".to_owned(), String::clone);
    let mut imports: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for ((from, to), paths) in edges() {
        if top(&from) != top(&to) {
            let paths = paths.into_iter().map(|path| format!("{} names {path}", name(&from)));
            imports.entry((top(&from), top(&to))).or_default().extend(paths);
        }
    }
    let may =
        |from: &str, to: &str| MAY.iter().any(|(f, list)| *f == from && list.split(' ').any(|t| t == to));
    let mut wrong = Vec::new();
    for ((from, to), paths) in imports.iter().filter(|((from, to), _)| !may(from, to)) {
        wrong.push(format!("{from} may not import {to}: {}", paths.join(", ")));
    }
    for (from, list) in MAY {
        let unused =
            |to: &&str| !to.is_empty() && !imports.contains_key(&((*from).to_owned(), (*to).to_owned()));
        wrong.extend(
            list.split(' ').filter(unused).map(|to| format!("{from} imports nothing of {to}: forbid it")),
        );
    }
    assert!(
        wrong.is_empty(),
        "layers broken:\n{}\nimports as they are:\n{}",
        wrong.join("\n"),
        table(&imports)
    );
}

/// The rows of the table, as the imports would have them.
fn table(imports: &BTreeMap<(String, String), Vec<String>>) -> String {
    let row = |(from, old): &(&str, &str)| {
        let now: Vec<&str> = imports.keys().filter(|(f, _)| f == from).map(|(_, to)| to.as_str()).collect();
        let (stay, new): (Vec<&str>, Vec<&str>) = (
            old.split(' ').filter(|to| now.contains(to)).collect(),
            now.iter().copied().filter(|to| !old.split(' ').any(|o| o == *to)).collect(),
        );
        format!("    (\"{from}\", \"{}\"),\n", [stay, new].concat().join(" "))
    };
    MAY.iter().map(row).collect()
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let edges = edges();
    let mut report = String::new();
    for group in circles(&edges) {
        report +=
            &format!("{} files: {}\n", group.len(), group.iter().map(name).collect::<Vec<_>>().join(", "));
        for ((from, to), paths) in
            edges.iter().filter(|((from, to), _)| group.contains(from) && group.contains(to))
        {
            let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
            report += &format!("    {} → {}: {}\n", name(from), name(to), paths.join(", "));
        }
    }
    assert!(report.is_empty(), "files import each other:\n{report}");
}
