//! The sweep of all stages, in the order in which one needs what the one before leaves.

use super::args::CostArgs;
use super::bake_work::{BakeWork, bake_once};
use super::base::Base;
use super::child::Child;
use super::draw_work::DrawWork;
use super::knobs::{CostInput, CostStage};
use super::page;
use super::plot;
use super::row::{CostRow, MeasuredRow, chain_of_bakes, compare, in_chain};
use super::score::Scorer;
use super::setting::{Setting, check_names, settings};
use super::sweep::{Outcome, Work, sweep};
use super::train_work::TrainWork;
use crate::bench::machine::{Machine, append_csv};
use crate::dataset::synthetic::{self, SyntheticOptions};
use crate::dataset::{Dataset, ShrunkSize};
use crate::error::{Error, Result};
use crate::formats::{self, ReadOptions};
use crate::image::Pixels;
use std::path::Path;

/// Called with the progress of the sweep.
pub trait CostObserver {
    /// Number of runs of a stage that are done; the next run is of a setting.
    fn running(&mut self, stage: CostStage, done: usize, all: usize, setting: &str);
    /// The rows of a stage and an input are there, compared with each other.
    fn measured(&mut self, rows: &[CostRow]);
}

/// Measures every setting that `args` ask for, with `threads` worker threads each (0: one per core). Rows in order of
/// stage and input, the default first.
///
/// Errors: names that are not swept, photos that cannot be read or none held out, a command that fails.
pub fn run(args: &CostArgs, threads: u16, observer: &mut dyn CostObserver) -> Result<Vec<MeasuredRow>> {
    check_names(&args.knob, args.stage)?;
    let folder = tempfile::tempdir().map_err(|e| Error::io("temporary folder", e))?;
    let (path, scene) = match &args.dataset {
        Some(path) => (path.clone(), path.display().to_string()),
        None => {
            let photos = folder.path().join("photos");
            synthetic::write(&photos, &SyntheticOptions { width: WIDTH, ..SyntheticOptions::default() })?;
            (photos, "synthetic".to_owned())
        }
    };
    let dataset = Dataset::load(&path, &args.dataset_options)?;
    let scorer = Scorer::new(&dataset, &args.dataset_options)?;
    let sides = dataset.views.iter().map(|view| view.camera.size.max_element());
    let base = Base {
        steps: args.steps(),
        max_triangles: args.max_triangles(),
        long_side: sides.max().unwrap_or(0),
        soup_triangles: 0,
    };
    let child = Child::new(&path, &args.dataset_options, threads)?;
    let photo_size = ShrunkSize::of(scorer.views.iter().copied());
    let mut bench = CostBench { args, scene, photo_size, scorer, base, child, folder: folder.path() };
    let groups = bench.all(observer)?;
    bench.write(groups)
}

/// Width of the synthetic photos, px: half of their height is above what the warm-up of training leaves as it is.
const WIDTH: u32 = 192;

/// What all stages share.
struct CostBench<'a> {
    args: &'a CostArgs,
    scene: String,
    photo_size: Option<ShrunkSize>,
    scorer: Scorer<'a>,
    base: Base,
    child: Child,
    folder: &'a Path,
}

/// The rows of a stage and an input, each with the picture of its first held-out view.
type Group = Vec<(CostRow, Option<Pixels>)>;

/// The stages with what they are given, in order.
const BAKES: [CostInput; 2] = [CostInput::SolidSoup, CostInput::SoftSoup];
const DRAWINGS: [CostInput; 2] = [CostInput::File, CostInput::SoftSoup];

