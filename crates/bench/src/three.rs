//! The same frames with three.js in headless Chromium, for comparison.

use super::frames::{BACKGROUND, FrameCost, FrameCount, quantile};
use glam::{Mat3, Mat4};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::ops::ControlFlow::Continue;
use std::path::Path;
use std::process::{Command, Stdio};
use trisplat_bake::BakeOptions;
use trisplat_formats::output::{self, Output};
use trisplat_scene::{Asset, Error, Result, camera::Camera, image::RgbImage, report::Report};

/// What the script gets on standard input.
#[derive(Debug, Serialize)]
struct PageInput<'a> {
    folder: &'a Path,
    chromium: &'a Path,
    glb: &'a Path,
    picture: &'a Path,
    size: [u32; 2],
    warmup: usize,
    frames: usize,
    antialias: bool,
    background: [f32; 3],
    /// Camera to world and projection, column by column.
    cameras: Vec<[[f32; 16]; 2]>,
}

/// What the script prints.
#[derive(Debug, Deserialize)]
struct PageOutput {
    frames_ms: Vec<f64>,
    adapter: String,
    drawn: f64,
    draws: f64,
    cpu_ms: f64,
}

/// Cost and picture of three.js.
#[derive(Debug)]
pub(super) struct ThreeResult {
    pub(super) cost: FrameCost,
    pub(super) picture: RgbImage,
    pub(super) adapter: String,
}

/// Writes the asset as a GLB, lets three.js draw it along the path and times it.
///
/// Errors: Node, Chromium or the modules are missing, or the page fails.
pub(super) fn time(
    folder: &Path,
    chromium: &Path,
    asset: &Asset,
    path: &[Camera],
    msaa: u32,
    count: FrameCount,
) -> Result<ThreeResult> {
    let temporary = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let (glb, picture) = (temporary.path().join("scene.glb"), temporary.path().join("frame.png"));
    let script = temporary.path().join("three.mjs");
    std::fs::write(&script, include_str!("three.mjs")).map_err(|e| Error::io(&script, e))?;
    let options = BakeOptions::default();
    let plan = Output::plan(&glb, None, &options.output, false)?;
    output::write(asset, &plan, plan.start()?, &options.output, &mut Report::new("bench fps"), &mut |_| {
        Continue(())
    })?;
    let input = PageInput {
        folder: &std::path::absolute(folder).map_err(|e| Error::io(folder, e))?,
        chromium,
        glb: &glb,
        picture: &picture,
        size: path.first().map_or([1, 1], |c| c.size.to_array()),
        warmup: count.warmup,
        frames: count.frames,
        antialias: msaa > 1,
        background: BACKGROUND,
        cameras: path.iter().map(matrices).collect(),
    };
    let output = run_script(&script, &input)?;
    let mut times = output.frames_ms;
    let cost = FrameCost {
        frame_ms: quantile(&mut times, 0.5),
        frame_p99_ms: quantile(&mut times, 0.99),
        frame_min_ms: quantile(&mut times, 0.0),
        gpu_ms: None,
        cpu_ms: output.cpu_ms,
        drawn: output.drawn,
        draws: output.draws,
    };
    Ok(ThreeResult { cost, picture: RgbImage::load(&picture)?, adapter: output.adapter })
}

fn run_script(script: &Path, input: &PageInput<'_>) -> Result<PageOutput> {
    let io = |e| Error::io("node", e);
    let mut node = Command::new("node")
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(io)?;
    if let Some(mut stdin) = node.stdin.take() {
        let json = serde_json::to_vec(input).map_err(|e| Error::malformed(script, "input", e.to_string()))?;
        stdin.write_all(&json).map_err(io)?;
    }
    let done = node.wait_with_output().map_err(io)?;
    if !done.status.success() {
        let said = String::from_utf8_lossy(&done.stderr);
        let last = said.lines().rfind(|l| l.contains("rror")).unwrap_or("said nothing").trim().to_owned();
        return Err(Error::unsupported(
            "three.js",
            format!("{last}; `three` needs npm i three playwright-core"),
        ));
    }
    serde_json::from_slice(&done.stdout)
        .map_err(|e| Error::malformed("three.js", "its output", e.to_string()))
}

/// Camera to world and projection as three.js has them: y up, looking along -z, depth from -1 to 1.
fn matrices(camera: &Camera) -> [[f32; 16]; 2] {
    let flipped = Mat3::from_diagonal(glam::Vec3::new(1.0, -1.0, -1.0));
    let mut to_world = Mat4::from_mat3(camera.rotation.transpose() * flipped);
    to_world.w_axis = camera.position().extend(1.0);
    let (f, c, s) = (camera.focal, camera.center, camera.size.as_vec2());
    let (near, far) = (0.01f32, 1e5f32);
    let projection = Mat4::from_cols_array(&[
        2.0 * f.x / s.x,
        0.0,
        0.0,
        0.0,
        0.0,
        2.0 * f.y / s.y,
        0.0,
        0.0,
        1.0 - 2.0 * c.x / s.x,
        2.0 * c.y / s.y - 1.0,
        -(far + near) / (far - near),
        -1.0,
        0.0,
        0.0,
        -2.0 * far * near / (far - near),
        0.0,
    ]);
    [to_world.to_cols_array(), projection.to_cols_array()]
}
