//! `trisplat bench stress`, printed.

use super::Global;
use super::counts::thousands;
use super::files;
use super::files::Stdout;
use super::progress::Progress;
use std::path::Path;
use trisplat_bench::{
    stress::case::StressCase,
    stress::{self, InvarianceRow, Part, PromiseResult, StressArgs, StressReport, StressRow},
};
use trisplat_scene::{Error, Result, atomic::AtomicFile};

/// Measures and prints; an error when a promise is broken.
pub(super) fn run(args: &StressArgs, global: &Global) -> Result<()> {
    if let Some(path) = &args.replay {
        return replay(path);
    }
    let report = stress::run(args)?;
    if args.json {
        files::print_json(&report, &mut Stdout).map_err(|e| Error::io("-", e))?;
    } else {
        print(&report, &Progress::new(global));
    }
    verdict(&report, &args.worst)
}

/// An error when a promise is broken; its worst case is written to `worst`.
fn verdict(report: &StressReport, worst: &Path) -> Result<()> {
    if let Some(InvarianceRow { name, value, at_most, .. }) = report.invariances.iter().find(|row| !row.kept)
    {
        let found = value.p999;
        let what = format!("the promise \"{name}\" is broken: {found:.3e}, at most {at_most:.1e}");
        return Err(Error::Incomplete(what));
    }
    let Some(promise) = report.promises.iter().find(|p| !p.kept) else { return Ok(()) };
    let PromiseResult { name, failures, of, rate_at_most, found, at_most, .. } = promise;
    let what = format!(
        "the promise \"{name}\" is broken: {failures} of {of} fail, a share of {rate_at_most:.0e} may; worst {found:.3e}, at most {at_most:.1e}"
    );
    let Some(case) = &promise.worst else { return Err(Error::Incomplete(what)) };
    files::save_json(case, AtomicFile::create(worst)?)?;
    let file = worst.display();
    let remedy = format!("`trisplat bench stress --replay {file}` draws it again");
    Err(Error::Incomplete(format!("{what}; the worst case is in {file}: {remedy}")))
}

/// Prints the result of a case from a file; an error when it fails a promise.
fn replay(path: &Path) -> Result<()> {
    let case = read_case(path)?;
    let found = stress::replay(&case)?;
    files::print_json(&found, &mut Stdout).map_err(|e| Error::io("-", e))?;
    stress::broken(&case, &found).map_or(Ok(()), |what| Err(Error::Incomplete(what)))
}

/// Whether a file holds a case, as an earlier run wrote it.
pub(super) fn is_case(path: &Path) -> bool {
    read_case(path).is_ok()
}

fn read_case(path: &Path) -> Result<StressCase> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    serde_json::from_str(&text).map_err(|e| {
        let at = format!("line {}, column {}", e.line(), e.column());
        Error::malformed(path, at, format!("{e}; a case is {{\"seed\": 1, \"axes\": {{\"sigma\": 0.5}}}}"))
    })
}

fn print(report: &StressReport, progress: &Progress) {
    progress.line(
        "axis            from        to      cases   drawn  undecided    value p50    p99.9      max   gradient p50    p99.9      max  non-finite  solid  time",
    );
    for row in report.rows.iter().filter(|row| !matches!(row.part, Part::Pair { .. })) {
        progress.line(&row_line(row));
    }
    progress.line("");
    progress.line("must not change     cases    p50      p99.9      max   at most   other faces");
    report.invariances.iter().for_each(|row| progress.line(&invariance_line(row)));
    progress.line("");
    progress.line("promise               worst   at most    failures          of  share below  may be");
    report.promises.iter().for_each(|row| progress.line(&promise_line(row)));
    progress.line(&format!(
        "{} cases in {:.1} s; the ordinary one takes {:.1} µs",
        thousands(report.cases),
        report.wall_seconds,
        report.ordinary_seconds * 1e6,
    ));
    progress.done();
}

