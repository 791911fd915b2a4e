//! Runs of the program that are held at a moment, and ended there.
//!
//! A moment is a point of an output's life, as `appended 3` (`base/bytes/pause.rs`), where the
//! run waits, or a line that the program writes on the way.

use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::send;

/// A run has this much time to end after a signal: the second that is promised, of which the
/// program takes 0.65 at most, and half of one more for a machine whose processors are all taken by
/// other tests: there threads, the shell that sends the signal, and the test itself wait for their turn.
pub const END: Duration = Duration::from_millis(1500);

/// A run at its moment.
pub struct Paused {
    child: Child,
    stderr: BufReader<ChildStderr>,
}

impl Paused {
    /// Starts a run and waits until it is at a point.
    pub fn at(command: &mut Command, point: &str) -> Self {
        command.env("MIPVOG_PAUSE_AT", point);
        Self::after(command, &format!("paused at {point}"))
    }

    /// Starts a run and waits for a line with these words.
    pub fn after(command: &mut Command, words: &str) -> Self {
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("starts");
        let mut stderr = BufReader::new(child.stderr.take().expect("a pipe"));
        let (mut said, mut line) = (String::new(), String::new());
        while !line.contains(words) {
            said.push_str(&line);
            line.clear();
            let length = stderr.read_line(&mut line).expect("text");
            assert!(length > 0, "{command:?} ended before {words:?}: {said}");
        }
        Self { child, stderr }
    }

    /// Kills it.
    pub fn kill(mut self) {
        self.child.kill().expect("a child");
        assert_eq!(self.child.wait().expect("ends").signal(), Some(9));
    }

    /// Lets it go on to its end; its exit code, and the rest of what it said.
    pub fn go_on(mut self) -> (Option<i32>, String) {
        drop(self.child.stdin.take());
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).expect("text");
        (self.child.wait().expect("ends").code(), said)
    }

    /// Sends a signal, lets it go on, and holds it to end soon; its exit code, and the rest of what
    /// it said.
    pub fn signal(self, signal: &str) -> (Option<i32>, String) {
        let clock = Instant::now();
        send(signal, self.child.id());
        let (code, said) = self.go_on();
        let took = clock.elapsed();
        assert!(took < END, "{took:?}: {said}");
        (code, said)
    }
}
