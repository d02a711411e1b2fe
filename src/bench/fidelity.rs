//! `trisplat bench fidelity`: what each step from a soup to a file costs, judged on held-out photos.
//!
//! Every case is baked, written, *read back from the file* and drawn by the solid rasteriser with one, four
//! and sixteen samples a pixel. Two curves come with it: the error against the number of triangles and
//! against the size of the file.

use super::judge::{self, StepScore};
use super::machine::{Machine, append_csv};
use super::paint::Painter;
use super::steps::{SMALLEST, Step, no_soup, reread};
use crate::asset::Asset;
use crate::bake::bake;
use crate::bake::options::{BakeOptions, Preset};
use crate::bake::refit::RefitColors;
use crate::bake::views::Views;
use crate::dataset::{Dataset, DatasetOptions, View};
use crate::error::{Error, Result};
use crate::formats::output::OutputOptions;
use crate::formats::{self, ReadOptions};
use crate::report::Report;
use crate::scene::{Loaded, Scene};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct FidelityBenchArgs {
    /// Trained soup: .ply .pt.
    #[arg(value_name = "SOUP")]
    pub soup: PathBuf,
    /// The posed photos it was trained on.
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Soup that was trained to stay soft on the same budget: what SOUP is held against, instead of itself.
    #[arg(long, value_name = "SOUP")]
    pub soft: Option<PathBuf>,
    /// Print rows as JSON.
    #[arg(long)]
    pub json: bool,
    /// Append rows to this CSV file.
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Draw PSNR against triangles, bytes and seconds as SVG.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// How the data set is read.
    #[command(flatten)]
    pub dataset_options: DatasetOptions,
}

/// One case at one sampling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FidelityRow {
    /// The soup, as given.
    pub soup: String,
    /// The data set, as given.
    pub dataset: String,
    /// What was judged: "soft", "plain", "unseen", "refit", "small", "fast", "half".
    pub case: String,
    /// Samples a pixel along each axis.
    pub ssaa: u32,
    /// Triangles of the file.
    pub triangles: u64,
    /// Size of the file; of the soup for "soft".
    pub bytes: u64,
    /// Seconds for baking, writing and reading back.
    pub bake_secs: f64,
    /// Mean over the held-out photos, dB.
    pub psnr: f64,
    /// PSNR less that of the soft drawing, dB.
    pub change: f64,
    /// Mean over the held-out photos, in the convention of 3DGS.
    pub ssim: f64,
    /// Mean over the held-out photos.
    pub flip: f64,
}

/// One way to bake.
struct Case {
    name: &'static str,
    preset: Preset,
    output: OutputOptions,
    photos: bool,
    refit: RefitColors,
    /// Share of the triangles that photos see that may stay.
    share: f64,
    /// At every sampling, or only at the highest.
    everywhere: bool,
}

const fn case(name: &'static str) -> Case {
    Case {
        name,
        preset: Preset::Default,
        output: OutputOptions::DEFAULT,
        photos: true,
        refit: RefitColors::Auto,
        share: 1.0,
        everywhere: false,
    }
}

/// The steps of the way, then presets, then levels of detail.
const CASES: [Case; 10] = [
    Case { photos: false, everywhere: true, ..case("plain") },
    Case { refit: RefitColors::Off, everywhere: true, ..case("unseen") },
    Case { everywhere: true, ..case("refit") },
    Case { output: SMALLEST, preset: Preset::Small, everywhere: true, ..case("small") },
    Case { preset: Preset::Fast, ..case("fast") },
    Case { refit: RefitColors::Flat, ..case("flat") },
    Case { share: 0.75, ..case("three quarters") },
    Case { share: 0.5, ..case("half") },
    Case { share: 0.25, ..case("quarter") },
    Case { share: 0.125, ..case("eighth") },
];

/// Samplings, the highest last.
const SAMPLINGS: [u32; 3] = [1, 2, 4];

