//! `trisplat bench fidelity`: what each step from photos to a file costs, measured on held-out photos.
//!
//! A soup is trained, or given; every case is baked, written, *read back from the file* and drawn by the solid
//! rasteriser with 1, 4 and 16 samples per pixel. It plots PSNR against the number of
//! triangles, the size of the file and the seconds of the bake.

use super::machine::{Machine, append_csv};
use super::plot::{self, PlotPoint};
use super::training::{self, TrainBudget, TrainedSoup};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;
use trisplat_bake::{Bake, BakeOptions, BakePreset, Views, refit::RefitColors};
use trisplat_dataset::{Dataset, DatasetOptions, ShrunkSize, View};
use trisplat_eval::{
    SceneRenderer,
    evaluate::{self, StepScore},
    steps::{EvalStep, no_soup, reread},
};
use trisplat_formats::{self as formats, OutputTarget, ReadOptions, TargetEncoding, output::OutputOptions};
use trisplat_scene::{Asset, Error, ImportedScene, Result, Scene};
use trisplat_train::{TrainObserver, TrainPreset};

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct FidelityBenchArgs {
    /// Posed photos; the files are measured on those held out.
    #[arg(value_name = "DATASET")]
    pub dataset: PathBuf,
    /// Trained soup to bake (.ply .pt); without it one is trained with the solid preset, and a soft one too.
    #[arg(long, value_name = "FILE")]
    pub soup: Option<PathBuf>,
    /// Soup that was trained to stay soft on the same budget: the file is compared with it instead of --soup.
    #[arg(long, value_name = "FILE")]
    pub soft: Option<PathBuf>,
    /// How much is trained.
    #[command(flatten)]
    pub budget: TrainBudget,
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
    /// The soup, as given, or how it was trained.
    pub soup: String,
    /// The data set, as given.
    pub dataset: String,
    /// The size that photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default)]
    pub photo_size: Option<ShrunkSize>,
    /// What was measured: "soft"; "plain", "unseen", "refit", "flat": how far the bake went; a preset; "half", …:
    /// the share of the triangles.
    pub case: String,
    /// What the file was written for: "gltf", "web", …; empty for "soft".
    pub target: String,
    /// Samples per pixel along each axis.
    pub ssaa: u32,
    /// Triangles of the file.
    pub triangles: u64,
    /// Size of the file; of the soup for "soft".
    pub bytes: u64,
    /// Seconds for baking, writing and reading back.
    pub bake_secs: f64,
    /// Mean over the held-out photos, dB.
    pub psnr: f64,
    /// PSNR minus that of the soft drawing, dB.
    pub change: f64,
    /// Mean over the held-out photos, in the convention of 3DGS.
    pub ssim: f64,
    /// Mean over the held-out photos.
    pub flip: f64,
}

/// A bake to measure.
struct FidelityCase {
    name: &'static str,
    preset: BakePreset,
    photos: bool,
    refit: RefitColors,
    /// Share of the triangles seen by photos that is kept.
    share: f64,
    /// At every sampling, or only at the highest.
    everywhere: bool,
    /// For every target, or only for any viewer.
    targets: &'static [OutputTarget],
}

const fn case(name: &'static str) -> FidelityCase {
    FidelityCase {
        name,
        preset: BakePreset::Default,
        photos: true,
        refit: RefitColors::Auto,
        share: 1.0,
        everywhere: false,
        targets: &[OutputTarget::Gltf],
    }
}

/// The steps of the bake, then presets, then levels of detail.
const CASES: [FidelityCase; 11] = [
    FidelityCase { photos: false, everywhere: true, ..case("plain") },
    FidelityCase { refit: RefitColors::Off, everywhere: true, ..case("unseen") },
    FidelityCase { everywhere: true, ..case("refit") },
    FidelityCase { refit: RefitColors::Flat, ..case("flat") },
    FidelityCase { preset: BakePreset::Fast, targets: &TARGETS, ..case("fast") },
    FidelityCase { targets: &TARGETS, ..case("default") },
    FidelityCase { preset: BakePreset::Small, targets: &TARGETS, ..case("small") },
    FidelityCase { share: 0.75, ..case("three quarters") },
    FidelityCase { share: 0.5, ..case("half") },
    FidelityCase { share: 0.25, ..case("quarter") },
    FidelityCase { share: 0.125, ..case("eighth") },
];

/// The targets of a GLB.
const TARGETS: [OutputTarget; 8] = [
    OutputTarget::Gltf,
    OutputTarget::Godot,
    OutputTarget::Godot3,
    OutputTarget::Unity,
    OutputTarget::Unreal,
    OutputTarget::Blender,
    OutputTarget::Web,
    OutputTarget::Playcanvas,
];

/// Samplings, the highest last.
const SAMPLINGS: [u32; 3] = [1, 2, 4];