impl CostBench<'_> {
    fn all(&mut self, observer: &mut dyn CostObserver) -> Result<Vec<Group>> {
        let (solid, soft) = (TrainWork::default_soup(self.folder), self.folder.join("soft.ply"));
        let bakes = BAKES.map(|input| self.sweeps(CostStage::Bake, input));
        let drawings = DRAWINGS.map(|input| self.sweeps(CostStage::Draw, input));
        let mut groups = Vec::new();
        let mut chain = Group::new();
        if self.sweeps(CostStage::Train, CostInput::Photos) {
            let (trained, baked) = self.train(observer)?;
            groups.push(trained);
            chain = baked;
        } else if bakes[0] || drawings[0] {
            let default = Setting::default_of(CostStage::Train, CostInput::Photos);
            self.train_work(false).run(&default, 0)?;
        }
        if bakes[1] || drawings[1] {
            self.train_work(false).train_soft(&soft)?;
        }
        for (input, soup) in BAKES.into_iter().zip([&solid, &soft]).zip(bakes).filter(|b| b.1).map(|b| b.0) {
            groups.push(self.bake(input, soup, observer)?);
            if let (CostInput::SolidSoup, Some((default, _)), Some(bakes)) =
                (input, chain.first().cloned(), groups.last())
            {
                let rows: Vec<CostRow> = bakes.iter().map(|(row, _)| row.clone()).collect();
                let pictures = bakes.iter().skip(1).map(|(_, picture)| picture.clone());
                chain.extend(chain_of_bakes(&default, &rows).into_iter().zip(pictures));
            }
        }
        let file = BakeWork::default_file(self.folder);
        if drawings[0] && !bakes[0] {
            bake_once(&self.child, &solid, &file, &Setting::default_of(CostStage::Bake, BAKES[0]))?;
        }
        for (input, scene) in
            DRAWINGS.into_iter().zip([&file, &soft]).zip(drawings).filter(|d| d.1).map(|d| d.0)
        {
            groups.push(self.draw(input, scene, observer)?);
        }
        if !chain.is_empty() {
            groups.push(finished(chain, observer));
        }
        Ok(groups)
    }

    /// Whether a stage is asked for, with this input.
    fn sweeps(&self, stage: CostStage, input: CostInput) -> bool {
        let asked = self.args.stage.is_none_or(|wanted| wanted == stage);
        asked && (self.args.knob.is_empty() || self.settings(stage, input).len() > 1)
    }

    fn settings(&self, stage: CostStage, input: CostInput) -> Vec<Setting> {
        settings(stage, input, &self.base, self.args.quick, &self.args.knob)
    }

    fn train_work(&self, chain: bool) -> TrainWork<'_> {
        let Self { child, scorer, base, folder, .. } = self;
        TrainWork { child, scorer, base, folder, chain }
    }

    /// The trainings; and, when everything is swept, their default bakes.
    fn train(&mut self, observer: &mut dyn CostObserver) -> Result<(Group, Group)> {
        let settings = self.settings(CostStage::Train, CostInput::Photos);
        let whole = self.args.stage.is_none() && self.args.knob.is_empty();
        let outcomes = self.sweep(&settings, &mut self.train_work(whole), observer)?;
        let chain_of = |outcomes: &[Outcome]| -> Vec<Outcome> {
            outcomes.iter().filter_map(|outcome| outcome.chain.as_deref().cloned()).collect()
        };
        let chains = settings.iter().zip(&outcomes).filter(|_| whole);
        let chain = chains.map(|(setting, outcomes)| {
            let setting = Setting { stage: CostStage::Chain, ..setting.clone() };
            let (mut row, picture) = self.row(&setting, &chain_of(outcomes));
            if !row.is_default {
                row.knob = in_chain(CostStage::Train, &row.knob);
            }
            (row, picture)
        });
        let chain = chain.collect();
        let trained = settings.iter().zip(&outcomes).map(|(s, o)| self.row(s, o)).collect();
        Ok((finished(trained, observer), chain))
    }

    fn bake(&mut self, input: CostInput, soup: &Path, observer: &mut dyn CostObserver) -> Result<Group> {
        let loaded = formats::read(soup, &ReadOptions::with_degree(0))?;
        self.base.soup_triangles = loaded.scene.triangle_count() as u64;
        let Self { child, scorer, folder, .. } = &*self;
        let mut work = BakeWork { child, scorer, soup, folder, default_pictures: None };
        self.group(CostStage::Bake, input, &mut work, observer)
    }

    fn draw(&self, input: CostInput, scene: &Path, observer: &mut dyn CostObserver) -> Result<Group> {
        let mut work = DrawWork::new(&self.child, &self.scorer, scene, input, self.folder)?;
        self.group(CostStage::Draw, input, &mut work, observer)
    }

    fn group(
        &self,
        stage: CostStage,
        input: CostInput,
        work: &mut dyn Work,
        observer: &mut dyn CostObserver,
    ) -> Result<Group> {
        let settings = self.settings(stage, input);
        let outcomes = self.sweep(&settings, work, observer)?;
        let rows = settings.iter().zip(&outcomes).map(|(s, o)| self.row(s, o)).collect();
        Ok(finished(rows, observer))
    }

    fn sweep(
        &self,
        settings: &[Setting],
        work: &mut dyn Work,
        observer: &mut dyn CostObserver,
    ) -> Result<Vec<Vec<Outcome>>> {
        let runs = settings.first().map_or(0, |s| self.args.runs(s.stage));
        sweep(settings, runs, work, |done, all, setting| {
            observer.running(setting.stage, done, all, &setting.label());
        })
    }

    /// The row of a setting, and its picture.
    fn row(&self, setting: &Setting, outcomes: &[Outcome]) -> (CostRow, Option<Pixels>) {
        let picture = outcomes.first().and_then(|o| o.result.as_ref()).and_then(|r| r.picture.clone());
        let row = CostRow::new(&self.scene, setting, outcomes);
        (CostRow { photo_size: self.photo_size, ..row }, picture)
    }

    /// Writes what was asked for and returns the rows with what they were measured on.
    fn write(&self, groups: Vec<Group>) -> Result<Vec<MeasuredRow>> {
        let machine = Machine::here();
        let (rows, pictures): (Vec<CostRow>, Vec<Option<Pixels>>) = groups.into_iter().flatten().unzip();
        if let Some(path) = &self.args.csv {
            append_csv(path, &machine, &rows)?;
        }
        if let Some(path) = &self.args.plot {
            plot::plot(path, &rows)?;
        }
        let measured = |row: CostRow| MeasuredRow { machine: machine.clone(), row };
        let rows: Vec<MeasuredRow> = rows.into_iter().map(measured).collect();
        if let Some(path) = &self.args.page {
            page::write(path, &rows, &pictures, &self.scorer.photo()?)?;
        }
        Ok(rows)
    }
}

/// A group whose rows were compared with each other.
fn finished(group: Group, observer: &mut dyn CostObserver) -> Group {
    let (mut rows, pictures): (Vec<CostRow>, Vec<Option<Pixels>>) = group.into_iter().unzip();
    compare(&mut rows);
    observer.measured(&rows);
    rows.into_iter().zip(pictures).collect()
}
