//! Runs the settings of a stage in turn.

use super::setting::Setting;
use crate::bench::measure::Usage;
use crate::error::Result;
use crate::eval::evaluate::Scores;
use crate::image::Pixels;

/// What one run of a setting cost and came to.
#[derive(Debug, Clone)]
pub(super) struct Outcome {
    pub(super) usage: Usage,
    /// Size of the file, where one was written.
    pub(super) bytes: Option<u64>,
    /// How close it came; not measured again where every run leaves the same bits.
    pub(super) result: Option<RunResult>,
    /// The same with the default of the stage behind it, from photos to a file.
    pub(super) chain: Option<Box<Outcome>>,
}

/// How close a run came.
#[derive(Debug, Clone)]
pub(super) struct RunResult {
    pub(super) triangles: u64,
    pub(super) scores: Scores,
    /// Root mean square difference from the exact answer, in levels of 8 bits, where there is one.
    pub(super) exact_rms: Option<f64>,
    /// Names of the stages that had nothing to do.
    pub(super) skipped: Vec<String>,
    /// The first held-out view.
    pub(super) picture: Option<Pixels>,
}

/// Runs a setting.
pub(super) trait Work {
    /// Run number `run` of a setting.
    fn run(&mut self, setting: &Setting, run: usize) -> Result<Outcome>;
}

/// Run 0 of every setting, then run 1 of every setting, ...; the outcomes of each setting in order. Calls `on_run`
/// with how many runs are done, and of how many, before each.
pub(super) fn sweep(
    settings: &[Setting],
    runs: usize,
    work: &mut dyn Work,
    mut on_run: impl FnMut(usize, usize, &Setting),
) -> Result<Vec<Vec<Outcome>>> {
    let mut outcomes: Vec<Vec<Outcome>> = settings.iter().map(|_| Vec::new()).collect();
    for run in 0..runs {
        for (i, (setting, outcomes)) in settings.iter().zip(&mut outcomes).enumerate() {
            on_run(run * settings.len() + i, runs * settings.len(), setting);
            outcomes.push(work.run(setting, run)?);
        }
    }
    Ok(outcomes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::cost::knobs::{CostInput, CostStage};

    struct Recorder(Vec<(String, usize)>);

    impl Work for Recorder {
        fn run(&mut self, setting: &Setting, run: usize) -> Result<Outcome> {
            self.0.push((setting.knob(), run));
            let usage = Usage { wall_seconds: 1.0, cpu_seconds: self.0.len() as f64, peak_bytes: 1 };
            Ok(Outcome { usage, bytes: None, result: None, chain: None })
        }
    }

    #[test]
    fn settings_take_turns() {
        let default = Setting::default_of(CostStage::Draw, CostInput::File);
        let other = Setting { changes: vec![("ssaa", "1".into())], ..default.clone() };
        let (mut work, mut said) = (Recorder(Vec::new()), Vec::new());
        let settings = [default, other];
        let outcomes = sweep(&settings, 2, &mut work, |done, all, _| said.push((done, all))).unwrap();
        let order: Vec<(&str, usize)> = work.0.iter().map(|(knob, run)| (knob.as_str(), *run)).collect();
        assert_eq!(order, [("default", 0), ("ssaa", 0), ("default", 1), ("ssaa", 1)]);
        assert_eq!(said, [(0, 4), (1, 4), (2, 4), (3, 4)]);
        let cpu = |i: usize| outcomes[i].iter().map(|o| o.usage.cpu_seconds).collect::<Vec<_>>();
        assert_eq!((cpu(0), cpu(1)), (vec![1.0, 3.0], vec![2.0, 4.0]));
    }
}
