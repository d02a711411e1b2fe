//! Extracts photos from videos with an installed ffmpeg, by camera motion and sharpness.
//!
//! A video is decoded twice: small and grey to choose frames, then the chosen ones at full size.

use super::log::{Log, full_path, program, said, tell};
use glam::{IVec2, UVec2};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Command;
use trisplat_scene::report::{StageEvent, StageObserver};
use trisplat_scene::{Error, Result};

/// The program's name.
pub(super) const FFMPEG: &str = "ffmpeg";
/// Longer side of analysed frames, px: a blur of a few video pixels is still visible.
const WATCHED_SIDE: u32 = 640;

/// Frames that were taken from a video.
#[derive(Debug, Default)]
pub(super) struct TakenFrames {
    /// In order of time.
    pub(super) names: Vec<String>,
    /// Number of frames of the video.
    pub(super) total: u64,
    pub(super) warning: Option<String>,
}

/// Transfer functions of HDR videos, as ffmpeg names them, and their usual names.
const HDR: [(&str, &str); 2] = [("arib-std-b67", "HLG"), ("smpte2084", "PQ")];
/// From HDR to the colours of photos: white is at 203 cd/m² (ITU-R BT.2408), and only what is
/// brighter than four fifths of it is compressed.
const TONE_MAP: &str = "zscale=t=linear:npl=203,format=gbrpf32le,zscale=p=bt709,tonemap=tonemap=mobius:param=0.8:desat=0,\
     zscale=t=bt709:m=bt709:r=tv,format=yuv420p";
/// Filter to square pixels; neither side gets fewer.
const SQUARE: &str =
    "scale='if(gt(sar,1),round(iw*sar),iw)':'if(gt(sar,1),ih,round(ih/sar))',setsar=1";

/// Filters that make frames of `video` what photos are, and a warning where this ffmpeg has none.
fn as_photos(video: &Path) -> Result<(Vec<&'static str>, Option<String>)> {
    let ask = |command: &mut Command| said(command).unwrap_or_default();
    let mut about = program(FFMPEG.as_ref());
    let about = ask(about.args(["-nostdin", "-hide_banner", "-i"]).arg(full_path(video)?));
    let stream = about.lines().find(|line| line.contains("Video:")).unwrap_or_default();
    let mut filters = Vec::new();
    let mut warning = None;
    if let Some((_, name)) = HDR.iter().find(|(transfer, _)| stream.contains(transfer)) {
        let has = ask(program(FFMPEG.as_ref()).args(["-hide_banner", "-filters"]));
        if has.contains(" zscale ") && has.contains(" tonemap ") {
            filters.push(TONE_MAP);
        } else {
            warning = Some(format!(
                "{} is an HDR video ({name}), and this ffmpeg cannot convert its colours, which stay pale: install one with \
                 zscale, or record without HDR",
                video.display()
            ));
        }
    }
    if !has_square_pixels(stream) {
        filters.push(SQUARE);
    }
    Ok((filters, warning))
}

/// True unless ffmpeg's line about a stream names another shape of pixels, as in "SAR 4:3".
fn has_square_pixels(stream: &str) -> bool {
    let shape = stream.split_once("SAR ").and_then(|(_, rest)| rest.split_once(' '));
    let sides = shape.and_then(|(sides, _)| sides.split_once(':'));
    sides.is_none_or(|(width, height)| width == height || [width, height].contains(&"0"))
}

/// An installed ffmpeg.
#[derive(Debug)]
pub(super) struct Ffmpeg {
    /// Options that output every frame exactly once.
    passthrough: [&'static str; 2],
}

impl Ffmpeg {
    /// Finds ffmpeg. `video` is named in the error.
    ///
    /// # Errors
    ///
    /// Ffmpeg is not installed.
    pub(super) fn find(video: &Path) -> Result<Self> {
        let text = said(program(FFMPEG.as_ref()).arg("-version"));
        let Some(text) = text.filter(|text| text.contains("ffmpeg version")) else {
            let reason = "is a video, and ffmpeg, which takes photos from it, is not installed: `sudo apt install ffmpeg` (Debian, Ubuntu), \
                          `brew install ffmpeg` (macOS), `winget install ffmpeg` (Windows); or give a folder of photos";
            return Err(Error::unsupported(video, reason));
        };
        let old = version(&text).is_some_and(|version| version < (5, 1));
        let passthrough =
            if old { ["-vsync", "passthrough"] } else { ["-fps_mode", "passthrough"] };
        Ok(Self { passthrough })
    }

