//! `bake`: what the main job costs, next to the floor and to other tools, in one run.
//!
//! Every case is a whole process. The *floor* reads the same input and writes as many bytes as the
//! bake's output with plain buffered I/O: no converter can be cheaper. The cases run in turn, round
//! by round, so that a machine that slows down slows all of them; the median of the rounds is kept.

use super::machine::{self, Usage, print_json};
use serde::Serialize;
use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use trisplat_formats::ply;
use trisplat_scene::{Error, Provenance, Result, ranges};

/// Measurement of bakes.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct BakeBenchArgs {
    /// Numbers of triangles; every case runs at each.
    #[arg(long, value_delimiter = ',', default_value = "10000,100000,1000000", value_name = "N,N,…",
          value_parser = ranges::count)]
    triangles: Vec<usize>,
    /// Runs of every case; the median is kept.
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = ranges::count)]
    runs: usize,
    /// Print rows as JSON.
    #[arg(long)]
    json: bool,
    /// The program to measure [default: the one beside this program].
    #[arg(long, value_name = "PROGRAM")]
    trisplat: Option<PathBuf>,
    /// Python with trimesh, to measure that too.
    #[arg(long, value_name = "PROGRAM")]
    python: Option<PathBuf>,
    /// Folder of node_modules/.bin with gltfpack or gltf-transform, to measure those too.
    #[arg(long, value_name = "FOLDER")]
    node_bin: Option<PathBuf>,
}

/// One case at one size.
#[derive(Debug, Serialize)]
struct BakeRow {
    /// Measured program: "fast", "default", "small", "mesh-ply", "floor", "trimesh".
    case: &'static str,
    /// Triangles of the input.
    triangles: usize,
    /// Bytes written.
    output_bytes: u64,
    /// Medians over the runs.
    #[serde(flatten)]
    usage: Usage,
    /// CPU time over that of the floor.
    cpu_over_floor: f64,
}

/// A command line to measure.
struct BakeCase {
    name: &'static str,
    command: Vec<OsString>,
    output: PathBuf,
}

/// Measures every size and prints rows in order of size, then case.
pub(crate) fn run(args: &BakeBenchArgs) -> Result<()> {
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let mut rows = Vec::new();
    eprintln!("triangles   case             cpu s    wall s   peak MB   out MB   cpu/floor");
    for &triangles in &args.triangles {
        let cases = cases(args, folder.path(), triangles)?;
        let measured = measure_in_turn(&cases, args.runs)?;
        let floor = cases.iter().zip(&measured).find(|(case, _)| case.name == "floor");
        let floor = floor.map_or(f64::NAN, |(_, usage)| usage.cpu_seconds);
        for (case, usage) in cases.iter().zip(&measured) {
            let row = BakeRow {
                case: case.name,
                triangles,
                output_bytes: bytes(&case.output),
                usage: *usage,
                cpu_over_floor: usage.cpu_seconds / floor,
            };
            eprintln!(
                "{triangles:>9}   {:<15}{:>8.3}{:>10.3}{:>10.1}{:>9.1}{:>10.2}",
                row.case,
                usage.cpu_seconds,
                usage.wall_seconds,
                usage.peak_bytes as f64 * 1e-6,
                row.output_bytes as f64 * 1e-6,
                row.cpu_over_floor,
            );
            rows.push(row);
        }
    }
    if args.json { print_json(&rows) } else { Ok(()) }
}

