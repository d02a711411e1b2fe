//! The rows of the table.

use super::front::{Quantity, front};
use super::knobs::{CostInput, CostStage};
use super::setting::Setting;
use super::sweep::{Outcome, RunResult};
use crate::bench::machine::Machine;
use crate::dataset::ShrunkSize;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One setting: what it costs and how close it comes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CostRow {
    /// The data set as given, or "synthetic".
    pub scene: String,
    /// The size that the photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default)]
    pub photo_size: Option<ShrunkSize>,
    /// The stage that ran.
    pub stage: CostStage,
    /// What it was given.
    pub input: CostInput,
    /// The options that differ from the defaults, by their names, joined by "+"; "default" where none does. For "chain"
    /// the stage comes first: "bake:max_triangles".
    pub knob: String,
    /// Their values, joined by "+".
    pub value: String,
    /// The defaults of these options, joined by "+".
    pub default_value: String,
    /// Whether nothing differs from the defaults.
    pub is_default: bool,
    /// Number of runs; those of a training have different seeds.
    pub runs: u64,
    /// User plus system seconds, median over the runs: of the whole process; of one picture for "draw".
    pub cpu_seconds: f64,
    /// Largest less smallest of these seconds over the runs; absent of one run.
    #[serde(default)]
    pub cpu_spread: Option<f64>,
    /// Seconds from start to end, median over the runs.
    pub wall_seconds: f64,
    /// Largest resident memory over the runs.
    pub peak_bytes: u64,
    /// Size of the files written; absent where none was.
    #[serde(default)]
    pub bytes: Option<u64>,
    /// Largest less smallest of these sizes over the runs; absent of one run.
    #[serde(default)]
    pub bytes_spread: Option<f64>,
    /// Triangles of the result.
    pub triangles: u64,
    /// PSNR on the held-out photos, dB, mean over photos and runs. Of a soup as an engine draws it, for "draw" as drawn.
    pub psnr: f64,
    /// Largest less smallest PSNR over the seeds; 0 where every run gives the same, absent where only one seed ran.
    #[serde(default)]
    pub psnr_spread: Option<f64>,
    /// SSIM in the convention of 3DGS.
    pub ssim: f64,
    /// Mean FLIP error; lower is better.
    pub flip: f64,
    /// Root mean square difference from the pictures of the exact answer, in levels of 8 bits; absent where there is
    /// none. Exact is for "draw" of a file 64 samples per pixel, of a soft soup nothing left out and the order of every
    /// pixel's own depths; for "bake" the default, which is not quantised.
    #[serde(default)]
    pub exact_rms: Option<f64>,
    /// CPU seconds over those of the default.
    pub cpu_ratio: f64,
    /// Whether the difference in seconds from the default is within the spread of the runs; absent of one run.
    #[serde(default)]
    pub cpu_within_spread: Option<bool>,
    /// PSNR less that of the default, dB.
    pub psnr_change: f64,
    /// Whether that difference is within the spread over seeds; absent where that is not known.
    #[serde(default)]
    pub psnr_within_spread: Option<bool>,
    /// Whether no other setting of this stage and input beats it: costs no more, errs no more, takes no more bytes, and
    /// is better in one of them by more than the spread.
    pub on_front: bool,
    /// The cheapest setting that beats it, as "knob=value"; absent on the front.
    #[serde(default)]
    pub beaten_by: Option<String>,
    /// What the dearer values buy besides seconds, bytes and error; empty for nothing else.
    pub buys: String,
    /// What was left out, separated by spaces: stages of the bake that had nothing to do; of training and soft drawing the share of each kind of work,
    /// as "layers=31%".
    pub skipped: String,
}

/// A row, and on what it was measured.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct MeasuredRow {
    /// Machine, date and commit.
    #[serde(flatten)]
    pub machine: Machine,
    /// The row.
    #[serde(flatten)]
    pub row: CostRow,
}

