//! Work on a thread of its own. The calling thread waits without the interpreter lock, and takes it
//! now and then: to see signals, such as Ctrl-C, and to tell progress.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use mipvog::Progress;
use mipvog::base::error::Result;
use mipvog::base::parallel;
use mipvog_bake::cli::Watcher;
use pyo3::prelude::*;

/// Time between two looks at signals and progress.
const LOOK: Duration = Duration::from_millis(50);

/// The state of work.
#[derive(Debug, Default)]
pub struct Watch {
    ends: AtomicBool,
    shown: Mutex<Shown>,
    done: Mutex<bool>,
    changed: Condvar,
}

/// The progress that was told last.
#[derive(Debug, Default, Clone, PartialEq)]
struct Shown {
    step: String,
    share: f64,
}

impl Watcher for Watch {
    fn shows(&self, step: &str, share: f64) {
        let mut shown = lock(&self.shown);
        if shown.step != step {
            step.clone_into(&mut shown.step);
        }
        shown.share = share.max(shown.share);
    }

    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }
}

impl Progress for Watch {
    fn cancelled(&self) -> bool {
        self.ends()
    }
}

/// Sets a flag when work ends, also by a panic.
struct Finish<'a>(&'a Watch);

impl Drop for Finish<'_> {
    fn drop(&mut self) {
        *lock(&self.0.done) = true;
        self.0.changed.notify_all();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch {
    /// Waits for the end of work; `true` if it came.
    fn wait(&self) -> bool {
        let done = lock(&self.done);
        let waited = self.changed.wait_timeout_while(done, LOOK, |done| !*done);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Runs work while this thread looks at signals and calls `progress` with the step and the share of
/// the work that is done. An exception of either ends the work and is raised when it has ended.
pub fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Arc<Watch>) -> T + Send,
) -> PyResult<T> {
    let watch = Arc::new(Watch::default());
    let (mut told, mut raised) = (Shown::default(), None);
    let result = std::thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let _finish = Finish(&watch);
            work(&watch)
        });
        while !py.detach(|| watch.wait()) {
            if raised.is_none() {
                raised = look(py, &watch, progress, &mut told).err();
                watch.ends.store(raised.is_some(), Ordering::Relaxed);
            }
        }
        py.detach(|| worker.join())
    });
    let result = result.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    match raised.map_or_else(|| look(py, &watch, progress, &mut told), Err) {
        Ok(()) => Ok(result),
        Err(error) => Err(error),
    }
}

/// The same for work that is parallel itself. It has threads of its own: those of the process would
/// be missing in a child that is forked after they were made.
pub fn watched_on_threads<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Arc<Watch>) -> Result<T> + Send,
) -> PyResult<Result<T>> {
    watched(py, progress, |watch| parallel::with_threads(0, || work(watch))?)
}

fn look(
    py: Python<'_>,
    watch: &Watch,
    progress: Option<&Bound<'_, PyAny>>,
    told: &mut Shown,
) -> PyResult<()> {
    py.check_signals()?;
    let Some(progress) = progress else { return Ok(()) };
    let shown = lock(&watch.shown).clone();
    if shown != *told && !shown.step.is_empty() {
        progress.call1((&shown.step, shown.share))?;
        *told = shown;
    }
    Ok(())
}