    /// Writes the chosen frames of `video`, at most `most`, into `folder`; none of a camera that
    /// does not move.
    pub(super) fn take(
        &self,
        video: &Path,
        folder: &Path,
        most: u32,
        log: &mut Log,
        observer: StageObserver<'_>,
    ) -> Result<TakenFrames> {
        let frames = self.watch(video, log, observer)?.frames;
        let chosen = choose(&frames, most);
        if chosen.len() < 2 {
            return Ok(TakenFrames::default());
        }
        let taken = format!("{} of {} frames are taken", chosen.len(), frames.len());
        tell(observer, StageEvent::Noted(&taken))?;
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let select: Vec<String> = chosen.iter().map(|i| format!("eq(n,{i})")).collect();
        let (changes, warning) = as_photos(video)?;
        let mut filters = vec![format!("select='{}'", select.join("+"))];
        filters.extend(changes.into_iter().map(str::to_owned));
        let mut command = self.command(video)?;
        command.args(["-vf", &filters.join(",")]).args(self.passthrough);
        // A plain name: ffmpeg takes % in any part of it for a number, and a colon for a protocol.
        command.args(["-q:v", "2", "-f", "image2", "taken_%06d.jpg"]).current_dir(folder);
        log.run_well(&mut command, observer, |_, _| Ok(()))?;
        let mut names = Vec::new();
        for (k, frame) in chosen.iter().enumerate() {
            let from = folder.join(format!("taken_{:06}.jpg", k + 1));
            let name = format!("frame_{frame:06}.jpg");
            std::fs::rename(&from, folder.join(&name)).map_err(|e| Error::io(&from, e))?;
            names.push(name);
        }
        Ok(TakenFrames { names, total: frames.len() as u64, warning })
    }

    /// Measures every frame.
    fn watch(
        &self,
        video: &Path,
        log: &mut Log,
        observer: StageObserver<'_>,
    ) -> Result<FrameWatch> {
        let side = WATCHED_SIDE;
        let scale = format!(
            "scale='min({side},iw)':'min({side},ih)':force_original_aspect_ratio=decrease:flags=area,format=gray"
        );
        let mut command = self.command(video)?;
        command.args(["-vf", &scale]).args(self.passthrough);
        command.args(["-f", "image2pipe", "-c:v", "pgm", "-"]);
        let mut watch = FrameWatch::default();
        log.stream(&mut command, |from| {
            let mut from = BufReader::with_capacity(1 << 20, from);
            while let Some(frame) = next_pgm(&mut from).map_err(|e| Error::io(video, e))? {
                watch.add(&frame);
                let count = watch.frames.len();
                if count.is_multiple_of(30) {
                    let looking = format!("looking at frame {count} of {}", video.display());
                    tell(observer, StageEvent::Noted(&looking))?;
                } else {
                    tell(observer, StageEvent::Waiting)?;
                }
            }
            Ok(())
        })?;
        if watch.frames.is_empty() {
            Err(Error::unsupported(video, "holds no frame; give a video that plays"))
        } else {
            Ok(watch)
        }
    }

