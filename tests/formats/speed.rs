//! Time of the readers and writers against plain reading and writing of the same bytes.
//! `cargo test --release --test files -- --ignored --nocapture speed` prints a table; it checks nothing,
//! because time on a shared machine proves nothing.

use super::files::{mesh, provenance, soup};
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::Path;
use std::time::Instant;
use trisplat_formats::{ReadOptions, Source, obj, off, ply};
use trisplat_scene::{Asset, process::cpu_secs};

/// The least CPU and wall seconds of seven runs.
fn measure<T>(name: &str, run: impl Fn() -> T) {
    let mut best = [f64::INFINITY; 2];
    for _ in 0..7 {
        let (wall, before) = (Instant::now(), cpu_secs());
        let value = run();
        let spent = [cpu_secs() - before, wall.elapsed().as_secs_f64()];
        drop(value);
        best = [best[0].min(spent[0]), best[1].min(spent[1])];
    }
    eprintln!("{name:42} cpu {:7.1} ms   wall {:7.1} ms", best[0] * 1e3, best[1] * 1e3);
}

fn open(path: &Path) -> Source {
    Source::open(path, &trisplat::Limits::DEFAULT).expect("readable")
}

/// Through a buffer that is used again: what a reader cannot avoid.
fn read_only(path: &Path) -> usize {
    let (mut file, mut buffer, mut sum) = (File::open(path).expect("opens"), vec![0; 1 << 20], 0);
    loop {
        match file.read(&mut buffer).expect("reads") {
            0 => return sum,
            n => sum += n,
        }
    }
}

fn create(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) {
    let mut out = BufWriter::with_capacity(1 << 20, File::create(path).expect("creates"));
    write(&mut out).and_then(|()| out.flush()).expect("writes");
}

#[test]
#[ignore = "measures"]
fn speed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let count = 1_000_000;
    for degree in [0, 3] {
        let file = path("soup.ply");
        let soup = soup(count, degree, 1);
        create(&file, |out| ply::write_soup(out, &soup, &provenance(), &[]));
        let bytes = std::fs::read(&file).expect("reads");
        eprintln!("1M soup, SH {degree}: {:.1} MB", bytes.len() as f64 / 1e6);
        measure("  write_soup to a file", || {
            create(&file, |out| ply::write_soup(out, &soup, &provenance(), &[]))
        });
        measure("  plain write of its bytes", || create(&file, |out| out.write_all(&bytes)));
        drop(bytes);
        measure("  plain read, one buffer", || read_only(&file));
        measure("  plain read, kept (std::fs::read)", || std::fs::read(&file));
        for sh_degree in if degree == 0 { vec![0] } else { vec![0, 3] } {
            let options = ReadOptions::with_degree(sh_degree);
            measure(&format!("  ply::read, SH {sh_degree}"), || {
                ply::read(open(&file), &options).expect("valid")
            });
        }
        measure("  validate", || soup.validate().is_ok());
    }
    let asset = Asset { mesh: mesh(count, false, false, false), ..Asset::default() };
    let options = ReadOptions::with_degree(0);
    let file = path("mesh.ply");
    measure("mesh ply write", || create(&file, |out| ply::write_mesh(out, &asset, false)));
    measure("  plain read, kept", || std::fs::read(&file));
    measure("mesh ply read", || ply::read(open(&file), &options).expect("valid"));
    let file = path("mesh.obj");
    measure("obj write", || create(&file, |out| obj::write(out, &mut Vec::new(), "a.mtl", None, &asset)));
    let mut between = asset.clone();
    if let trisplat_scene::mesh::Colors::Vertex(colors) = &mut between.mesh.colors {
        colors.iter_mut().flatten().for_each(|x| *x = (*x * 0.99).max(0.001));
    }
    measure("obj write, colors between codes", || {
        create(&path("b.obj"), |out| obj::write(out, &mut Vec::new(), "a.mtl", None, &between))
    });
    measure("  plain read, kept", || std::fs::read(&file));
    measure("obj read", || obj::read(open(&file), &options).expect("valid"));
    measure("obj read by tobj", || tobj::load_obj(&file, &tobj::LoadOptions::default()).expect("valid"));
    let file = path("mesh.off");
    create(&file, |out| {
        writeln!(out, "COFF\n{} {count} 0", 3 * count)?;
        asset.mesh.positions.iter().try_for_each(|v| writeln!(out, "{} {} {}", v.x, v.y, v.z))?;
        (0..count).try_for_each(|f| writeln!(out, "3 {} {} {} 1 128 255 255", 3 * f, 3 * f + 1, 3 * f + 2))
    });
    measure("off read", || off::read(open(&file), &options).expect("valid"));
}