/// Bakes and judges every case; rows in order of case, then sampling. `tell` hears each as it is there.
pub fn run(args: &FidelityBenchArgs, mut tell: impl FnMut(&FidelityRow)) -> Result<Vec<FidelityRow>> {
    let how = &args.dataset_options;
    let dataset = Dataset::load(&args.dataset, how)?;
    let views: Vec<&View> = dataset.test().collect();
    if views.is_empty() {
        return Err(Error::invalid("DATASET", args.dataset.display(), "held-out photos; see --test-every"));
    }
    let bench = Bench { args, dataset: &dataset, background: how.background.to_f32() };
    let reference = args.soft.as_ref().unwrap_or(&args.soup);
    let soft = bench.judge(vec![bench.soft(reference)?], &views)?.remove(0);
    let mut flat = formats::read(&args.soup, &ReadOptions { sh_degree: 0 })?;
    // The plain bake is what is had of a soup by others, which knows nothing of photos.
    flat.cameras.clear();

    let mut rows = Vec::new();
    let best = soft.mean.psnr;
    let mut push = |score: &StepScore, ssaa: u32, secs: f64| {
        let row = bench.row(score, ssaa, secs, best);
        tell(&row);
        rows.push(row);
    };
    push(&soft, 1, 0.0);
    let mut seen = 0;
    for case in &CASES {
        let clock = Instant::now();
        let (asset, bytes) = bench.bake(&flat, case, seen)?;
        let secs = clock.elapsed().as_secs_f64();
        if case.name == "unseen" {
            seen = asset.mesh.face_count() as u64;
        }
        let samplings = if case.everywhere { &SAMPLINGS[..] } else { &SAMPLINGS[2..] };
        for &ssaa in samplings {
            let score = bench.judge(vec![bench.step(case.name, &asset, bytes, ssaa)], &views)?.remove(0);
            push(&score, ssaa, secs);
        }
    }
    if let Some(path) = &args.csv {
        append_csv(path, &Machine::here(), &rows)?;
    }
    if let Some(path) = &args.plot {
        super::plot::fidelity(path, &rows)?;
    }
    Ok(rows)
}

struct Bench<'a> {
    args: &'a FidelityBenchArgs,
    dataset: &'a Dataset,
    background: [f32; 3],
}

impl Bench<'_> {
    fn photo_bytes(&self) -> u64 {
        u64::from(self.args.dataset_options.photo_memory_mib) << 20
    }

    /// A soup as it was trained.
    fn soft(&self, path: &Path) -> Result<Step> {
        let loaded = formats::read(path, &ReadOptions { sh_degree: 3 })?;
        let Scene::Soup(soup) = loaded.scene else { return Err(no_soup(path)) };
        let triangles = soup.len() as u64;
        let bytes = std::fs::metadata(path).ok().map(|m| m.len());
        let placement = &loaded.provenance.placement;
        let painter = Painter::soft(soup, placement, Some(self.dataset), self.background);
        Ok(Step { name: "soft", triangles, bytes, painter })
    }

    /// The case's file, read back, and its size. `seen` is how many triangles photos see.
    fn bake(&self, loaded: &Loaded, case: &Case, seen: u64) -> Result<(Asset, u64)> {
        let mut options = BakeOptions { output: case.output.clone(), ..BakeOptions::preset(case.preset) };
        options.refit.refit = case.refit;
        if case.share < 1.0 {
            options.prune.max_triangles = Some(((seen as f64 * case.share) as u64).max(1));
        }
        let mut views = case.photos.then(|| Views::new(self.dataset, self.photo_bytes(), self.background));
        let inputs = vec![loaded.clone()];
        let asset = bake(inputs, &options, views.as_mut(), &mut Report::default(), &mut ())?;
        reread(&asset, &case.output)
    }

    fn step(&self, name: &'static str, asset: &Asset, bytes: u64, ssaa: u32) -> Step {
        let (mesh, placement) = (asset.mesh.clone(), &asset.provenance.placement);
        let triangles = mesh.face_count() as u64;
        let painter = Painter::solid(mesh, placement, Some(self.dataset), self.background, ssaa);
        Step { name, triangles, bytes: Some(bytes), painter }
    }

    fn judge(&self, mut steps: Vec<Step>, views: &[&View]) -> Result<Vec<StepScore>> {
        judge::judge(&mut steps, views, self.photo_bytes(), |_, _, _| Ok(()))
    }

    fn row(&self, score: &StepScore, ssaa: u32, bake_secs: f64, best: f64) -> FidelityRow {
        FidelityRow {
            soup: self.args.soup.display().to_string(),
            dataset: self.args.dataset.display().to_string(),
            case: score.name.clone(),
            ssaa,
            triangles: score.triangles,
            bytes: score.bytes.unwrap_or(0),
            bake_secs,
            psnr: score.mean.psnr,
            change: score.mean.psnr - best,
            ssim: score.mean.ssim,
            flip: score.mean.flip,
        }
    }
}