/// How far apart runs lie where there was only one: a share of the seconds, and dB over seeds.
const UNMEASURED: (f64, f64) = (0.05, 0.2);
/// Less than this is no difference, however well runs repeat: dB, a share of the bytes, levels of 8 bits.
const LEAST_DB: f64 = 0.01;
const LEAST_SHARE: f64 = 0.005;
const LEAST_LEVELS: f64 = 0.005;

impl CostRow {
    /// "steps=500", "steps+max_triangles=500+3000", "default".
    pub fn label(&self) -> String {
        if self.is_default { self.knob.clone() } else { format!("{}={}", self.knob, self.value) }
    }

    /// The row of a setting from its runs; ratios and the front come later.
    pub(super) fn new(scene: &str, setting: &Setting, outcomes: &[Outcome]) -> Self {
        let results: Vec<&RunResult> = outcomes.iter().filter_map(|o| o.result.as_ref()).collect();
        let mean = |of: fn(&RunResult) -> f64| {
            results.iter().map(|r| of(r)).sum::<f64>() / results.len().max(1) as f64
        };
        let of_runs = |of: fn(&Outcome) -> f64| outcomes.iter().map(of).collect::<Vec<f64>>();
        let cpu = of_runs(|o| o.usage.cpu_seconds);
        let psnr: Vec<f64> = results.iter().map(|r| r.scores.psnr).collect();
        let varies = matches!(setting.stage, CostStage::Train | CostStage::Chain);
        let first = results.first();
        Self {
            scene: scene.to_owned(),
            photo_size: None,
            stage: setting.stage,
            input: setting.input,
            knob: setting.knob(),
            value: setting.value(),
            default_value: setting.defaults.join("+"),
            is_default: setting.is_default(),
            runs: outcomes.len() as u64,
            cpu_seconds: median(cpu.clone()),
            cpu_spread: spread(&cpu),
            wall_seconds: median(of_runs(|o| o.usage.wall_seconds)),
            peak_bytes: outcomes.iter().map(|o| o.usage.peak_bytes).max().unwrap_or(0),
            bytes: outcomes.first().and_then(|o| o.bytes),
            bytes_spread: spread(
                &outcomes.iter().filter_map(|o| o.bytes).map(|b| b as f64).collect::<Vec<_>>(),
            ),
            triangles: first.map_or(0, |r| r.triangles),
            psnr: mean(|r| r.scores.psnr),
            psnr_spread: if varies { spread(&psnr) } else { Some(0.0) },
            ssim: mean(|r| r.scores.ssim),
            flip: mean(|r| r.scores.flip),
            exact_rms: first.and_then(|r| r.exact_rms),
            cpu_ratio: 1.0,
            cpu_within_spread: None,
            psnr_change: 0.0,
            psnr_within_spread: None,
            on_front: true,
            beaten_by: None,
            buys: setting.buys.to_owned(),
            skipped: first.map_or(String::new(), |r| r.skipped.join(" ")),
        }
    }

    /// The quantities of its stage's front: seconds, then bytes and error.
    fn quantities(&self) -> Vec<Quantity> {
        let of = |value: f64, spread: f64| Quantity { value, spread };
        let seconds = of(self.cpu_seconds, self.cpu_spread.unwrap_or(UNMEASURED.0 * self.cpu_seconds));
        let error = of(-self.psnr, self.psnr_spread.unwrap_or(UNMEASURED.1).max(LEAST_DB));
        let bytes = self.bytes.unwrap_or(0) as f64;
        let bytes = of(bytes, self.bytes_spread.unwrap_or(0.0).max(LEAST_SHARE * bytes));
        match self.stage {
            CostStage::Train => vec![seconds, error],
            CostStage::Draw => vec![seconds, of(self.exact_rms.unwrap_or(f64::NAN), LEAST_LEVELS)],
            CostStage::Bake | CostStage::Chain => vec![seconds, bytes, error],
        }
    }
}

