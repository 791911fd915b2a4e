//! Signals that ask the program to end.
//!
//! The first Ctrl-C ends a fit with the result so far, because a fit only makes a result better. It
//! ends any other work as soon as possible; temporary files are then gone. A second one before that
//! ends the program on the spot.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit codes of programs that a signal ended are this plus its number.
const SIGNALLED: i32 = 128;

/// The last signal that asked for the end.
fn last() -> &'static Arc<AtomicUsize> {
    static LAST: OnceLock<Arc<AtomicUsize>> = OnceLock::new();
    LAST.get_or_init(|| Arc::new(AtomicUsize::new(SIGINT.unsigned_abs() as usize)))
}

/// From now on a file that grows beyond the user's limit is an error like a full disk, where it
/// would end the program without a word.
pub fn outlive_file_limits() {
    #[cfg(unix)]
    flag::register(signal_hook::consts::SIGXFSZ, Arc::default()).ok();
}

/// The signals received.
#[derive(Debug, Clone, Default)]
pub struct Interrupts {
    interrupted: Arc<AtomicBool>,
    terminated: Arc<AtomicBool>,
}

impl Interrupts {
    /// From now on signals ask instead of ending the program, where the system has such signals.
    pub fn watch() -> Self {
        let watched = Self::default();
        for (signal, asked) in [(SIGINT, &watched.interrupted), (SIGTERM, &watched.terminated)] {
            // The second signal ends the program: this line tests the flag that the next line sets.
            // A signal that cannot be watched keeps ending the program.
            flag::register_conditional_shutdown(signal, SIGNALLED + signal, Arc::clone(asked)).ok();
            flag::register_usize(signal, Arc::clone(last()), signal.unsigned_abs() as usize).ok();
            flag::register(signal, Arc::clone(asked)).ok();
        }
        watched
    }

    /// True if the user wants the result so far; answers once.
    pub fn wants_result(&self) -> bool {
        self.interrupted.swap(false, Ordering::Relaxed) || self.terminated.load(Ordering::Relaxed)
    }

    /// True if the program was told to end, and not just interrupted.
    pub fn is_terminated(&self) -> bool {
        self.terminated.load(Ordering::Relaxed)
    }

    /// True if the program should end.
    pub fn wants_end(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed) || self.terminated.load(Ordering::Relaxed)
    }
}

/// The exit code of work that a signal ended.
pub fn cancelled() -> u8 {
    (SIGNALLED.unsigned_abs() as usize + last().load(Ordering::Relaxed)) as u8
}
