//! Videos, coded by the program ffmpeg where it is installed.

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
        let [width, height] = options.size;
        let mut command = Command::new(PROGRAM);
        command.args(["-loglevel", "error", "-nostdin", "-y", "-f", "rawvideo"]);
        command.args(["-pixel_format", "rgb24", "-video_size", &format!("{width}x{height}")]);
        command.args(["-framerate", &options.rate.to_string(), "-i", "pipe:0"]);
        // Players want colours at half the size, so an even number of pixels along each side.
        command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"]);
        if kind != "webm" {
            // The table of frames comes first, so that a page plays the file while it loads.
            command.args(["-movflags", "+faststart"]);
        }
        // Without the prefix a colon in a folder's name would name a protocol.
        let mut written = OsString::from("file:");
        written.push(output.written());
        command.args(["-f", kind]).arg(written);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        // Ctrl-C in a terminal goes to the program that the user started alone.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command.spawn().map_err(|error| missing(&error, path))?;
        Ok(Self { child: Ended(child), output, path: path.to_owned() })
    }

    pub fn add(&mut self, values: &[u8]) -> Result<()> {
        let input = self.child.0.stdin.as_mut();
        match input.map_or(Ok(()), |input| input.write_all(values)) {
            Ok(()) => Ok(()),
            // It ended early, and says why.
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
        let message = format!("{PROGRAM} failed ({status}): {}", said.trim());
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