/// Bakes and measures every case; rows in order of case, target and sampling. Calls `on_row` with each row as soon
/// as it is there, and `observer` during the training.
pub fn run(
    args: &FidelityBenchArgs,
    observer: TrainObserver<'_>,
    on_row: &mut dyn FnMut(&FidelityRow),
) -> Result<Vec<FidelityRow>> {
    let dataset_options = &args.dataset_options;
    let dataset = Dataset::load(&args.dataset, dataset_options)?;
    let views: Vec<&View> = dataset.test().collect();
    if views.is_empty() {
        return Err(Error::invalid("DATASET", args.dataset.display(), "held-out photos; see `test_every`"));
    }
    args.budget.check(args.soup.is_none() || args.soft.is_none())?;
    let soups = soups(args, &dataset, observer)?;
    let mut bench = FidelityBench {
        args,
        dataset: &dataset,
        views,
        name: soups.name.clone(),
        background: dataset_options.background.to_f32(),
        best: 0.0,
    };
    let step = bench.soft(&soups.reference)?;
    let score = bench.evaluate(step)?;
    bench.best = score.mean.psnr;
    let mut rows = vec![bench.row(&score, "", 1, 0.0)];
    rows.iter().for_each(&mut *on_row);
    let mut flat = formats::read(&soups.soup, &ReadOptions::with_degree(0))?;
    // A soup by another trainer comes without cameras: the plain bake has no photos.
    flat.cameras.clear();
    let mut seen = 0;
    for case in &CASES {
        let asset = bench.case(&flat, case, seen, &mut rows, on_row)?;
        if case.name == "unseen" {
            seen = asset.mesh.face_count() as u64;
        }
    }
    if let Some(path) = &args.csv {
        append_csv(path, &Machine::here(), &rows)?;
    }
    if let Some(path) = &args.plot {
        plot(path, &rows)?;
    }
    Ok(rows)
}

/// The files that are measured.
struct Soups {
    /// What is baked.
    soup: PathBuf,
    /// What it is called in the rows.
    name: String,
    /// What the files are compared with.
    reference: PathBuf,
    /// Keeps the files that were trained here.
    _trained: Vec<TrainedSoup>,
}

/// The soups that are given; those that are not are trained.
fn soups(args: &FidelityBenchArgs, dataset: &Dataset, observer: TrainObserver<'_>) -> Result<Soups> {
    let mut train =
        |preset| training::train(dataset, preset, &args.budget, &args.dataset_options, &mut *observer);
    if let Some(soup) = &args.soup {
        let reference = args.soft.clone().unwrap_or_else(|| soup.clone());
        let name = soup.display().to_string();
        return Ok(Soups { soup: soup.clone(), name, reference, _trained: Vec::new() });
    }
    let mut trained = vec![train(TrainPreset::Solid)?];
    let (soup, name) = (trained[0].path.clone(), trained[0].name.clone());
    let reference = match &args.soft {
        Some(soft) => soft.clone(),
        None => {
            trained.push(train(TrainPreset::Outdoor)?);
            trained[1].path.clone()
        }
    };
    Ok(Soups { soup, name, reference, _trained: trained })
}

/// Plots PSNR at the highest sampling against triangles, bytes and seconds of the bake, one dot per case.
fn plot(path: &Path, rows: &[FidelityRow]) -> Result<()> {
    let highest = rows.iter().map(|r| r.ssaa).max().unwrap_or(1);
    let mut shown: Vec<&FidelityRow> = Vec::new();
    for row in rows.iter().filter(|r| r.ssaa == highest && r.case != "soft") {
        // One dot per case: its targets differ by less than a dot.
        if !shown.iter().any(|other| other.case == row.case) {
            shown.push(row);
        }
    }
    let dots = |x: fn(&FidelityRow) -> f64| -> Vec<PlotPoint> {
        shown.iter().map(|row| PlotPoint { name: row.case.clone(), x: x(row), y: row.psnr }).collect()
    };
    let panels = [
        ("triangles", dots(|r| r.triangles as f64)),
        ("bytes", dots(|r| r.bytes as f64)),
        ("seconds of baking", dots(|r| r.bake_secs)),
    ];
    plot::dots(path, &panels)
}

struct FidelityBench<'a> {
    args: &'a FidelityBenchArgs,
    dataset: &'a Dataset,
    views: Vec<&'a View>,
    /// The soup.
    name: String,
    background: [f32; 3],
    /// PSNR of the soft drawing, dB.
    best: f64,
}

