//! Videos, encoded by ffmpeg if it is installed.

use std::borrow::Cow;
use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use super::format::FilmOptions;
use crate::base::bytes::Output;
use crate::base::error::{Error, Result};

/// The program that codes videos.
const PROGRAM: &str = "ffmpeg";

/// A video that ffmpeg is writing. Raw frames go to its standard input.
pub struct VideoFilm {
    child: Ended,
    output: Output,
    path: PathBuf,
    /// Pixels along a row, and rows, before an edge is repeated.
    size: [usize; 2],
}

/// Bytes of a pixel.
const PIXEL: usize = 3;

/// A picture with its last column and row repeated if their number is odd.
fn even(values: &[u8], [width, height]: [usize; 2]) -> Cow<'_, [u8]> {
    if width.is_multiple_of(2) && height.is_multiple_of(2) {
        return Cow::Borrowed(values);
    }
    let mut padded = Vec::with_capacity((width + 1) * (height + 1) * PIXEL);
    let rows = values.chunks_exact(width * PIXEL);
    let last = rows.clone().last().filter(|_| !height.is_multiple_of(2));
    for row in rows.chain(last) {
        padded.extend_from_slice(row);
        if !width.is_multiple_of(2) {
            padded.extend_from_slice(&row[row.len() - PIXEL..]);
        }
    }
    Cow::Owned(padded)
}

/// A program that is ended with its owner.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

impl VideoFilm {
    pub fn start(
        output: Output,
        path: &Path,
        kind: &'static str,
        options: FilmOptions,
    ) -> Result<Self> {
        // Players expect colours at half the size, so both sides need an even number of pixels.
        let [width, height] = options.size.map(|side| side.next_multiple_of(2));
        let mut command = Command::new(PROGRAM);
        command.args(["-loglevel", "error", "-nostdin", "-y", "-f", "rawvideo"]);
        command.args(["-pixel_format", "rgb24", "-video_size", &format!("{width}x{height}")]);
        command.args(["-framerate", &options.rate.to_string(), "-i", "pipe:0"]);
        // Unless a file states it, players assume BT.709 for large pictures and BT.601 for small
        // ones.
        command.args(["-vf", "scale=out_color_matrix=bt709:out_range=tv", "-pix_fmt", "yuv420p"]);
        command.args(["-colorspace", "bt709", "-color_primaries", "bt709"]);
        command.args(["-color_trc", "bt709", "-color_range", "tv"]);
        if kind != "webm" {
            // The frame table comes first, so that a page plays the file while it loads.
            command.args(["-movflags", "+faststart"]);
        }
        // Without the prefix, a colon in a folder's name would start a protocol.
        let mut written = OsString::from("file:");
        written.push(output.written());
        command.args(["-f", kind]).arg(written);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        // Ctrl-C in a terminal should reach only this program.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command.spawn().map_err(|error| missing(&error, path))?;
        Ok(Self { child: Ended(child), output, path: path.to_owned(), size: options.size })
    }

    pub fn add(&mut self, values: &[u8]) -> Result<()> {
        let input = self.child.0.stdin.as_mut();
        let values = even(values, self.size);
        match input.map_or(Ok(()), |input| input.write_all(&values)) {
            Ok(()) => Ok(()),
            // It ended early, with a reason.
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {
                self.wait().and(Err(Error::io(error, &self.path)))
            }
            Err(error) => Err(Error::io(error, &self.path)),
        }
    }

    pub fn finish(mut self) -> Result<()> {
        self.wait()?;
        self.output.finish()
    }

    /// Closes its input, and waits until it ends well.
    fn wait(&mut self) -> Result<()> {
        let child = &mut self.child.0;
        drop(child.stdin.take());
        let mut said = String::new();
        if let Some(stderr) = &mut child.stderr {
            stderr.read_to_string(&mut said).ok();
        }
        let status = child.wait().map_err(|error| Error::io(error, &self.path))?;
        if status.success() {
            return Ok(());
        }
        let hint = match said.contains("Permission denied") {
            true => {
                " (a snap of ffmpeg writes no file whose name begins with a dot: install another)"
            }
            false => "",
        };
        let message = format!("{PROGRAM} failed ({status}): {}{hint}", said.trim());
        Err(Error::io(std::io::Error::other(message), &self.path))
    }
}

fn missing(error: &std::io::Error, path: &Path) -> Error {
    let message = match error.kind() {
        std::io::ErrorKind::NotFound => {
            "a video needs the program ffmpeg, which is not installed: \
             install it (`apt install ffmpeg`, `brew install ffmpeg`, `winget install ffmpeg`), or \
             write a .gif or a .webp"
                .to_owned()
        }
        _ => format!("a video needs the program ffmpeg, which does not start: {error}"),
    };
    Error::usage(message).in_file(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_repeated_up_to_even_sizes() {
        let pixel = |value: u8| [value; PIXEL];
        let picture =
            |values: &[u8]| values.iter().flat_map(|&value| pixel(value)).collect::<Vec<_>>();
        let odd = picture(&[1, 2, 3, 4, 5, 6, 7, 8, 9]);
        let wanted = picture(&[1, 2, 3, 3, 4, 5, 6, 6, 7, 8, 9, 9, 7, 8, 9, 9]);
        assert_eq!(*even(&odd, [3, 3]), wanted);
        assert_eq!(*even(&picture(&[1, 2, 3]), [1, 3]), picture(&[1, 1, 2, 2, 3, 3, 3, 3]));
        assert!(matches!(even(&odd[..12], [2, 2]), Cow::Borrowed(_)));
    }
}