/// Compares the rows of one stage and input with the default among them, and finds their front.
pub(super) fn compare(rows: &mut [CostRow]) {
    let points: Vec<Vec<Quantity>> = rows.iter().map(CostRow::quantities).collect();
    let labels: Vec<String> = rows.iter().map(CostRow::label).collect();
    for (row, beaten_by) in rows.iter_mut().zip(front(&points)) {
        row.on_front = beaten_by.is_none();
        row.beaten_by = beaten_by.map(|other| labels[other].clone());
    }
    let Some(default) = rows.iter().find(|r| r.is_default).cloned() else { return };
    let larger = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a.max(b));
    for row in rows.iter_mut() {
        row.cpu_ratio = row.cpu_seconds / default.cpu_seconds;
        row.psnr_change = row.psnr - default.psnr;
        if row.is_default {
            continue;
        }
        let seconds = (row.cpu_seconds - default.cpu_seconds).abs();
        row.cpu_within_spread = larger(row.cpu_spread, default.cpu_spread).map(|spread| seconds <= spread);
        let spread = larger(row.psnr_spread, default.psnr_spread);
        row.psnr_within_spread = spread.map(|spread| row.psnr_change.abs() <= spread.max(LEAST_DB));
    }
}

/// The rows from photos to a file with the default training and every bake: `chain`, which is the row of all defaults,
/// changed by as much as each bake differs from the default one on the same soup. The first of `bakes` is the default.
pub(super) fn chain_of_bakes(chain: &CostRow, bakes: &[CostRow]) -> Vec<CostRow> {
    let Some((default, others)) = bakes.split_first() else { return Vec::new() };
    let moved = |of: fn(&CostRow) -> f64, bake: &CostRow| of(chain) + of(bake) - of(default);
    let row = |bake: &CostRow| CostRow {
        stage: CostStage::Chain,
        input: CostInput::Photos,
        knob: in_chain(CostStage::Bake, &bake.knob),
        cpu_seconds: moved(|r| r.cpu_seconds, bake),
        wall_seconds: moved(|r| r.wall_seconds, bake),
        peak_bytes: chain.peak_bytes.max(bake.peak_bytes),
        psnr: moved(|r| r.psnr, bake),
        ssim: moved(|r| r.ssim, bake),
        flip: moved(|r| r.flip, bake),
        runs: chain.runs,
        cpu_spread: chain.cpu_spread,
        psnr_spread: chain.psnr_spread,
        exact_rms: None,
        ..bake.clone()
    };
    others.iter().map(row).collect()
}

/// Options of different stages are called alike: "bake:max_triangles".
pub(super) fn in_chain(stage: CostStage, knob: &str) -> String {
    format!("{}:{knob}", stage.name())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let count = values.len();
    match count {
        0 => f64::NAN,
        _ => (values[(count - 1) / 2] + values[count / 2]) / 2.0,
    }
}

