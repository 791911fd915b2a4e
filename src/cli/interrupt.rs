//! Signals that ask the program to end.
//!
//! The first Ctrl-C ends a fit with the result so far, because a fit only improves a result. It
//! ends any other work as soon as possible and removes unfinished files. Work that does not respond
//! in time is ended from outside, and a second signal ends the program immediately.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Once, OnceLock};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use super::outcome::{drawn, say};
use crate::base::bytes::remove_unfinished;
use crate::base::error::Error;

/// Exit codes of programs that a signal ended are this plus its number.
const SIGNALLED: i32 = 128;
/// Time for work to end by itself. Including the removal of files, the program ends within a
/// second.
const GRACE: Duration = Duration::from_millis(600);
/// Time for the report of work that is done.
const LAST_WORDS: Duration = Duration::from_millis(100);
/// Time between two checks of the signals.
const LOOK: Duration = Duration::from_millis(40);

/// The received signals, and the work that they ask to stop.
#[derive(Default)]
struct Signals {
    interrupted: Arc<AtomicBool>,
    terminated: Arc<AtomicBool>,
    /// The number of the last signal.
    last: Arc<AtomicUsize>,
    /// Pieces of work that check for a request to stop.
    works: AtomicUsize,
    /// True while an interrupt requests the result so far.
    takes_result: AtomicBool,
    /// True if signals end the program in the default way.
    serves: AtomicBool,
}

fn signals() -> &'static Signals {
    static SIGNALS: OnceLock<Signals> = OnceLock::new();
    SIGNALS.get_or_init(Signals::default)
}

/// From now on, signals request a stop instead of ending the program, and a file that exceeds the
/// user's size limit is an error like a full disk, instead of ending the program silently. A
/// process that runs several verbs needs this only once.
pub fn watch() {
    static WATCHED: Once = Once::new();
    WATCHED.call_once(begin_watching);
}

fn begin_watching() {
    #[cfg(unix)]
    flag::register(signal_hook::consts::SIGXFSZ, Arc::default()).ok();
    let signals = signals();
    // Without the checking thread, signals keep ending the program.
    if std::thread::Builder::new().name("signals".to_owned()).spawn(|| guard(signals)).is_err() {
        return;
    }
    // A closed terminal sends SIGHUP, which some programs are told to ignore.
    let hang_up = heeds_hang_ups().then_some((SIGHUP, &signals.terminated));
    let ends = [(SIGINT, &signals.interrupted), (SIGTERM, &signals.terminated)];
    for (signal, asked) in ends.into_iter().chain(hang_up) {
        // The second signal ends the program: this line tests the flag that the last line sets.
        // A signal that cannot be watched keeps ending the program.
        flag::register_conditional_shutdown(signal, SIGNALLED + signal, Arc::clone(asked)).ok();
        let number = signal.unsigned_abs() as usize;
        flag::register_usize(signal, Arc::clone(&signals.last), number).ok();
        flag::register(signal, Arc::clone(asked)).ok();
    }
}

/// From now on, a signal is the expected end of the program, not an error.
pub fn serve() {
    signals().serves.store(true, Ordering::Relaxed);
}

/// True if SIGHUP is not ignored, as it is under `nohup`; false if the system does not reveal it.
fn heeds_hang_ups() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask >> (SIGHUP - 1) & 1 == 0)
}

/// Ends the program if no work checks for the request, or none stops in time.
fn guard(signals: &Signals) {
    let (mut asked, mut idle) = (None, None);
    loop {
        std::thread::sleep(LOOK);
        let since = |start: &mut Option<Instant>, holds: bool| -> Duration {
            *start = start.filter(|_| holds).or_else(|| holds.then(Instant::now));
            start.map_or(Duration::ZERO, |start| start.elapsed())
        };
        let wanted = signals.want_end();
        let asked = since(&mut asked, wanted);
        let idle = since(&mut idle, wanted && signals.works.load(Ordering::Relaxed) == 0);
        if asked < GRACE && idle < LAST_WORDS {
            continue;
        }
        remove_unfinished();
        if let Some(bar) = drawn().take() {
            bar.finish_and_clear();
        }
        if signals.serves.load(Ordering::Relaxed) {
            std::process::exit(0);
        }
        let error = Error::cancelled();
        say(&format!("error: {error}\n  help: {}", error.remedy()));
        std::process::exit(cancelled().into());
    }
}

impl Signals {
    fn want_end(&self) -> bool {
        let interrupted = self.interrupted.load(Ordering::Relaxed);
        let takes_result = self.takes_result.load(Ordering::Relaxed);
        (interrupted && !takes_result) || self.terminated.load(Ordering::Relaxed)
    }
}

/// Work that regularly checks for a request to stop, until dropped.
pub struct Work(());

impl Work {
    /// Begins work.
    pub fn begin() -> Self {
        signals().works.fetch_add(1, Ordering::Relaxed);
        Self(())
    }

    /// Sets whether an interrupt requests the result so far, instead of a stop. A late interrupt is
    /// discarded.
    pub fn takes_result(&self, takes: bool) {
        let signals = signals();
        if signals.takes_result.swap(takes, Ordering::Relaxed) && !takes {
            signals.interrupted.store(false, Ordering::Relaxed);
        }
    }

    /// True if the user requested the result so far; handles an interrupt once.
    pub fn wants_result(&self) -> bool {
        let signals = signals();
        let takes_result = signals.takes_result.load(Ordering::Relaxed);
        takes_result && signals.interrupted.swap(false, Ordering::Relaxed)
    }

    /// True if the work should end.
    pub fn is_cancelled(&self) -> bool {
        signals().want_end()
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        self.takes_result(false);
        signals().works.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The exit code of work that was ended by a signal.
pub fn cancelled() -> u8 {
    let last = match signals().last.load(Ordering::Relaxed) {
        0 => SIGINT.unsigned_abs() as usize,
        last => last,
    };
    (SIGNALLED.unsigned_abs() as usize + last) as u8
}
