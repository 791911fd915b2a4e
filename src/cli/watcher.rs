//! The program that embeds this library and watches a verb at work.

use std::fmt;
use std::sync::Arc;

/// A program that watches the work.
pub trait Watcher: Send + Sync {
    /// Called from any thread, with the name of the current step and the done share of all work.
    fn shows(&self, step: &str, share: f64);

    /// True if the work should end.
    fn ends(&self) -> bool;
}

/// A watcher that all threads share.
#[derive(Clone)]
pub struct SharedWatcher(pub Arc<dyn Watcher>);

impl fmt::Debug for SharedWatcher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SharedWatcher")
    }
}