    fn command(&self, video: &Path) -> Result<Command> {
        let mut command = program(FFMPEG.as_ref());
        command
            .args(["-nostdin", "-v", "error", "-i"])
            .arg(full_path(video)?)
            .args(["-map", "0:v:0"]);
        Ok(command)
    }
}

/// "ffmpeg version 5.1.9-0..." as (5, 1); `None` for development builds, which are newer.
fn version(text: &str) -> Option<(u32, u32)> {
    let word = text.split_whitespace().nth(2)?;
    let mut numbers = word.trim_start_matches('n').split(|c: char| !c.is_ascii_digit());
    Some((numbers.next()?.parse().ok()?, numbers.next().and_then(|n| n.parse().ok()).unwrap_or(0)))
}

/// The next grey picture of a PGM stream; `None` at its end.
fn next_pgm(from: &mut impl BufRead) -> std::io::Result<Option<Grey>> {
    let invalid =
        || std::io::Error::new(std::io::ErrorKind::InvalidData, "ffmpeg sent no grey pictures");
    if from.fill_buf()?.is_empty() {
        return Ok(None);
    }
    let mut number = |first: bool| -> std::io::Result<u32> {
        let mut word = String::new();
        let mut byte = [0];
        loop {
            from.read_exact(&mut byte)?;
            match byte[0] {
                b' ' | b'\n' if word.is_empty() => {}
                b' ' | b'\n' => break,
                c if word.len() < 10 => word.push(char::from(c)),
                _ => return Err(invalid()),
            }
        }
        if first {
            (word == "P5").then_some(5).ok_or_else(invalid)
        } else {
            word.parse().map_err(|_| invalid())
        }
    };
    let _ = number(true)?;
    let width = number(false)?;
    let height = number(false)?;
    let most = number(false)?;
    if most != 255 || width == 0 || height == 0 || width.max(height) > 4 * WATCHED_SIDE {
        return Err(invalid());
    }
    let mut codes = vec![0; (width * height) as usize];
    from.read_exact(&mut codes)?;
    Ok(Some(Grey { size: UVec2::new(width, height), codes }))
}

/// Width of the pictures that motion is measured on, px.
const MOTION_SIDE: u32 = 160;
/// Side of matched blocks, px.
const BLOCK: u32 = 16;
/// Search radius for a block, px.
const REACH: i32 = 12;
/// Minimum contrast of a matched block: standard deviation, codes.
const MIN_CONTRAST: f32 = 4.0;
/// Motion from the reference, px, at which a frame becomes the next reference.
const NEXT_REFERENCE: f32 = 6.0;
/// Wanted motion between photos, as a share of the longer side: neighbours overlap by 95%.
const STEP: f32 = 0.05;
/// With fewer frames than this, the wanted motion shrinks, ...
const FEW: f32 = 40.0;
/// ... but not below this.
const MIN_STEP: f32 = 0.01;

/// A grey picture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Grey {
    pub(super) size: UVec2,
    pub(super) codes: Vec<u8>,
}

/// Measurements of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameNotes {
    /// Motion since the start of the video, as a multiple of the longer side.
    pub(super) moved: f32,
    /// Energy of the finest detail relative to contrast; comparable between neighbouring frames
    /// only.
    pub(super) sharpness: f32,
}

/// Measures the frames of a video one by one.
#[derive(Debug, Default)]
pub(super) struct FrameWatch {
    reference: Option<Grey>,
    /// Motion up to the reference.
    moved: f32,
    /// Motion of the last frame from the reference, px.
    last: IVec2,
    pub(super) frames: Vec<FrameNotes>,
}

impl Grey {
    /// Averages blocks of `by` × `by` pixels.
    fn reduced(&self, by: u32) -> Self {
        let size = (self.size / by).max(UVec2::ONE);
        let by = by.min(self.size.min_element());
        let mean = |i: u32| {
            let corner = UVec2::new(i % size.x, i / size.x) * by;
            let rows = (corner.y..corner.y + by).map(|y| (y * self.size.x + corner.x) as usize);
            let sum: u32 =
                rows.flat_map(|at| &self.codes[at..at + by as usize]).map(|&c| u32::from(c)).sum();
            (sum / (by * by)) as u8
        };
        Self { size, codes: (0..size.x * size.y).map(mean).collect() }
    }

    fn at(&self, x: u32, y: u32) -> f32 {
        f32::from(self.codes[(y * self.size.x + x) as usize])
    }
}

/// Mean square of second differences over that of first differences: blur lowers it first.
pub(super) fn sharpness(picture: &Grey) -> f32 {
    let mut second = 0.0f64;
    let mut first = 0.0f64;
    for y in 1..picture.size.y.saturating_sub(1) {
        for x in 1..picture.size.x.saturating_sub(1) {
            let at = |dx: u32, dy: u32| picture.at(x + dx - 1, y + dy - 1);
            let across = at(2, 1) - at(0, 1);
            let down = at(1, 2) - at(1, 0);
            let around = at(0, 1) + at(2, 1) + at(1, 0) + at(1, 2) - 4.0 * at(1, 1);
            second += f64::from(around * around);
            first += f64::from(across * across + down * down);
        }
    }
    (second / first.max(1.0)) as f32
}

