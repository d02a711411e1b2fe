//! `trisplat bench cost`: prints cells during the run, then the recommended settings.

use super::Global;
use super::counts::{many, thousands};
use super::files;
use super::progress::Progress;
use trisplat_bench::cost::{self, CostArgs, CostCell, CostEvent, CostReport};
use trisplat_dataset::ShrunkSize;
use trisplat_scene::{Error, Result};

/// Trains the grid.
pub(super) fn run(args: &CostArgs, global: &Global) -> Result<()> {
    let progress = Progress::new(global);
    progress.line("   steps  triangles     CPU s  PSNR dB    SSIM   of each seed");
    let report = cost::run(args, &mut |event| match event {
        CostEvent::Begins { steps, max_triangles, seed } => {
            let most = thousands(max_triangles);
            progress.note(&format!("training: {steps} steps, {most} triangles, seed {seed}"));
        }
        CostEvent::Measured(cell) => progress.line(&line(cell)),
    })?;
    progress.line("");
    summary(&report).iter().for_each(|line| progress.line(line));
    progress.done();
    let print = |e| Error::io("-", e);
    if args.json { files::print_json(&report, &mut std::io::stdout().lock()).map_err(print) } else { Ok(()) }
}

/// A cell, without its band, which all cells decide.
fn line(cell: &CostCell) -> String {
    let each: Vec<String> = cell.runs.iter().map(|run| format!("{:.2}", run.psnr)).collect();
    format!(
        "{:>8}{:>11}{:>10.1}{:>9.2}{:>8.4}   {}",
        cell.steps,
        thousands(cell.max_triangles),
        cell.cpu_seconds,
        cell.psnr,
        cell.ssim,
        each.join(" ")
    )
}

/// What was measured with, the front with its bands, and the settings to use.
fn summary(report: &CostReport) -> Vec<String> {
    let size = ShrunkSize::beside(report.photo_size);
    let photos =
        format!("{} trained on, {} watched{size}", many(report.photos, "photo"), report.watched.len());
    let mut front: Vec<&CostCell> = report.cells.iter().filter(|cell| cell.on_front).collect();
    front.sort_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds));
    let row = |cell: &&CostCell| {
        let band = cell.psnr_band.map_or(String::new(), |band| format!(" ± {band:.2}"));
        format!("   {:>8.1} CPU s  {:.2}{band} dB  {}", cell.cpu_seconds, cell.psnr, cell.options())
    };
    let mut lines = vec![format!("{photos}; nothing that costs no more comes closer than:")];
    lines.extend(front.iter().map(row));
    lines.push(report.advice.sentence.clone());
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_bench::cost::{CostAdvice, CostRun};
    use trisplat_bench::machine::Machine;

    #[test]
    fn the_last_line_says_what_to_use() {
        let run = CostRun { seed: 0, cpu_seconds: 2.0, triangles: 90, psnr: 21.5, ssim: 0.8 };
        let cell = CostCell {
            steps: 500,
            max_triangles: 3000,
            cpu_seconds: 2.0,
            psnr: 21.5,
            psnr_band: Some(0.125),
            ssim: 0.8,
            on_front: true,
            runs: vec![run.clone(), CostRun { seed: 1, psnr: 21.75, ..run }],
        };
        assert_eq!(line(&cell), "     500      3,000       2.0    21.50  0.8000   21.50 21.75");
        let advice = CostAdvice {
            steps: 500,
            max_triangles: 3000,
            cpu_seconds: 2.0,
            psnr: 21.5,
            psnr_band: Some(0.125),
            gain_of_twice_the_time: None,
            sentence: "use it".into(),
        };
        let report = CostReport {
            machine: Machine { date: String::new(), commit: String::new(), cpu: String::new() },
            dataset: "photos".into(),
            photo_size: None,
            photos: 10,
            watched: vec!["a".into(), "b".into()],
            budget: 3.0,
            cells: vec![CostCell { on_front: false, ..cell.clone() }, cell],
            advice,
        };
        let lines = summary(&report);
        assert_eq!(lines.len(), 3, "{lines:?}");
        assert!(lines[0].starts_with("10 photos trained on, 2 watched; "), "{}", lines[0]);
        assert_eq!(lines[1].trim(), "2.0 CPU s  21.50 ± 0.12 dB  --steps 500 --max-triangles 3000");
        assert_eq!(lines[2], "use it");
    }
}
