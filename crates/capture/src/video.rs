//! Extracts photos from videos with an installed ffmpeg.
//!
//! It decodes a video twice: small and grey to choose frames, then the chosen ones at full size.

use super::frames::{FrameWatch, Grey, choose};
use super::logged::Log;
use super::step::{Step, tell};
use glam::UVec2;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use trisplat_scene::{
    Error,
    report::{StageEvent, StageObserver},
};

/// Longer side of analysed frames, px: a blur of a few video pixels is still visible.
const WATCHED_SIDE: u32 = 640;

/// An installed ffmpeg.
#[derive(Debug)]
pub(super) struct Ffmpeg {
    /// Options that output every frame exactly once.
    passthrough: [&'static str; 2],
}

impl Ffmpeg {
    /// Finds ffmpeg. `video` is named in the error.
    ///
    /// Errors: ffmpeg is not installed.
    pub(super) fn find(video: &Path) -> Result<Self, Error> {
        let output = Command::new("ffmpeg").arg("-version").stdin(Stdio::null()).output();
        let Some(output) = output.ok().filter(|output| output.status.success()) else {
            let reason = "is a video, and ffmpeg, which takes photos from it, is not installed: `sudo apt install ffmpeg` (Debian, Ubuntu), \
                          `brew install ffmpeg` (macOS), `winget install ffmpeg` (Windows); or give a folder of photos";
            return Err(Error::unsupported(video, reason));
        };
        let text = String::from_utf8_lossy(&output.stdout);
        let old = version(&text).is_some_and(|version| version < (5, 1));
        let passthrough = if old { ["-vsync", "passthrough"] } else { ["-fps_mode", "passthrough"] };
        Ok(Self { passthrough })
    }

    /// Writes the chosen frames of `video`, at most `most`, into `folder`. Returns their names and the video's frame count.
    pub(super) fn take(
        &self,
        video: &Path,
        folder: &Path,
        most: u32,
        log: &mut Log,
        observer: StageObserver<'_>,
    ) -> Step<(Vec<String>, u64)> {
        let frames = self.watch(video, log, observer)?.frames;
        let chosen = choose(&frames, most);
        if chosen.len() < 2 {
            let reason = "shows one place only: the camera does not move; walk around what is to be captured";
            return Err(Error::unsupported(video, reason).into());
        }
        let taken = format!("{} of {} frames are taken", chosen.len(), frames.len());
        tell(observer, StageEvent::Noted(&taken))?;
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let select: Vec<String> = chosen.iter().map(|i| format!("eq(n,{i})")).collect();
        let mut command = self.command(video);
        command.args(["-vf", &format!("select='{}'", select.join("+"))]).args(self.passthrough);
        command.args(["-q:v", "2", "-f", "image2"]).arg(folder.join("taken_%06d.jpg"));
        log.run_well(&mut command, observer, |_, _| Ok(()))?;
        let mut names = Vec::new();
        for (k, frame) in chosen.iter().enumerate() {
            let (from, name) =
                (folder.join(format!("taken_{:06}.jpg", k + 1)), format!("frame_{frame:06}.jpg"));
            std::fs::rename(&from, folder.join(&name)).map_err(|e| Error::io(&from, e))?;
            names.push(name);
        }
        Ok((names, frames.len() as u64))
    }

    /// Measures every frame.
    fn watch(&self, video: &Path, log: &mut Log, observer: StageObserver<'_>) -> Step<FrameWatch> {
        let side = WATCHED_SIDE;
        let scale = format!(
            "scale='min({side},iw)':'min({side},ih)':force_original_aspect_ratio=decrease:flags=area,format=gray"
        );
        let mut command = self.command(video);
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
        match watch.frames.is_empty() {
            true => Err(Error::unsupported(video, "holds no frame; give a video that plays").into()),
            false => Ok(watch),
        }
    }

    fn command(&self, video: &Path) -> Command {
        let mut command = Command::new("ffmpeg");
        command.args(["-nostdin", "-v", "error", "-i"]).arg(plain_path(video)).args(["-map", "0:v:0"]);
        command
    }
}

/// A path that ffmpeg cannot take for an option or a protocol.
fn plain_path(path: &Path) -> OsString {
    if path.is_absolute() { path.into() } else { PathBuf::from(".").join(path).into() }
}

/// "ffmpeg version 5.1.9-0..." as (5, 1); `None` for development builds, which are newer.
fn version(text: &str) -> Option<(u32, u32)> {
    let word = text.split_whitespace().nth(2)?;
    let mut numbers = word.trim_start_matches('n').split(|c: char| !c.is_ascii_digit());
    Some((numbers.next()?.parse().ok()?, numbers.next().and_then(|n| n.parse().ok()).unwrap_or(0)))
}

/// The next grey picture of a PGM stream; `None` at its end.
fn next_pgm(from: &mut impl BufRead) -> std::io::Result<Option<Grey>> {
    let invalid = || std::io::Error::new(std::io::ErrorKind::InvalidData, "ffmpeg sent no grey pictures");
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
    let (_, width, height, most) = (number(true)?, number(false)?, number(false)?, number(false)?);
    if most != 255 || width == 0 || height == 0 || width.max(height) > 4 * WATCHED_SIDE {
        return Err(invalid());
    }
    let mut codes = vec![0; (width * height) as usize];
    from.read_exact(&mut codes)?;
    Ok(Some(Grey { size: UVec2::new(width, height), codes }))
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
}
