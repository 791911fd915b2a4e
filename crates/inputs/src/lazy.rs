//! Lazy loading.

use std::sync::{Arc, OnceLock};

use crate::base::error::Result;

/// A value that is loaded on first use, and again if loading failed.
///
/// Loading may run in parallel, so no lock is held meanwhile, and two threads that ask at the same
/// time both load. [`crate::model::field::NodeValues::prepare`] loads before the loops begin.
#[derive(Debug)]
pub struct Lazy<T> {
    loaded: OnceLock<Arc<T>>,
}

impl<T> Default for Lazy<T> {
    fn default() -> Self {
        Self { loaded: OnceLock::new() }
    }
}

impl<T> Lazy<T> {
    /// The thing.
    ///
    /// # Errors
    /// Errors of loading.
    pub fn get(&self, load: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        if let Some(thing) = self.loaded.get() {
            return Ok(Arc::clone(thing));
        }
        let thing = Arc::new(load()?);
        Ok(Arc::clone(self.loaded.get_or_init(|| thing)))
    }
}
