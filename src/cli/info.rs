//! `trisplat info FILE`: the content of a file of any format, or of a data set.

use super::counts::{many, thousands};
use super::{files, info_dataset, messages};
use std::io::{self, Write};
use std::path::PathBuf;
use trisplat_dataset::DatasetOptions;
use trisplat_formats::info::{Distribution, HistogramBin, Info, SceneKind, Softness, TextureInfo};
use trisplat_job::describe;
use trisplat_scene::{Error, Result};

/// What to describe.
#[derive(Debug, clap::Args)]
pub struct InfoArgs {
    /// Soup, mesh or Gaussian splats to describe: .ply, .pt, .off, .obj, .glb, .gltf, .splat, .spz or .sog; "-" is standard input.
    /// Or a data set: a folder of posed photos, or a transforms.json.
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Print JSON (`trisplat schema info` describes it).
    #[arg(long)]
    pub json: bool,
    /// How a data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// Describes the file on `out`.
pub fn run(args: &InfoArgs, out: &mut dyn Write) -> Result<()> {
    if info_dataset::is_dataset(&args.input) {
        return info_dataset::run(&args.input, &args.dataset_options, args.json, out);
    }
    let info = describe(&args.input, &args.dataset_options.read_options(3))?;
    let printed = if args.json { files::print_json(&info, out) } else { print(&info, out) };
    printed.map_err(|e| Error::io("-", e))
}

fn print(info: &Info, out: &mut dyn Write) -> io::Result<()> {
    messages::write(out, &format!("{}: {}, {} bytes", info.path, info.format.name(), thousands(info.bytes)))?;
    let kind = match (info.kind, info.sh_degree) {
        (SceneKind::Soup, Some(degree)) => format!("soup, spherical harmonics of degree {degree}"),
        (SceneKind::Soup, None) => "soup".to_owned(),
        (SceneKind::Mesh, _) if info.indexed => "mesh with shared vertices".to_owned(),
        (SceneKind::Mesh, _) => "mesh".to_owned(),
        (SceneKind::Splats, degree) => {
            format!("Gaussian splats, spherical harmonics of degree {}", degree.unwrap_or(0))
        }
    };
    line(out, "kind", &kind)?;
    if info.kind == SceneKind::Splats {
        line(out, "splats", &thousands(info.splats))?;
    } else {
        line(out, "triangles", &thousands(info.triangles))?;
        line(out, "vertices", &thousands(info.vertices))?;
    }
    if info.shell > 0 {
        line(out, "shell", &thousands(info.shell))?;
    }
    if info.cameras > 0 {
        line(out, "cameras", &thousands(info.cameras))?;
    }
    let [min, max] = [info.bounds.min, info.bounds.max].map(|p| p.map(|x| format!("{x:.4}")).join(" "));
    line(out, "bounds", &format!("{min}  to  {max}"))?;
    print_origin(info, out)?;
    let hex = |c: [f32; 3]| c.map(|x| format!("{:02x}", (x.clamp(0.0, 1.0) * 255.0).round() as u8)).concat();
    let colors = &info.colors;
    let outside = match colors.outside {
        0 => String::new(),
        n => format!("; {} outside 0 to 1", thousands(n)),
    };
    let colors = format!("mean #{}, #{} to #{}{outside}", hex(colors.mean), hex(colors.min), hex(colors.max));
    line(out, "colors", &colors)?;
    if let Some(TextureInfo { size: [width, height], pages, stored }) = &info.texture {
        let stored = stored.as_ref().map_or(String::new(), |stored| {
            format!(", {} of {} bytes", stored.format, thousands(stored.bytes))
        });
        let pages = if *pages > 1 { format!("{pages} pages of up to ") } else { String::new() };
        line(out, "texture", &format!("{pages}{width}x{height} texels{stored}"))?;
    }
    for (name, spread) in [("opacity", &info.opacity), ("sigma", &info.sigma)] {
        if let Some(spread) = spread {
            print_spread(out, name, spread)?;
        }
    }
    if info.kind != SceneKind::Splats {
        line(out, "bake", &bake_line(info))?;
    }
    if let Some(softness) = &info.softness {
        line(out, "soft", &soft_line(softness))?;
    }
    info.warnings.iter().try_for_each(|warning| line(out, "warning", warning))
}

/// Provenance, and what a glTF document says.
fn print_origin(info: &Info, out: &mut dyn Write) -> io::Result<()> {
    let origin = &info.provenance;
    let up = origin.up.and_then(|up| serde_json::to_value(up).ok());
    let up = up.as_ref().and_then(|up| up.as_str()).unwrap_or("the file does not say");
    line(out, "up axis", up)?;
    for (name, value) in
        [("generator", &origin.generator), ("trainer", &origin.trainer), ("source", &origin.source)]
    {
        if let Some(value) = value {
            line(out, name, value)?;
        }
    }
    let placement = &origin.placement;
    if *placement != trisplat_scene::Placement::IDENTITY {
        let [x, y, z] = placement.center;
        let up = trisplat_bake::UpChoice::Given(placement.up);
        let turned = match placement.rotate {
            0.0 => String::new(),
            degrees => format!("rotate {degrees}, "),
        };
        let how = format!("up {up}, {turned}scale {}, center {x} {y} {z}", placement.scale);
        line(out, "placed", &how)?;
    }
    if origin.backdrop > 0 {
        line(out, "backdrop", &format!("the last {}", many(u64::from(origin.backdrop), "triangle")))?;
    }
    if let Some(gltf) = &info.gltf {
        let counts = format!(
            "{} nodes, {} meshes, {} primitives, {} materials",
            gltf.nodes, gltf.meshes, gltf.primitives, gltf.materials
        );
        line(out, "glTF", &counts)?;
        for (name, list) in [("uses", &gltf.extensions_used), ("requires", &gltf.extensions_required)] {
            if !list.is_empty() {
                line(out, name, &list.join(" "))?;
            }
        }
    }
    Ok(())
}

fn bake_line(info: &Info) -> String {
    let Some(bake) = &info.bake else { return "would fail: nothing would be left to draw".to_owned() };
    let dropped = info.triangles - bake.kept;
    if dropped == 0 {
        return "would keep every triangle".to_owned();
    }
    let causes: Vec<String> = bake.dropped.iter().map(|(cause, count)| format!("{cause} {count}")).collect();
    let share = 100.0 * dropped as f64 / info.triangles.max(1) as f64;
    format!("would drop {} ({share:.1}%: {})", many(dropped, "triangle"), causes.join(", "))
}

fn soft_line(softness: &Softness) -> String {
    let (psnr, pictures) = (softness.psnr, many(softness.pictures, "picture"));
    format!(
        "its solid triangles match its soft pictures to {psnr:.1} dB ({pictures}); `bake --harden` trains it solid"
    )
}

/// A histogram of text bars; the longest is 40 characters.
fn print_spread(out: &mut dyn Write, name: &str, spread: &Distribution) -> io::Result<()> {
    let Distribution { min, median, mean, max, bins } = spread;
    line(out, name, &format!("{min:.4} to {max:.4}, mean {mean:.4}, median {median:.4}"))?;
    let most = bins.iter().map(|bin| bin.count).max().unwrap_or(0).max(1);
    for HistogramBin { low, high, count } in bins {
        let range = match high {
            Some(high) => format!("{low} to {high}"),
            None => format!("{low} and more"),
        };
        let bar = "#".repeat((40 * count).div_ceil(most) as usize);
        writeln!(out, "  {range:>14}  {:>11}  {bar}", thousands(*count))?;
    }
    Ok(())
}

fn line(out: &mut dyn Write, name: &str, value: &str) -> io::Result<()> {
    messages::write(out, &format!("{name:<10} {value}"))
}
