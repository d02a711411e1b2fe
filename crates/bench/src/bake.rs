//! `bake`: what the main job costs, next to the floor and to other tools, in one run.
//!
//! Every case is a whole process. The *floor* reads the same input and writes as many bytes as the
//! bake's output with plain buffered I/O: no converter can be cheaper. The cases run in turn, round by
//! round, so that a machine that slows down slows all of them; the median of the rounds is kept.

use super::cli::print_json;
use super::machine::{self, Usage};
use super::scenes;
use serde::Serialize;
use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use trisplat_formats::ply;
use trisplat_scene::{Error, Provenance, Result, Soup, ranges};

/// What to measure.
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
    /// What ran: "fast", "default", "default+bvh", "floor", "trimesh".
    case: String,
    /// Triangles of the input.
    triangles: usize,
    /// Bytes read.
    input_bytes: u64,
    /// Bytes written.
    output_bytes: u64,
    /// Medians over the runs.
    #[serde(flatten)]
    usage: Usage,
    /// CPU time over that of the floor of the same input.
    cpu_over_floor: f64,
}

/// A command line to measure.
struct BakeCase {
    name: String,
    command: Vec<OsString>,
    input: PathBuf,
    output: PathBuf,
    /// The floor that it is compared with.
    floor: &'static str,
}

/// Measures every size and prints rows in order of size, then case.
pub(crate) fn run(args: &BakeBenchArgs) -> Result<()> {
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let mut rows = Vec::new();
    eprintln!("triangles   case             cpu s    wall s   peak MB   out MB   cpu/floor");
    for &triangles in &args.triangles {
        let cases = cases(args, folder.path(), triangles)?;
        let measured = measure_in_turn(&cases, args.runs)?;
        let cpu_of = |name: &str| {
            cases.iter().zip(&measured).find(|(c, _)| c.name == name).map_or(f64::NAN, |(_, u)| u.cpu_seconds)
        };
        for (case, usage) in cases.iter().zip(&measured) {
            let row = BakeRow {
                case: case.name.clone(),
                triangles,
                input_bytes: bytes(&case.input),
                output_bytes: bytes(&case.output),
                usage: *usage,
                cpu_over_floor: usage.cpu_seconds / cpu_of(case.floor),
            };
            eprintln!(
                "{:>9}   {:<15}{:>8.3}{:>10.3}{:>10.1}{:>9.1}{:>10.2}",
                row.triangles,
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

/// The program that is measured.
fn trisplat(args: &BakeBenchArgs, this: &Path) -> Result<PathBuf> {
    let name = format!("trisplat{}", std::env::consts::EXE_SUFFIX);
    let program = args.trisplat.clone().unwrap_or_else(|| this.with_file_name(name));
    if !program.is_file() {
        return Err(Error::invalid(
            "--trisplat",
            program.display(),
            "the program; `cargo build --release` makes it",
        ));
    }
    Ok(program)
}

/// Writes the inputs of one size and lists the command lines.
fn cases(args: &BakeBenchArgs, folder: &Path, triangles: usize) -> Result<Vec<BakeCase>> {
    let this = std::env::current_exe().map_err(|e| Error::io("trisplat-bench", e))?;
    let program = trisplat(args, &this)?;
    let at = |name: &str| folder.join(name);
    let (sh0, sh3) = (at("sh0.ply"), at("sh3.ply"));
    write_inputs(&sh0, &sh3, triangles)?;

    let bake = |name: &str, input: &Path, output: &str, floor, flags: &[&str]| {
        let output = at(output);
        let mut command: Vec<OsString> =
            vec![program.clone().into(), "bake".into(), "-q".into(), "--force".into()];
        command.extend([input.into(), "-o".into(), output.clone().into()]);
        command.extend(flags.iter().map(OsString::from));
        BakeCase { name: name.to_owned(), command, input: input.to_owned(), output, floor }
    };
    let floor = |name: &'static str, input: &Path, like: &str| {
        let output = at("floor.bin");
        let words = [this.as_os_str(), "floor".as_ref(), input.as_ref()];
        let files = [at(like).into_os_string(), output.clone().into_os_string()];
        let command = words.into_iter().map(OsString::from).chain(files).collect();
        BakeCase { name: name.to_owned(), command, input: input.to_owned(), output, floor: name }
    };
    // Other tools convert: pictures of the soft scene would be work that they do not do. Preset fast draws none.
    let convert = ["--teacher", "off"];
    let mut cases = vec![
        bake("fast", &sh0, "fast.glb", "floor", &["--preset", "fast"]),
        floor("floor", &sh0, "fast.glb"),
        bake("default", &sh0, "default.glb", "floor", &convert),
        bake("default+bvh", &sh0, "bvh.glb", "floor", &[&convert[..], &["--set", "bvh=true"]].concat()),
        bake(
            "small",
            &sh0,
            "small.glb",
            "floor",
            &[&convert[..], &["--preset", "small", "--target", "web"]].concat(),
        ),
        bake("fast-sh3", &sh3, "sh3.glb", "floor-sh3", &["--preset", "fast"]),
        floor("floor-sh3", &sh3, "sh3.glb"),
        bake("mesh-ply", &sh0, "mesh.ply", "floor", &["--preset", "fast"]),
    ];
    cases.extend(other_tools(args, folder));
    Ok(cases)
}

/// The same work by other tools, on the outputs of our own cases.
fn other_tools(args: &BakeBenchArgs, folder: &Path) -> Vec<BakeCase> {
    let mut cases = Vec::new();
    let mut case = |name: &str, input: &str, program: PathBuf, words: &[&str]| {
        let (input, output) = (folder.join(input), folder.join(name).with_extension("glb"));
        let mut command = vec![program.into_os_string()];
        command.extend(words.iter().map(|word| match *word {
            "IN" => input.clone().into_os_string(),
            "OUT" => output.clone().into_os_string(),
            word => word.into(),
        }));
        cases.push(BakeCase { name: name.to_owned(), command, input, output, floor: "floor" });
    };
    if let Some(python) = &args.python {
        let script = "import sys,trimesh; trimesh.load(sys.argv[1],process=False).export(sys.argv[2])";
        case("trimesh", "mesh.ply", python.clone(), &["-c", script, "IN", "OUT"]);
    }
    if let Some(bin) = &args.node_bin {
        case("gltfpack", "fast.glb", bin.join("gltfpack"), &["-noq", "-i", "IN", "-o", "OUT"]);
        case("gltf-transform", "fast.glb", bin.join("gltf-transform"), &["copy", "IN", "OUT"]);
    }
    cases
}

/// The same scene as SH degree 0 and as degree 3 (45 coefficients that the bake does not use).
fn write_inputs(sh0: &Path, sh3: &Path, triangles: usize) -> Result<()> {
    let mut soup = scenes::studio(triangles, 1);
    let provenance = Provenance::default();
    let write = |path: &Path, soup: &Soup| {
        let mut bytes = Vec::new();
        let written = ply::write_soup(&mut bytes, soup, &provenance, &[]);
        written.and_then(|()| std::fs::write(path, bytes)).map_err(|e| Error::io(path, e))
    };
    write(sh0, &soup)?;
    scenes::raise_sh(&mut soup, 3, 1);
    write(sh3, &soup)
}

/// Run 1 of every case, then run 2 of every case, …; medians. One warm-up round is not counted: it
/// also makes the outputs that floors and other tools need.
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