impl FrameWatch {
    /// The next frame.
    pub(super) fn add(&mut self, frame: &Grey) {
        let sharpness = sharpness(frame);
        let small = frame.reduced((frame.size.max_element() / MOTION_SIDE).max(1));
        let side = small.size.max_element() as f32;
        let motion =
            self.reference.as_ref().and_then(|reference| motion(reference, &small, self.last));
        let length = motion.map_or(0.0, |motion| motion.as_vec2().length());
        self.frames.push(FrameNotes { moved: self.moved + length / side, sharpness });
        self.last = motion.unwrap_or(IVec2::ZERO);
        // A frame that no longer overlaps the reference starts a new one.
        if self.reference.is_none() || length >= NEXT_REFERENCE || motion.is_none() {
            self.reference = Some(small);
            self.last = IVec2::ZERO;
            self.moved += length / side;
        }
    }
}

/// Median motion of blocks between two pictures, px per axis, searched around `guess`.
/// `None` when no block has contrast.
fn motion(from: &Grey, to: &Grey, guess: IVec2) -> Option<IVec2> {
    if from.size != to.size {
        return None;
    }
    let corners = (0..from.size.y / BLOCK)
        .flat_map(|y| (0..from.size.x / BLOCK).map(move |x| UVec2::new(x, y) * BLOCK))
        .filter(|corner| contrast(from, *corner) >= MIN_CONTRAST);
    let found: Vec<IVec2> =
        corners.filter_map(|corner| block_motion(from, to, corner, guess)).collect();
    let middle = |of: fn(&IVec2) -> i32| {
        let mut values: Vec<i32> = found.iter().map(of).collect();
        values.sort_unstable();
        values.get(values.len() / 2).copied()
    };
    Some(IVec2::new(middle(|m| m.x)?, middle(|m| m.y)?))
}

fn contrast(picture: &Grey, corner: UVec2) -> f32 {
    let values = (0..BLOCK * BLOCK)
        .map(|i| picture.at(corner.x + i % BLOCK, corner.y + i / BLOCK))
        .collect::<Vec<_>>();
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / values.len() as f32).sqrt()
}

/// Best match of a block: every second pixel first, then around the best.
fn block_motion(from: &Grey, to: &Grey, corner: UVec2, guess: IVec2) -> Option<IVec2> {
    let best_of = |candidates: &mut dyn Iterator<Item = IVec2>| {
        candidates.filter_map(|by| Some((difference(from, to, corner, by)?, by))).min_by_key(
            |(d, by)| {
                // Ties: the smallest motion.
                (*d, (*by - guess).length_squared(), by.x, by.y)
            },
        )
    };
    let steps = || (-REACH..=REACH).step_by(2);
    let (_, coarse) =
        best_of(&mut steps().flat_map(|y| steps().map(move |x| guess + IVec2::new(x, y))))?;
    let near = -1..=1;
    let mut around =
        near.clone().flat_map(|y| near.clone().map(move |x| coarse + IVec2::new(x, y)));
    best_of(&mut around).map(|(_, by)| by)
}

/// Difference of a block moved `by`; `None` outside the picture.
fn difference(from: &Grey, to: &Grey, corner: UVec2, by: IVec2) -> Option<u32> {
    let moved = corner.as_ivec2() + by;
    let fits = moved.min_element() >= 0 && (moved + BLOCK as i32).cmple(to.size.as_ivec2()).all();
    if !fits {
        return None;
    }
    let row = |picture: &Grey, x: u32, y: u32| (y * picture.size.x + x) as usize;
    let moved = moved.as_uvec2();
    let rows = (0..BLOCK).map(|y| {
        let a = &from.codes[row(from, corner.x, corner.y + y)..][..BLOCK as usize];
        let b = &to.codes[row(to, moved.x, moved.y + y)..][..BLOCK as usize];
        a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>()
    });
    Some(rows.sum())
}