impl FidelityBench<'_> {
    /// A soup as it was trained.
    fn soft(&self, path: &Path) -> Result<EvalStep> {
        let loaded = formats::read(path, &ReadOptions::with_degree(3))?;
        let Scene::Soup(soup) = loaded.scene else { return Err(no_soup(path)) };
        let triangles = soup.len() as u64;
        let bytes = std::fs::metadata(path).ok().map(|m| m.len());
        let placement = &loaded.provenance.placement;
        let renderer = SceneRenderer::soft(soup, placement, Some(self.dataset), self.background);
        Ok(EvalStep { name: "soft", triangles, bytes, renderer })
    }

    /// Bakes a case once, writes it for its targets and measures the files; returns what was baked.
    fn case(
        &self,
        loaded: &ImportedScene,
        case: &FidelityCase,
        seen: u64,
        rows: &mut Vec<FidelityRow>,
        on_row: &mut dyn FnMut(&FidelityRow),
    ) -> Result<Asset> {
        let clock = Instant::now();
        let (asset, output) = self.bake(loaded, case, seen)?;
        let baked = clock.elapsed().as_secs_f64();
        let mut written: Vec<(TargetEncoding, Vec<FidelityRow>)> = Vec::new();
        for &target in case.targets {
            let encoding = TargetEncoding { notes: Vec::new(), ..target.encoding(output.compress) };
            let name = serde_json::to_value(target).unwrap_or_default();
            let name = name.as_str().unwrap_or_default();
            // Engines that read the same file get the same numbers.
            let same = written.iter().find(|(other, _)| *other == encoding).map(|(_, rows)| rows.clone());
            let mut made = match same {
                Some(rows) => rows,
                None => self.written(&asset, case, &OutputOptions { target, ..output.clone() }, baked)?,
            };
            made.iter_mut().for_each(|row| row.target = name.to_owned());
            made.iter().for_each(&mut *on_row);
            rows.extend(made.iter().cloned());
            written.push((encoding, made));
        }
        Ok(asset)
    }

    /// The asset of a case, and the options of its file. `seen` is the number of triangles that photos see.
    fn bake(&self, loaded: &ImportedScene, case: &FidelityCase, seen: u64) -> Result<(Asset, OutputOptions)> {
        let mut options = BakeOptions::preset(case.preset);
        options.refit.refit = case.refit;
        // A scene of few steps may be farther from its own photos than no scene is.
        options.force_dataset = true;
        if case.share < 1.0 {
            options.prune.max_triangles = Some(((seen as f64 * case.share) as u64).max(1));
        }
        let mut views = case.photos.then(|| Views::new(self.dataset, &self.args.dataset_options));
        let inputs = vec![loaded.clone()];
        let asset = Bake::new(&options).photos(views.as_mut()).run(inputs)?;
        Ok((asset, options.output))
    }

    /// Writes and measures one file; `baked` are the seconds of the bake.
    fn written(
        &self,
        asset: &Asset,
        case: &FidelityCase,
        output: &OutputOptions,
        baked: f64,
    ) -> Result<Vec<FidelityRow>> {
        let clock = Instant::now();
        let (file, bytes) = reread(asset, output)?;
        let secs = baked + clock.elapsed().as_secs_f64();
        let samplings = if case.everywhere { &SAMPLINGS[..] } else { &SAMPLINGS[2..] };
        let row = |&ssaa: &u32| {
            let score = self.evaluate(self.step(case.name, &file, bytes, ssaa))?;
            Ok(self.row(&score, "", ssaa, secs))
        };
        samplings.iter().map(row).collect()
    }

    fn step(&self, name: &'static str, asset: &Asset, bytes: u64, ssaa: u32) -> EvalStep {
        let (mesh, placement) = (asset.mesh.clone(), &asset.provenance.placement);
        let triangles = mesh.face_count() as u64;
        let renderer = SceneRenderer::solid(mesh, placement, Some(self.dataset), self.background, ssaa);
        EvalStep { name, triangles, bytes: Some(bytes), renderer }
    }

    fn evaluate(&self, step: EvalStep) -> Result<StepScore> {
        let photo_bytes = self.args.dataset_options.photo_bytes();
        let scores = evaluate::evaluate(&mut [step], &self.views, photo_bytes, &[], false, |_, _, _| Ok(()))?;
        scores.into_iter().next().ok_or_else(|| Error::invalid("DATASET", "no score", "held-out photos"))
    }

    fn row(&self, score: &StepScore, target: &str, ssaa: u32, bake_secs: f64) -> FidelityRow {
        FidelityRow {
            soup: self.name.clone(),
            dataset: self.args.dataset.display().to_string(),
            photo_size: ShrunkSize::of(self.views.iter().copied()),
            case: score.name.clone(),
            target: target.to_owned(),
            ssaa,
            triangles: score.triangles,
            bytes: score.bytes.unwrap_or(0),
            bake_secs,
            psnr: score.mean.psnr,
            change: score.mean.psnr - self.best,
            ssim: score.mean.ssim,
            flip: score.mean.flip,
        }
    }
}
