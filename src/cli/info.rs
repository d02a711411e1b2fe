//! `trisplat info FILE`: the content of a file of any format, or of a data set, as a table of names
//! and values or as JSON.

use super::messages::{self, many, thousands};
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use trisplat_dataset::{Dataset, DatasetOptions, Description};
use trisplat_formats::check::{Checked, Severity, check};
use trisplat_formats::info::{BoundingBox, Distribution, Info, SceneKind, Softness, TextureInfo};
use trisplat_formats::{ReadOptions, unzipped_sog};
use trisplat_scene::report::counted;
use trisplat_scene::{Error, Placement, Result};
use trisplat_train::checkpoint::{self, Checkpoint};

/// Maximum number of cameras of a data set listed one by one; others are only counted.
const LISTED: usize = 5;

/// Input to describe.
#[derive(Debug, clap::Args)]
pub struct InfoArgs {
    /// Soup, mesh or Gaussian splats to describe: .ply, .pt, .off, .obj, .glb, .gltf, .splat, .spz
    /// or .sog; "-" is standard input. Or a data set: a folder of posed photos, or its list of
    /// poses, as a transforms.json.
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Print JSON (`trisplat schema info` describes it).
    #[arg(long)]
    pub json: bool,
    /// Reading options of a data set.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// A name and a value.
type Row = (&'static str, String);

/// Describes the file on `out`.
pub fn run(args: &InfoArgs, out: &mut dyn Write) -> Result<()> {
    let how = &args.dataset_options;
    let printed = if is_dataset(&args.input) {
        let description =
            trisplat_dataset::describe(&Dataset::load(&args.input, how)?, &how.limits)?;
        if args.json {
            messages::print_json(&description, out)
        } else {
            print(dataset_rows(&description), out)
        }
    } else if checkpoint::is_checkpoint(&args.input) {
        let summary = CheckpointSummary::of(&args.input, checkpoint::read(&args.input)?);
        if args.json { messages::print_json(&summary, out) } else { print(summary.rows(), out) }
    } else {
        let info = trisplat_job::describe(&args.input, &how.read_options(3))?;
        if args.json {
            messages::print_json(&info, out)
        } else {
            let title =
                format!("{}: {}, {} bytes", info.path, info.format.name(), thousands(info.bytes));
            messages::write(out, &title).and_then(|()| print(scene_rows(&info), out))
        }
    };
    printed.map_err(|e| Error::io("-", e))
}

/// True for a data set: a folder or a list of poses, other than an unzipped SOG.
pub fn is_dataset(path: &Path) -> bool {
    (path.is_dir() || Dataset::is_list(path)) && unzipped_sog(path).is_none()
}

/// The training in a checkpoint of this program.
#[derive(Debug, Serialize)]
struct CheckpointSummary {
    path: String,
    generator: String,
    step: u64,
    steps: u64,
    triangles: u64,
    sh_degree: u8,
    photos: u64,
    cpu_secs: f64,
}

impl CheckpointSummary {
    fn of(path: &Path, Checkpoint { state, meta, .. }: Checkpoint) -> Self {
        Self {
            path: path.display().to_string(),
            generator: meta.generator,
            step: meta.step,
            steps: meta.options.steps,
            triangles: state.params.len() as u64,
            sh_degree: meta.options.sh_degree,
            photos: meta.identity.photos.len() as u64,
            cpu_secs: meta.cpu_secs,
        }
    }

    fn rows(&self) -> Vec<Row> {
        let step = format!("{} of {}", thousands(self.step), thousands(self.steps));
        let kind =
            format!("checkpoint of a training, spherical harmonics of degree {}", self.sh_degree);
        vec![
            ("kind", kind),
            ("step", step),
            ("triangles", thousands(self.triangles)),
            ("photos", thousands(self.photos)),
            ("generator", self.generator.clone()),
            ("time", format!("{:.0} CPU s", self.cpu_secs)),
            ("go on", format!("trisplat train PHOTOS --resume {} -o scene.ply", self.path)),
        ]
    }
}

fn print(rows: Vec<Row>, out: &mut dyn Write) -> io::Result<()> {
    rows.iter().try_for_each(|(name, value)| messages::write(out, &format!("{name:<10} {value}")))
}

fn scene_rows(info: &Info) -> Vec<Row> {
    let are_splats = info.kind == SceneKind::Splats;
    let kind = match (info.kind, info.sh_degree) {
        (SceneKind::Soup, Some(degree)) => format!("soup, spherical harmonics of degree {degree}"),
        (SceneKind::Soup, None) => "soup".to_owned(),
        (SceneKind::Mesh, _) if info.indexed => "mesh with shared vertices".to_owned(),
        (SceneKind::Mesh, _) => "mesh".to_owned(),
        (SceneKind::Splats, degree) => {
            format!("Gaussian splats, spherical harmonics of degree {}", degree.unwrap_or(0))
        }
    };
    let mut rows = vec![("kind", kind)];
    let counts = [
        ("splats", info.splats, are_splats),
        ("triangles", info.triangles, !are_splats),
        ("vertices", info.vertices, !are_splats),
        ("shell", info.shell, info.shell > 0),
        ("cameras", info.cameras, info.cameras > 0),
    ];
    rows.extend(
        counts.into_iter().filter(|(.., is)| *is).map(|(name, count, _)| (name, thousands(count))),
    );
    let corners = |bounds: &BoundingBox| {
        let [min, max] = [bounds.min, bounds.max].map(|p| p.map(|x| format!("{x:.4}")).join(" "));
        format!("{min}  to  {max}")
    };
    rows.push(("bounds", corners(&info.bounds)));
    if let Some(inner) = &info.inner_bounds {
        rows.push(("inner", format!("{} (middle 98%)", corners(inner))));
    }
    rows.extend(origin_rows(info));
    let hex = |c: [f32; 3]| {
        c.map(|x| format!("{:02x}", (x.clamp(0.0, 1.0) * 255.0).round() as u8)).concat()
    };
    let colors = &info.colors;
    let outside = match colors.outside {
        0 => String::new(),
        n => format!("; {} outside 0 to 1", thousands(n)),
    };
    let [mean, min, max] = [colors.mean, colors.min, colors.max].map(hex);
    rows.push(("colors", format!("mean #{mean}, #{min} to #{max}{outside}")));
    if let Some(TextureInfo { size: [width, height], pages, stored }) = &info.texture {
        let stored = stored.as_ref().map_or(String::new(), |stored| {
            format!(", {} of {} bytes", stored.format, thousands(stored.bytes))
        });
        let pages = if *pages > 1 { format!("{pages} pages of up to ") } else { String::new() };
        rows.push(("texture", format!("{pages}{width}x{height} texels{stored}")));
    }
    for (name, spread) in [("opacity", &info.opacity), ("sigma", &info.sigma)] {
        rows.extend(spread.iter().map(|Distribution { min, median, mean, max }| {
            (name, format!("{min:.4} to {max:.4}, mean {mean:.4}, median {median:.4}"))
        }));
    }
    rows.extend((!are_splats).then(|| ("bake", bake_line(info))));
    rows.extend(info.softness.as_ref().map(|softness| ("soft", soft_line(softness))));
    rows.extend(info.warnings.iter().map(|warning| ("warning", warning.clone())));
    rows
}

/// Provenance, and what a glTF document says.
fn origin_rows(info: &Info) -> Vec<Row> {
    let origin = &info.provenance;
    let up = origin.up.and_then(|up| serde_json::to_value(up).ok());
    let unsaid = || match origin.usual_up.and_then(|up| serde_json::to_value(up).ok()) {
        Some(usual) => format!("the file does not say, taken as {}", usual.as_str().unwrap_or("")),
        None => "the file does not say".to_owned(),
    };
    let up = up.as_ref().and_then(|up| up.as_str()).map_or_else(unsaid, str::to_owned);
    let mut rows = vec![("up axis", up)];
    let texts = [
        ("generator", &origin.generator),
        ("trainer", &origin.trainer),
        ("source", &origin.source),
    ];
    rows.extend(texts.into_iter().filter_map(|(name, text)| Some((name, text.clone()?))));
    let placement = &origin.placement;
    if *placement != Placement::IDENTITY {
        let [x, y, z] = placement.center;
        let up = trisplat_bake::UpChoice::Given(placement.up);
        let turned = match placement.rotate {
            0.0 => String::new(),
            degrees => format!("rotate {degrees}, "),
        };
        rows.push((
            "placed",
            format!("up {up}, {turned}scale {}, center {x} {y} {z}", placement.scale),
        ));
    }
    if origin.backdrop_faces > 0 {
        rows.push((
            "backdrop",
            format!("the last {}", many(u64::from(origin.backdrop_faces), "triangle")),
        ));
    }
    if let Some(gltf) = &info.gltf {
        let counts = format!(
            "{} nodes, {} meshes, {} primitives, {} materials",
            gltf.nodes, gltf.meshes, gltf.primitives, gltf.materials
        );
        rows.push(("glTF", counts));
        let lists = [("uses", &gltf.extensions_used), ("requires", &gltf.extensions_required)];
        rows.extend(
            lists
                .into_iter()
                .filter(|(_, list)| !list.is_empty())
                .map(|(name, l)| (name, l.join(" "))),
        );
    }
    rows
}

fn bake_line(info: &Info) -> String {
    let Some(bake) = &info.bake else {
        return "would fail: nothing would be left to draw".to_owned();
    };
    let dropped = info.triangles - bake.kept;
    if dropped == 0 {
        return "would keep every triangle".to_owned();
    }
    let causes: Vec<String> =
        bake.dropped.iter().map(|(cause, count)| format!("{cause} {count}")).collect();
    let share = 100.0 * dropped as f64 / info.triangles.max(1) as f64;
    format!("would drop {} ({share:.1}%: {})", many(dropped, "triangle"), causes.join(", "))
}

fn soft_line(softness: &Softness) -> String {
    let psnr = softness.psnr;
    let pictures = many(softness.pictures, "picture");
    format!(
        "its solid triangles match its soft pictures to {psnr:.1} dB ({pictures}); `bake --harden` trains it solid"
    )
}

fn dataset_rows(d: &Description) -> Vec<Row> {
    let mut rows = vec![("kind", d.kind.to_string())];
    let photos = d.train + d.test;
    rows.push(("photos", format!("{photos}: {} to train on, {} held out", d.train, d.test)));
    for group in d.cameras.iter().take(LISTED) {
        let [w, h] = group.size;
        let [sw, sh] = group.stored;
        let files =
            if group.size == group.stored { String::new() } else { format!(" (files {sw}x{sh})") };
        let [fx, fy] = group.focal;
        let [cx, cy] = group.center;
        let lens =
            format!("f {fx:.1} {fy:.1}, centre {cx:.1} {cy:.1}, {:.1}° wide", group.field_of_view);
        let photos = counted(group.photos, "photo");
        rows.push(("camera", format!("{w}x{h}{files}, {lens}: {photos}")));
    }
    if d.cameras.len() > LISTED {
        rows.push(("camera", format!("and {} more", d.cameras.len() - LISTED)));
    }
    let depth = d.depth_error.map_or(String::new(), |error| {
        format!(", at the points {:.1}% off (median)", 100.0 * error)
    });
    let some = [
        ("masks", d.masks, ""),
        ("depth", d.depths, &depth),
        ("cut out", d.cut, " of an object without background"),
        ("lens", d.undistorted, " undistorted while read"),
    ];
    let some = some.into_iter().filter(|(_, photos, _)| *photos > 0);
    rows.extend(some.map(|(name, photos, what)| (name, counted(photos, "photo") + what)));
    rows.push(("decoded", format!("{:.1} MiB", d.decoded_bytes as f64 / f64::from(1 << 20))));
    rows.push(("cameras", format!("within {:.3} world units", d.camera_extent)));
    rows.push(("points", thousands(d.points)));
    if let Some([low, high]) = d.point_bounds {
        let span = |i: usize| format!("{:.3}..{:.3}", low[i], high[i]);
        rows.push(("bounds", format!("x {}  y {}  z {} (middle 98%)", span(0), span(1), span(2))));
    }
    if let Some(error) = d.stated_error_px {
        rows.push(("stated", format!("{error:.3} px mean error")));
    }
    if let Some(fit) = d.reprojection {
        let behind = if fit.behind > 0 {
            format!(", {} behind the camera", fit.behind)
        } else {
            String::new()
        };
        let seen = thousands(fit.observations);
        rows.push((
            "measured",
            format!("{:.3} px mean error over {seen} observations{behind}", fit.mean_px),
        ));
    }
    if let Some([x, y, z]) = d.origin {
        rows.push(("origin", format!("{x} {y} {z} is subtracted from every position")));
    }
    rows.extend(d.warnings.iter().map(|warning| ("warning", warning.clone())));
    rows
}

// ---- `trisplat validate FILE`: what stops a file from being read, and what engines reject -------

/// File to check.
#[derive(Debug, clap::Args)]
pub struct ValidateArgs {
    /// File to check: .ply, .splat, .spz, .sog, .pt, .off, .obj, .glb or .gltf; "-" is standard
    /// input.
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Print JSON (`trisplat schema validate` describes it).
    #[arg(long)]
    pub json: bool,
}

const SEVERITIES: [(Severity, &str); 3] =
    [(Severity::Error, "error"), (Severity::Warning, "warning"), (Severity::Note, "note")];

/// Lists every finding on `out`; an error when any of them is one.
pub fn validate(args: &ValidateArgs, options: &ReadOptions, out: &mut dyn Write) -> Result<()> {
    let checked = check(&args.input, options)?;
    let printed =
        if args.json { messages::print_json(&checked, out) } else { print_findings(&checked, out) };
    printed.map_err(|e| Error::io("-", e))?;
    match checked.count(Severity::Error) {
        0 => Ok(()),
        n => Err(Error::malformed(
            &args.input,
            "validation",
            format!("{}, listed above", counted(n as u64, "error")),
        )),
    }
}

fn print_findings(checked: &Checked, out: &mut dyn Write) -> io::Result<()> {
    for finding in &checked.findings {
        let name = SEVERITIES
            .iter()
            .find(|(severity, _)| *severity == finding.severity)
            .map_or("", |s| s.1);
        messages::write(out, &format!("{name:<8} {}: {}", finding.place, finding.what))?;
    }
    let triangles =
        checked.triangles.map_or(String::new(), |n| format!(", {}", counted(n, "triangle")));
    let counts =
        SEVERITIES.map(|(severity, name)| counted(checked.count(severity) as u64, name)).join(", ");
    messages::write(
        out,
        &format!("{}: {}{triangles}: {counts}", checked.path, checked.format.name()),
    )
}