/// The chosen frames, at most `most`: the sharpest of each window of equal motion.
pub(super) fn choose(frames: &[FrameNotes], most: u32) -> Vec<usize> {
    let Some(last) = frames.last() else { return Vec::new() };
    let few = FEW.min(most as f32);
    let step = STEP.min(last.moved / few).max(MIN_STEP).max(last.moved / (most.max(2) - 1) as f32);
    let mut chosen: Vec<usize> = Vec::new();
    let mut window = 0;
    while window < frames.len() {
        let number = (frames[window].moved / step).round();
        let end = (window..frames.len())
            .find(|&i| (frames[i].moved / step).round() > number)
            .unwrap_or(frames.len());
        // Ties: the first.
        let best = (window..end)
            .rev()
            .max_by(|&a, &b| frames[a].sharpness.total_cmp(&frames[b].sharpness));
        // Two windows may choose the same frame at their common edge.
        match (best, chosen.last().copied()) {
            (Some(best), Some(before))
                if frames[best].moved - frames[before].moved < step / 3.0 =>
            {
                if frames[best].sharpness > frames[before].sharpness {
                    chosen.pop();
                    chosen.push(best);
                }
            }
            (best, _) => chosen.extend(best),
        }
        window = end;
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_numbers_or_new() {
        assert_eq!(version("ffmpeg version 5.1.9-0+deb12u1 Copyright"), Some((5, 1)));
        assert_eq!(version("ffmpeg version n4.4 Copyright"), Some((4, 4)));
        assert_eq!(version("ffmpeg version N-109542-g2ee5"), None);
    }

    #[test]
    fn pixels_of_another_shape_are_told_from_square_ones() {
        let stream =
            |shape: &str| format!("Stream #0:0: Video: h264, yuv420p(tv), 720x576{shape}, 25 fps");
        for (shape, is_square) in [
            ("", true),
            (" [SAR 1:1 DAR 5:4]", true),
            (" [SAR 0:1 DAR 0:1]", true),
            (" [SAR 64:45 DAR 16:9]", false),
            (", SAR 8:9 DAR 4:3", false),
        ] {
            assert_eq!(has_square_pixels(&stream(shape)), is_square, "{shape}");
        }
    }

    #[test]
    fn grey_pictures_come_one_by_one() {
        let stream = b"P5\n2 1\n255\nabP5\n1 2\n255\ncd";
        let mut from = &stream[..];
        let first = next_pgm(&mut from).unwrap().unwrap();
        assert_eq!((first.size, first.codes.as_slice()), (UVec2::new(2, 1), &b"ab"[..]));
        assert_eq!(next_pgm(&mut from).unwrap().unwrap().codes, b"cd");
        assert_eq!(next_pgm(&mut from).unwrap(), None);
        assert!(next_pgm(&mut &b"P6\n1 1\n255\nabc"[..]).is_err());
        assert!(next_pgm(&mut &b"P5\n2 2\n255\nab"[..]).is_err(), "cut short");
    }

    /// A texture without repetition, shifted by `left` px.
    fn frame(left: f32, blurred: bool) -> Grey {
        let size = UVec2::new(320, 200);
        let code = |x: f32, y: f32| {
            128.0
                + 50.0 * (x / 7.3).sin() * (y / 9.1).cos()
                + 40.0 * ((x + 2.0 * y) / 23.7).sin()
                + 25.0 * (x * 0.9 + y * 0.7).sin()
        };
        let pixel = |i: u32| {
            let x = (i % size.x) as f32 + left;
            let y = (i / size.x) as f32;
            let around = if blurred { -4..=4 } else { 0..=0 };
            let count = around.clone().count() as f32;
            (around.map(|d| code(x + d as f32, y)).sum::<f32>() / count) as u8
        };
        Grey { size, codes: (0..size.x * size.y).map(pixel).collect() }
    }

    #[test]
    fn motion_adds_up_however_slow_it_is() {
        for pixels_per_frame in [0.5f32, 2.0, 9.0] {
            let count = (160.0 / pixels_per_frame) as usize;
            let mut watch = FrameWatch::default();
            (0..=count).for_each(|i| watch.add(&frame(i as f32 * pixels_per_frame, false)));
            let moved = watch.frames.last().unwrap().moved;
            let truth = count as f32 * pixels_per_frame / 320.0;
            assert!((moved - truth).abs() < 0.1 * truth, "{pixels_per_frame}: {moved} of {truth}");
        }
    }

    #[test]
    fn video_gives_the_sharpest_frame_of_each_window() {
        let mut watch = FrameWatch::default();
        (0..20).for_each(|_| watch.add(&frame(0.0, false)));
        assert_eq!(choose(&watch.frames, 150).len(), 1);
        let mut watch = FrameWatch::default();
        (0..161).for_each(|i| watch.add(&frame(4.0 * i as f32, i % 4 != 0)));
        let chosen = choose(&watch.frames, 150);
        assert!((25..=50).contains(&chosen.len()), "{chosen:?}");
        // Every fourth is sharp; a window where motion is found in larger steps may hold none of
        // these.
        let blurred = chosen.iter().filter(|i| *i % 4 != 0).count();
        assert!(10 * blurred <= chosen.len(), "{chosen:?}");
        assert!(choose(&watch.frames, 10).len() <= 10);
        assert!(choose(&[], 10).is_empty());
    }
}
