//! `trisplat bench cost`: prints rows during the run, and then the front.

use super::Global;
use super::files;
use super::progress::{Progress, thousands};
use crate::bench::cost::{self, CostArgs, CostInput, CostObserver, CostRow, CostStage};
use crate::dataset::ShrunkSize;
use crate::error::{Error, Result};

/// Runs the sweep.
pub(super) fn run(args: &CostArgs, global: &Global) -> Result<()> {
    let progress = Progress::new(global);
    let rows = cost::run(args, global.threads, &mut CostTable(&progress))?;
    let measured: Vec<CostRow> = rows.iter().map(|measured| measured.row.clone()).collect();
    advice(&measured).iter().for_each(|line| progress.line(line));
    progress.done();
    let print = |e| Error::io("-", e);
    if args.json { files::print_json(&rows, &mut std::io::stdout().lock()).map_err(print) } else { Ok(()) }
}

struct CostTable<'a>(&'a Progress);

impl CostObserver for CostTable<'_> {
    fn running(&mut self, stage: CostStage, done: usize, all: usize, setting: &str) {
        self.0.note(&format!("{}: {done} of {all} runs; now {setting}", stage.name()));
    }

    fn measured(&mut self, rows: &[CostRow]) {
        let Some(first) = rows.first() else { return };
        let size = ShrunkSize::beside(first.photo_size);
        self.0.line(&format!("{} ({}){size}", first.stage.name(), first.input.name()));
        self.0.line(HEADER);
        rows.iter().for_each(|row| self.0.line(&line(row)));
        summary(rows).into_iter().chain(as_dear_and_closer(rows)).for_each(|line| self.0.line(&line));
        self.0.line("");
    }
}

const HEADER: &str = "   setting                                    CPU s  x default  peak MB       bytes  PSNR dB   change    SSIM    FLIP  exact";

/// A row: `*` marks the front, `~` values within the spread.
fn line(row: &CostRow) -> String {
    let mark = |within: Option<bool>| if within == Some(true) { '~' } else { ' ' };
    let optional = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    format!(
        " {} {:<38}{:>10.4}{:>10.2}{}{:>9.1}{:>12}{:>9.3}{:>+8.3}{}{:>8.4}{:>8.4}{:>7}",
        if row.on_front { '*' } else { ' ' },
        row.label(),
        row.cpu_seconds,
        row.cpu_ratio,
        mark(row.cpu_within_spread),
        row.peak_bytes as f64 * 1e-6,
        optional(row.bytes.map(thousands)),
        row.psnr,
        row.psnr_change,
        mark(row.psnr_within_spread),
        row.ssim,
        row.flip,
        optional(row.exact_rms.map(|rms| format!("{rms:.2}"))),
    )
}

/// Least gain worth other settings, dB.
const CLOSER: f64 = 0.1;
/// Largest cost, as a multiple of the default's seconds.
const DEARER: f64 = 1.25;
/// Least saving worth other settings, as a share of the default's seconds.
const CHEAPER: f64 = 0.85;

/// Recommended settings for these photos, stage by stage, as lines.
fn advice(rows: &[CostRow]) -> Vec<String> {
    let mut lines = vec![String::from("what to use next on these photos:")];
    let mut told: Vec<(CostStage, CostInput)> = Vec::new();
    for row in rows {
        let key = (row.stage, row.input);
        if told.contains(&key) {
            continue;
        }
        told.push(key);
        let others = || rows.iter().filter(|r| (r.stage, r.input) == key && !r.is_default);
        let surely = |within: Option<bool>| within != Some(true);
        let closer = others()
            .filter(|r| r.psnr_change >= CLOSER && surely(r.psnr_within_spread) && r.cpu_ratio <= DEARER)
            .max_by(|a, b| a.psnr_change.total_cmp(&b.psnr_change));
        let cheaper = others()
            .filter(|r| r.cpu_ratio <= CHEAPER && surely(r.cpu_within_spread) && r.psnr_change > -CLOSER)
            .min_by(|a, b| a.cpu_ratio.total_cmp(&b.cpu_ratio));
        let said = |better: &str, row: Option<&CostRow>| {
            row.map(|r| {
                format!(
                    "{better} {} ({:+.2} dB, {:.2} times the seconds)",
                    r.label(),
                    r.psnr_change,
                    r.cpu_ratio
                )
            })
        };
        let found: Vec<String> =
            [said("for quality", closer), said("for speed", cheaper)].into_iter().flatten().collect();
        let found = match found.is_empty() {
            true => "the defaults: nothing that was tried is clearly better".to_owned(),
            false => found.join("; "),
        };
        lines.push(format!("   {} ({}): {found}", row.stage.name(), row.input.name()));
    }
    lines
}