/// Writes the input of one size and lists the command lines: ours, the floor, and other tools on
/// our outputs.
fn cases(args: &BakeBenchArgs, folder: &Path, triangles: usize) -> Result<Vec<BakeCase>> {
    let this = std::env::current_exe().map_err(|e| Error::io("trisplat-bench", e))?;
    let beside = this.with_file_name(format!("trisplat{}", std::env::consts::EXE_SUFFIX));
    let trisplat = args.trisplat.clone().unwrap_or(beside);
    if !trisplat.is_file() {
        let wants = "the program; `cargo build --release` makes it";
        return Err(Error::invalid("--trisplat", trisplat.display(), wants));
    }
    write_input(&folder.join("soup.ply"), triangles)?;
    let mut cases = Vec::new();
    let mut case = |name, program: &Path, input: &str, output: &str, words: &[&str]| {
        let input = folder.join(input);
        let output = folder.join(output);
        let mut command = vec![program.as_os_str().to_owned()];
        command.extend(words.iter().map(|word| match *word {
            "IN" => input.clone().into_os_string(),
            "OUT" => output.clone().into_os_string(),
            "LIKE" => folder.join("fast.glb").into_os_string(),
            word => word.into(),
        }));
        cases.push(BakeCase { name, command, output });
    };
    // Other tools convert: pictures of the soft scene would be work that they do not do. Preset
    // fast draws none.
    for (name, output, flags) in [
        ("fast", "fast.glb", &["--preset", "fast"][..]),
        ("default", "default.glb", &["--teacher", "off"]),
        ("small", "small.glb", &["--teacher", "off", "--preset", "small", "--target", "web"]),
        ("mesh-ply", "mesh.ply", &["--preset", "fast"]),
    ] {
        let bake = ["bake", "-q", "--force", "IN", "-o", "OUT"];
        case(name, &trisplat, "soup.ply", output, &[&bake[..], flags].concat());
    }
    case("floor", &this, "soup.ply", "floor.bin", &["floor", "IN", "LIKE", "OUT"]);
    if let Some(python) = &args.python {
        let script =
            "import sys,trimesh; trimesh.load(sys.argv[1],process=False).export(sys.argv[2])";
        case("trimesh", python, "mesh.ply", "trimesh.glb", &["-c", script, "IN", "OUT"]);
    }
    if let Some(bin) = &args.node_bin {
        let gltfpack = ["-noq", "-i", "IN", "-o", "OUT"];
        case("gltfpack", &bin.join("gltfpack"), "fast.glb", "gltfpack.glb", &gltfpack);
        let transform = bin.join("gltf-transform");
        case("gltf-transform", &transform, "fast.glb", "transform.glb", &["copy", "IN", "OUT"]);
    }
    Ok(cases)
}

/// Writes the sample scene.
fn write_input(path: &Path, triangles: usize) -> Result<()> {
    let mut bytes = Vec::new();
    let written = ply::write_soup(
        &mut bytes,
        &trisplat_synthetic::soups::studio(triangles, 1),
        &Provenance::default(),
        &[],
    );
    written.and_then(|()| std::fs::write(path, bytes)).map_err(|e| Error::io(path, e))
}

/// Run 1 of every case, then run 2 of every case, …; medians. One warm-up round is not counted: it
/// also makes the outputs that the floor and other tools need.
fn measure_in_turn(cases: &[BakeCase], runs: usize) -> Result<Vec<Usage>> {
    let mut all = vec![Vec::new(); cases.len()];
    for round in 0..=runs {
        for (case, usages) in cases.iter().zip(&mut all) {
            let usage = machine::measure(&case.command)?;
            if round > 0 {
                usages.push(usage);
            }
        }
    }
    Ok(all.into_iter().map(|usages| median(&usages)).collect())
}

fn median(usages: &[Usage]) -> Usage {
    let middle = |of: fn(&Usage) -> f64| {
        let mut values: Vec<f64> = usages.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    Usage {
        wall_seconds: middle(|u| u.wall_seconds),
        cpu_seconds: middle(|u| u.cpu_seconds),
        peak_bytes: usages.iter().map(|u| u.peak_bytes).max().unwrap_or(0),
    }
}

fn bytes(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |m| m.len())
}

/// The floor: reads all of `input` and writes as many bytes as `like` has to `output`.
pub(crate) fn floor(input: &Path, like: &Path, output: &Path) -> Result<()> {
    let mut block = vec![0u8; 1 << 20];
    let mut file = std::fs::File::open(input).map_err(|e| Error::io(input, e))?;
    while file.read(&mut block).map_err(|e| Error::io(input, e))? > 0 {}
    let mut out = std::fs::File::create(output).map_err(|e| Error::io(output, e))?;
    let mut left = bytes(like);
    while left > 0 {
        let part = left.min(block.len() as u64);
        out.write_all(&block[..part as usize]).map_err(|e| Error::io(output, e))?;
        left -= part;
    }
    Ok(())
}