fn row_line(row: &StressRow) -> String {
    let part = match &row.part {
        Part::Single { axis, from, to } => format!("{:<12}{from:>9.1e}{to:>10.1e}", axis.row().name),
        Part::Pair { axis, with } => format!("{:<12}{:>19}", axis.row().name, with.row().name),
        Part::Domain => format!("{:<31}", "domain, all axes"),
    };
    let (v, g) = (&row.value, &row.gradient);
    format!(
        "{part}{:>11}{:>8}{:>10.2}%{:>13.1e}{:>9.1e}{:>9.1e}{:>15.1e}{:>9.1e}{:>9.1e}{:>12}{:>7}{:>6.1}",
        thousands(row.cases),
        thousands(row.drawn),
        100.0 * row.undecided,
        v.p50,
        v.p999,
        v.max,
        g.p50,
        g.p999,
        g.max,
        row.non_finite,
        row.solid_wrong,
        row.time_ratio,
    )
}

fn invariance_line(row: &InvarianceRow) -> String {
    let v = &row.value;
    let kept = if row.kept { "" } else { "  BROKEN" };
    format!(
        "{:<15}{:>10}{:>9.1e}{:>9.1e}{:>9.1e}{:>9.1e}{:>13.3}%{kept}",
        row.name,
        thousands(row.cases),
        v.p50,
        v.p999,
        v.max,
        row.at_most,
        100.0 * row.solid_changed,
    )
}

fn promise_line(row: &PromiseResult) -> String {
    let kept = if row.kept { "" } else { "  BROKEN" };
    format!(
        "{:<18}{:>9.2e}{:>10.1e}{:>12}{:>12}{:>13.1e}{:>8.0e}{kept}",
        row.name,
        row.found,
        row.at_most,
        thousands(row.failures),
        thousands(row.of),
        row.rate_below,
        row.rate_at_most,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn a_broken_promise_is_an_error_and_its_case_can_be_drawn_again() {
        let args = StressArgs {
            cases: 200,
            seed: 3,
            seeds: 2,
            climb: 10,
            worst: PathBuf::new(),
            replay: None,
            json: false,
        };
        let mut report = stress::run(&args).unwrap();
        report.promises.retain(|p| p.name == "worst_frame");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("worst.json");
        assert!(verdict(&report, &path).is_ok() && !path.exists());
        report.promises[0].kept = false;
        let message = verdict(&report, &path).unwrap_err().to_string();
        assert!(message.starts_with("the promise \"worst_frame\" is broken: "), "{message}");
        assert!(message.contains("--replay"), "{message}");
        let found = stress::replay(&read_case(&path).unwrap()).unwrap();
        assert_eq!(found["worst_frame"], report.promises[0].found);
        report.invariances[0].kept = false;
        let message = verdict(&report, &path).unwrap_err().to_string();
        assert!(message.starts_with("the promise \"rotation\" is broken: "), "{message}");
    }

    #[test]
    fn a_replay_of_a_failing_case_is_an_error() {
        // The search can find a pixel on the wrong side of a jump.
        let args = StressArgs {
            cases: 200,
            seed: 3,
            seeds: 1,
            climb: 4000,
            worst: PathBuf::new(),
            replay: None,
            json: false,
        };
        let report = stress::run(&args).unwrap();
        let worst = report.promises.into_iter().find(|p| p.name == "worst_frame").unwrap();
        assert!(worst.found > worst.at_most, "{worst:?}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("case.json");
        std::fs::write(&path, serde_json::to_string(&worst.worst).unwrap()).unwrap();
        let told = replay(&path).unwrap_err().to_string();
        assert!(told.contains("the case fails the promise"), "{told}");
        let ordinary = "{\"seed\": 3}";
        std::fs::write(&path, ordinary).unwrap();
        let told = replay(&path).err().map(|error| error.to_string()).unwrap_or_default();
        // Times are of a machine that does other work as well.
        assert!(told.is_empty() || told.contains("time"), "{told}");
    }

    #[test]
    fn a_file_that_holds_no_case_is_named_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("case.json");
        std::fs::write(&path, "{\"seed\": 1,\n \"axes\": {\"sigmas\": 1}}").unwrap();
        let message = read_case(&path).unwrap_err().to_string();
        assert!(message.contains("case.json: line 2") && message.contains("a case is"), "{message}");
    }
}