/// Whether the default is on the front, and otherwise the settings that beat it.
fn summary(rows: &[CostRow]) -> Option<String> {
    let default = rows.iter().find(|r| r.is_default)?;
    let beaten = default.beaten_by.as_ref().and_then(|by| rows.iter().find(|r| r.label() == *by));
    let once = if default.runs < 2 { " (one run each: small differences may be chance)" } else { "" };
    let Some(better) = beaten else { return Some(format!("   no setting beats the default{once}")) };
    let percent = |ratio: f64| format!("{:+.1}%", 100.0 * (ratio - 1.0));
    let noise = |within: Option<bool>| if within == Some(true) { " (within the spread)" } else { "" };
    let (label, cost) = (better.label(), percent(better.cpu_ratio));
    let mut text =
        format!("   the default is off the front: {label} costs {cost}{}", noise(better.cpu_within_spread));
    if let (Some(bytes), Some(of)) = (better.bytes, default.bytes) {
        text += &format!(", takes {} bytes", percent(bytes as f64 / of.max(1) as f64));
    }
    text += &match (better.stage, better.exact_rms.zip(default.exact_rms)) {
        (CostStage::Draw, Some((exact, of))) => {
            format!(" and differs by {exact:.2} levels in place of {of:.2}")
        }
        _ => format!(" and comes {:+.3} dB closer{}", better.psnr_change, noise(better.psnr_within_spread)),
    };
    if !better.buys.is_empty() {
        text += &format!("; the default buys {}", better.buys);
    }
    Some(text + once)
}

/// Settings that cost as much as the default within the spread, and score higher by more than the spread.
fn as_dear_and_closer(rows: &[CostRow]) -> Option<String> {
    let closer = |r: &&CostRow| {
        let as_dear = r.cpu_within_spread == Some(true);
        as_dear && r.psnr_change > 0.0 && r.psnr_within_spread == Some(false)
    };
    let named = rows.iter().filter(closer).map(|r| format!("{} ({:+.3} dB)", r.label(), r.psnr_change));
    match named.collect::<Vec<_>>() {
        none if none.is_empty() => None,
        all => Some(format!("   within the spread of its seconds, and closer: {}", all.join(", "))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(knob: &str, is_default: bool) -> CostRow {
        CostRow {
            scene: "synthetic".into(),
            photo_size: None,
            bytes_spread: None,
            stage: CostStage::Bake,
            input: CostInput::SolidSoup,
            knob: knob.into(),
            value: "off".into(),
            default_value: "on".into(),
            is_default,
            runs: 3,
            cpu_seconds: 0.5,
            cpu_spread: Some(0.1),
            wall_seconds: 0.3,
            peak_bytes: 20_000_000,
            bytes: Some(1000),
            triangles: 10,
            psnr: 28.0,
            psnr_spread: Some(0.0),
            ssim: 0.9,
            flip: 0.1,
            exact_rms: None,
            cpu_ratio: 0.5,
            cpu_within_spread: Some(true),
            psnr_change: 0.25,
            psnr_within_spread: Some(false),
            on_front: !is_default,
            beaten_by: is_default.then(|| "order=off".into()),
            buys: "order".into(),
            skipped: "lod".into(),
        }
    }

    #[test]
    fn lines_are_as_wide_as_their_header_and_marked() {
        let text = line(&row("order", false));
        assert!(
            text.starts_with(" * order=off ") && text.contains("0.50~") && text.contains("+0.250 "),
            "{text}"
        );
        assert_eq!(text.chars().count(), HEADER.chars().count(), "{text}");
    }

    #[test]
    fn what_is_closer_at_the_same_cost_is_named() {
        let dearer = CostRow { cpu_within_spread: Some(false), ..row("dear", false) };
        let chance = CostRow { psnr_within_spread: Some(true), ..row("chance", false) };
        let text = as_dear_and_closer(&[dearer.clone(), row("refit", false), chance]);
        assert_eq!(text.unwrap(), "   within the spread of its seconds, and closer: refit=off (+0.250 dB)");
        assert_eq!(as_dear_and_closer(&[dearer]), None);
    }

    #[test]
    fn the_last_lines_say_what_to_use_next() {
        let text = advice(&[row("default", true), row("order", false)]);
        let wants = "for quality order=off (+0.25 dB, 0.50 times the seconds)";
        assert!(text[0].starts_with("what to use next") && text[1].contains(wants), "{text:?}");
        let summary = summary(&[row("default", true), row("order", false)]);
        assert!(
            text.iter().chain(&summary).all(|line| !line.contains('\n')),
            "a line break would be printed as \\n"
        );
        let chance = CostRow { psnr_within_spread: Some(true), cpu_ratio: 0.9, ..row("order", false) };
        let text = advice(&[row("default", true), chance]).pop().unwrap();
        assert!(text.ends_with("the defaults: nothing that was tried is clearly better"), "{text}");
    }

    #[test]
    fn the_summary_says_what_beats_the_default() {
        let text = summary(&[row("default", true), row("order", false)]);
        let wants = "   the default is off the front: order=off costs -50.0% (within the spread), takes +0.0% bytes and comes +0.250 dB closer; the default buys order";
        assert_eq!(text.unwrap(), wants);
        let alone = CostRow { beaten_by: None, ..row("default", true) };
        assert!(summary(&[alone]).unwrap().contains("no setting beats"));
    }
}