/// Largest less smallest; `None` of fewer than two.
fn spread(values: &[f64]) -> Option<f64> {
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    (values.len() > 1).then_some(most - least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::measure::Usage;
    use crate::eval::evaluate::Scores;

    fn outcome(cpu_seconds: f64, psnr: f64) -> Outcome {
        let usage = Usage { wall_seconds: cpu_seconds / 2.0, cpu_seconds, peak_bytes: 10 };
        let scores = Scores { psnr, ssim: 0.9, flip: 0.1, ..Scores::default() };
        let result = RunResult { triangles: 7, scores, exact_rms: None, skipped: Vec::new(), picture: None };
        Outcome { usage, bytes: Some(100), result: Some(result), chain: None }
    }

    fn rows(settings: &[(&'static str, &[(f64, f64)])]) -> Vec<CostRow> {
        let default = Setting::default_of(CostStage::Train, CostInput::Photos);
        let row = |(name, runs): &(&'static str, &[(f64, f64)])| {
            let changes = if name.is_empty() { vec![] } else { vec![(*name, "x".to_owned())] };
            let setting = Setting { changes, ..default.clone() };
            let outcomes: Vec<Outcome> = runs.iter().map(|&(cpu, psnr)| outcome(cpu, psnr)).collect();
            CostRow::new("synthetic", &setting, &outcomes)
        };
        let mut rows: Vec<CostRow> = settings.iter().map(row).collect();
        compare(&mut rows);
        rows
    }

    #[test]
    fn seconds_are_medians_and_errors_means() {
        let row = &rows(&[("", &[(3.0, 20.0), (1.0, 21.0), (1.5, 25.0)])])[0];
        assert_eq!((row.cpu_seconds, row.cpu_spread), (1.5, Some(2.0)));
        assert_eq!((row.psnr, row.psnr_spread, row.runs), (22.0, Some(5.0), 3));
    }

    #[test]
    fn differences_below_the_spread_are_marked() {
        let runs = rows(&[
            ("", &[(10.0, 20.0), (10.1, 20.4)]),
            ("near", &[(10.02, 20.1), (10.05, 20.2)]),
            ("far", &[(5.0, 25.0), (5.1, 25.1)]),
        ]);
        let marks: Vec<_> = runs.iter().map(|r| (r.cpu_within_spread, r.psnr_within_spread)).collect();
        assert_eq!(marks, [(None, None), (Some(true), Some(true)), (Some(false), Some(false))]);
        assert!((runs[2].cpu_ratio - 0.5).abs() < 0.01 && (runs[2].psnr_change - 4.85).abs() < 1e-9);
    }

    #[test]
    fn one_run_has_no_spread_to_compare_with() {
        let runs = rows(&[("", &[(10.0, 20.0)]), ("a", &[(10.0, 20.0)])]);
        assert_eq!((runs[1].cpu_within_spread, runs[1].psnr_within_spread), (None, None));
    }

    #[test]
    fn a_default_is_not_beaten_by_what_the_table_marks_as_noise() {
        // Closer and cheaper, but by less than runs differ, and by a few bytes.
        let mut runs = rows(&[("", &[(10.0, 20.0), (10.4, 20.3)]), ("a", &[(9.9, 20.1), (10.2, 20.25)])]);
        for row in &mut runs {
            row.stage = CostStage::Chain;
        }
        runs[1].bytes = Some(99);
        (runs[0].bytes, runs[0].bytes_spread) = (Some(100), Some(3.0));
        compare(&mut runs);
        assert_eq!((runs[1].cpu_within_spread, runs[1].psnr_within_spread), (Some(true), Some(true)));
        assert_eq!(runs[0].beaten_by, None);
        // One run each: a few percent and hundredths of a dB are chance.
        let once = rows(&[("", &[(10.0, 20.0)]), ("a", &[(9.8, 20.05)])]);
        assert_eq!(once[0].beaten_by, None);
        let clear = rows(&[("", &[(10.0, 20.0)]), ("a", &[(8.0, 20.05)])]);
        assert_eq!(clear[0].beaten_by.as_deref(), Some("a=x"));
    }

    #[test]
    fn a_default_that_is_beaten_says_by_what() {
        let runs = rows(&[("", &[(10.0, 20.0)]), ("dear", &[(20.0, 21.0)]), ("good", &[(9.0, 20.5)])]);
        assert_eq!(runs[0].beaten_by.as_deref(), Some("good=x"));
        assert_eq!(runs.iter().map(|r| r.on_front).collect::<Vec<_>>(), [false, true, true]);
    }

    #[test]
    fn a_chain_changes_by_what_its_bake_changes() {
        let chain = rows(&[("", &[(10.0, 20.0), (11.0, 20.2)])]).remove(0);
        let bakes = rows(&[("", &[(1.0, 22.0)]), ("refit", &[(3.0, 23.0)])]);
        let rows = chain_of_bakes(&chain, &bakes);
        assert_eq!(rows.len(), 1);
        assert!((rows[0].cpu_seconds - 12.5).abs() < 1e-9 && (rows[0].psnr - 21.1).abs() < 1e-9);
        assert_eq!((rows[0].stage, rows[0].label()), (CostStage::Chain, "bake:refit=x".to_owned()));
        assert_eq!(rows[0].psnr_spread, chain.psnr_spread);
    }
}
