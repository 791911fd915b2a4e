//! Reports of the library on its current step. It never prints.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A step of the work, in the order of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Step {
    /// Finding the views that see each part of a scene, to which colours are fitted.
    Views,
    /// Asking a network for the colours of a scene.
    Colors,
    /// Finding the visible nodes of every level.
    Prune,
    /// Finding the parts that cameras see, camera by camera.
    Cover,
    /// Rendering the pictures that coarser levels are fitted to.
    Targets,
    /// Fitting coarser levels.
    Fit,
    /// Finding the lowest and the highest values of every level.
    Ranges,
    /// Filtering, quantizing and compressing.
    Encode,
    /// Writing the output.
    Write,
    /// Reading and decoding an input.
    Decode,
    /// Rendering frames, tile by tile.
    Render,
    /// Baking over settings, and rendering the results.
    Sweep,
}

impl Step {
    /// Its name in messages, a verb.
    pub fn name(self) -> &'static str {
        match self {
            Self::Views => "find views",
            Self::Colors => "ask the network",
            Self::Prune => "prune",
            Self::Cover => "look from the cameras",
            Self::Targets => "reference pictures",
            Self::Fit => "fit",
            Self::Ranges => "find ranges",
            Self::Encode => "encode",
            Self::Write => "write",
            Self::Decode => "decode",
            Self::Render => "render",
            Self::Sweep => "sweep",
        }
    }
}

/// Receives progress and can request a stop. Called from worker threads.
pub trait Progress: Sync {
    /// `step` begins, and will advance by `total` altogether.
    fn begin(&self, _step: Step, _total: u64) {}
    /// `by` more of `step` is done.
    fn advance(&self, _step: Step, _by: u64) {}
    /// `step` reaches a named part, such as `picture 3/30`.
    fn part(&self, _step: Step, _name: &str) {}
    /// Called between pieces of work that only improve a result; `true` stops with the result so
    /// far.
    fn enough(&self) -> bool {
        false
    }
    /// Called between pieces of work; `true` stops with
    /// [`crate::base::error::ErrorKind::Cancelled`].
    fn cancelled(&self) -> bool {
        false
    }
}

/// A shared request to stop: all clones of a token share their state.
///
/// ```
/// use mipvog_format::{CancelToken, Progress};
///
/// let token = CancelToken::new();
/// let other = token.clone();
/// std::thread::spawn(move || other.cancel()).join().expect("a thread");
/// assert!(token.cancelled());
/// ```
#[derive(Debug, Clone, Default)]
pub struct CancelToken(Arc<AtomicBool>);

impl CancelToken {
    /// A token that is not cancelled.
    pub fn new() -> Self {
        Self::default()
    }

    /// Requests all work with a clone of this token to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Progress for CancelToken {
    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Progress that is ignored.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {}
